"""What `calibrate` shows: a map of the directions in a terminal, lines elsewhere."""

from __future__ import annotations

from types import TracebackType

import numpy as np
from numpy.typing import NDArray
from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel
from rich.text import Text

from ..mpu9250.calibration import Correction
from ..mpu9250.calibration_file import SECTIONS
from ..words import counted

SEEN, UNSEEN, HERE = "██", "··", "▓▓"
PERIOD = 2.0  # s between two lines, if they are not the same

Cells = NDArray[np.bool_]
UNITS = {"seconds": " s", "spread_deg_s": " °/s rms", "field_microtesla": " µT"}


class View:
    """Shows how far it is while its block runs."""

    def __init__(self, title: str, instruction: str) -> None:
        self._title = title
        self._instruction = instruction
        self._console = Console()
        self._live: Live | None = None
        if self._console.is_terminal and not self._console.is_dumb_terminal:
            self._live = Live(console=self._console, auto_refresh=False)
        self._said = ""
        self._next = 0.0

    def __enter__(self) -> View:
        if self._live:
            self._live.start()
        else:
            print(f"{self._title}: {self._instruction}", flush=True)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._live:
            self._live.stop()

    def show(
        self, elapsed: float, samples: int, cells: Cells | None, now: Cells | None, state: str
    ) -> None:
        """Show the state ``elapsed`` s after the first sample; ``now``: the last one's cell."""
        if self._live:
            lines = [Text(self._instruction), Text("")]
            if cells is not None:
                lines += [*_map(cells, now), Text("")]
            lines.append(Text(state))
            so_far = f"{elapsed:.0f} s, {counted(samples, 'sample')}"
            clock = f"{so_far}; Ctrl-C ends and keeps what is there"
            panel = Panel(Group(*lines), title=self._title, subtitle=clock, width=84)
            self._live.update(panel, refresh=True)
        elif elapsed >= self._next and state != self._said:
            self._next, self._said = elapsed + PERIOD, state
            seen = "" if cells is None else f", {100.0 * cells.mean():.0f} % of the sphere"
            print(f"{elapsed:5.1f} s, {counted(samples, 'sample')}{seen}: {state}", flush=True)


def _map(cells: Cells, now: Cells | None) -> list[Text]:
    """The sphere unrolled, each cell with the same area; +z is on top, +x in the middle."""
    names = {0: " +z", len(cells) - 1: " -z"}
    rows = []
    for n, row in enumerate(cells):
        text = Text("  ")
        for k, seen in enumerate(row):
            here = now is not None and bool(now[n, k])
            mark = HERE if here else SEEN if seen else UNSEEN
            text.append(mark, "bold yellow" if here else "green" if seen else "dim")
        rows.append(text.append(names.get(n, "")))
    width = 2 * cells.shape[1]
    axes = [" "] * (width + 4)
    for place, name in ((0, "-x"), (width // 4, "-y"), (width // 2, "+x"), (3 * width // 4, "+y")):
        axes[place + 1 : place + 3] = name
    return [*rows, Text("".join(axes), "dim")]


def described(correction: Correction) -> str:
    """The figures of its quality, as a sentence."""
    parts = []
    for name, value in correction.quality.items():
        if name.endswith("_percent"):
            parts.append(f"{name.removesuffix('_percent')} {value:g} %")
        elif name in UNITS:
            parts.append(f"{name.split('_')[0]} {value:g}{UNITS[name]}")
        else:
            parts.append(f"{name} {value:g}")
    return ", ".join(parts)


def result(sensor: str, correction: Correction) -> str:
    """The correction, for the last word."""
    section = SECTIONS[sensor]
    scale, unit = (1e6, "µT") if sensor == "mag" else (1.0, section.unit)
    numbers = " ".join(f"{scale * value:+.5g}" for value in correction.offset)
    return f"{section.offset.replace('_', ' ')} {numbers} {unit}; {described(correction)}"
