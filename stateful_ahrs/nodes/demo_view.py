"""What the demo shows: a live view in a terminal, a line each second elsewhere."""

from __future__ import annotations

import math
from collections import deque
from types import TracebackType
from typing import Protocol

from rich.console import Console
from rich.live import Live
from rich.panel import Panel
from rich.table import Table

from ..rotor import Vector

BARS = "▁▂▃▄▅▆▇█"
HISTORY = 40  # errors in the chart
PERIODS = {True: 0.1, False: 1.0}  # s between two views: in a terminal, and elsewhere


class State(Protocol):
    """What there is to show; angles in rad."""

    rpy: Vector
    axis: Vector
    angle: float
    fusion: dict[str, str]  # the values in its diagnostics
    answer: str  # to the new alpha

    @property
    def error(self) -> float | None:
        """Against the truth."""


class View:
    """Shows the state now and then while its block runs."""

    def __init__(self, title: str, duration: float) -> None:
        self._title = title
        self._duration = duration
        self._next = 0.0
        self._errors: deque[float] = deque(maxlen=HISTORY)
        console = Console()
        self._live: Live | None = None
        if console.is_terminal and not console.is_dumb_terminal:
            self._live = Live(console=console, auto_refresh=False)

    def __enter__(self) -> View:
        if self._live:
            self._live.start()
        else:
            print(self._title, flush=True)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._live:
            self._live.stop()

    def show(self, state: State, elapsed: float) -> None:
        """Show it if it is time to, ``elapsed`` s after the first orientation."""
        if elapsed < self._next:
            return
        self._next += PERIODS[bool(self._live)]
        if state.error is not None:
            self._errors.append(math.degrees(state.error))
        rows = _rows(state)
        if not self._live:
            values = ", ".join(f"{name} {value}" for name, value in rows.items())
            print(f"{elapsed:5.1f} s: {values}", flush=True)
            return
        if self._errors:
            rows["error"] += "  " + _chart(self._errors)
        table = Table.grid(padding=(0, 2))
        table.add_column(style="bold")
        for name, value in rows.items():
            table.add_row(name, value)
        clock = f"{elapsed:.1f} of {self._duration:g} s"
        self._live.update(
            Panel(table, title=self._title, subtitle=clock, expand=False), refresh=True
        )


def _rows(state: State) -> dict[str, str]:
    values = state.fusion
    rpy = " ".join(f"{math.degrees(angle):+6.1f}°" for angle in state.rpy)
    rows = {
        "roll, pitch, yaw": rpy,
        "axis": " ".join(f"{part:+.3f}" for part in state.axis),
        "angle": f"{math.degrees(state.angle):+.1f}° ({turns(state.angle)})",
        "rates": f"IMU {_number(values, 'imu_rate_hz', '.1f')} Hz, "
        f"magnetometer {_number(values, 'mag_rate_hz', '.1f')} Hz",
        "alpha": f"{_number(values, 'alpha', 'g')} "
        f"(time constant {_number(values, 'time_constant_s', '.2f')} s)",
        "heading": f"from {values.get('heading', '?')}",
    }
    if state.answer:
        rows["alpha"] += f" {state.answer}"
    if state.error is not None:
        rows["error"] = f"{math.degrees(state.error):5.2f}°"
    return rows


def turns(angle: float) -> str:
    """An angle in rad as turns."""
    return f"{angle / (2.0 * math.pi):+.2f} turns"


def _number(values: dict[str, str], key: str, form: str) -> str:
    return format(float(values.get(key, "nan")), form)


def _chart(errors: deque[float]) -> str:
    highest = max(1.0, *errors)
    return "".join(BARS[int(error / highest * (len(BARS) - 1))] for error in errors)
