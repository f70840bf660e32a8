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
        self._errors: deque[float] = deque(maxlen=HISTORY)
        console = Console()
        self._live: Live | None = None
        if console.is_terminal and not console.is_dumb_terminal:
            self._live = Live(console=console, auto_refresh=False)
        self._next = PERIODS[bool(self._live)]

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
        if not self._live:
            print(f"{elapsed:5.1f} s  {_line(state)}", flush=True)
            return
        rows = _rows(state)
        if state.error is not None:
            self._errors.append(math.degrees(state.error))
            rows["error"] = f"{self._errors[-1]:5.2f}°  {_chart(self._errors)}"
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
    alpha = (
        f"{_number(values, 'alpha')} (time constant {_number(values, 'time_constant_s', '.2f')} s)"
    )
    return {
        "roll, pitch, yaw": " ".join(f"{math.degrees(angle):+7.1f}°" for angle in state.rpy),
        "axis": " ".join(f"{part:+8.3f}" for part in state.axis),
        "angle": f"{math.degrees(state.angle):+7.1f}° ({turns(state.angle)})",
        "IMU": f"{_number(values, 'imu_rate_hz', '7.1f')} Hz",
        "magnetometer": f"{_number(values, 'mag_rate_hz', '7.1f')} Hz",
        "heading from": values.get("heading", "?"),
        "alpha": f"{alpha} {state.answer}",
    }


def _line(state: State) -> str:
    roll, pitch, yaw = (f"{math.degrees(angle):+.1f}°" for angle in state.rpy)
    parts = [
        f"roll {roll} pitch {pitch} yaw {yaw}",
        turns(state.angle),
        f"{_number(state.fusion, 'imu_rate_hz', '.1f')} Hz",
        f"alpha {_number(state.fusion, 'alpha')} {state.answer}".rstrip(),
    ]
    if state.error is not None:
        parts.append(f"error {math.degrees(state.error):.2f}°")
    return ", ".join(parts)


def turns(angle: float) -> str:
    """An angle in rad as turns."""
    return f"{angle / (2.0 * math.pi):+.2f} turns"


def _number(values: dict[str, str], key: str, form: str = "g") -> str:
    return format(float(values[key]), form) if key in values else "?"


def _chart(errors: deque[float]) -> str:
    highest = max(1.0, *errors)
    return "".join(BARS[int(error / highest * (len(BARS) - 1))] for error in errors)
