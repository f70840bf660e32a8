"""Results as a table to read and as JSON to compute with."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import fmean
from typing import Any, TextIO

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from .score import Result

UNLIMITED = 100_000  # columns
FOLDED = 16  # columns at least for the name of a recording
NONE = "-"
NUMBERS = (
    "alpha",
    "tau (s)",
    "samples",
    "total",
    "heading",
    "inclination",
    "flips",
    "ns/sample",
)


def as_json(results: Sequence[Result]) -> dict[str, Any]:
    """The results as `evaluate --json` writes them."""
    return {
        "results": [
            {
                "recording": result.recording,
                "filter": result.filter,
                "alpha": result.alpha,
                "samples": result.samples,
                "rmse_deg": result.rmse._asdict() if result.rmse else None,
                "sign_flips": result.sign_flips,
                "ns_per_sample": result.ns_per_sample,
            }
            for result in results
        ]
    }


def write_table(results: Sequence[Result], file: TextIO) -> None:
    """Print the table, never a cell shortened: framed on a terminal, elsewhere plain."""
    console = Console(file=file)
    framed = console.is_terminal
    table = Table(
        box=SIMPLE_HEAD if framed else None,
        padding=(0, 0, 0, 1) if framed else (0, 2, 0, 0),
        pad_edge=False,
        caption="total, heading and inclination: RMSE in degrees" if framed else None,
    )
    table.add_column("recording", overflow="fold")
    table.add_column("filter", no_wrap=True)
    for name in NUMBERS:
        table.add_column(name, justify="right", no_wrap=True)
    last = None
    for result in results:
        recording, *cells = _cells(result)
        if recording != last:
            table.add_section()
        table.add_row("" if framed and recording == last else recording, *cells)
        last = recording
    table.add_section()
    for cells in _means(results):
        table.add_row(*cells, style="bold")

    needed = console.measure(table, options=console.options.update(width=UNLIMITED)).maximum
    if framed:  # names of recordings may be folded
        needed -= max(0, max(len(result.recording) for result in results) - FOLDED)
        needed = max(needed, console.width)
    console = Console(file=file, width=needed, height=console.height)
    with console.capture() as shown:
        console.print(table)
    file.write(shown.get())


def _cells(result: Result) -> list[str]:
    return [
        result.recording,
        result.filter,
        short_alpha(result.alpha),
        f"{result.time_constant:.4g}",
        str(result.samples),
        *([f"{angle:.2f}" for angle in result.rmse] if result.rmse else [NONE] * 3),
        str(result.sign_flips),
        f"{result.ns_per_sample:.0f}",
    ]


def _means(results: Sequence[Result]) -> list[list[str]]:
    """For each filter and α over several recordings: over those with a reference, or all."""
    rows = []
    for name, alpha in dict.fromkeys((result.filter, result.alpha) for result in results):
        own = [result for result in results if (result.filter, result.alpha) == (name, alpha)]
        told = [result for result in own if result.rmse] or own
        if len(told) == 1:
            continue
        errors = [result.rmse for result in told if result.rmse]
        time_constants = {result.time_constant for result in told}
        rows.append(
            [
                f"mean of {len(told)}",
                name,
                short_alpha(alpha),
                f"{time_constants.pop():.4g}" if len(time_constants) == 1 else NONE,
                f"{fmean(result.samples for result in told):.0f}",
                *([f"{fmean(error):.2f}" for error in zip(*errors, strict=True)] or [NONE] * 3),
                f"{fmean(result.sign_flips for result in told):.4g}",
                f"{fmean(result.ns_per_sample for result in told):.0f}",
            ]
        )
    return rows


def short_alpha(alpha: float) -> str:
    """As many digits as tell 1 − α to four."""
    digits = 3 - math.floor(math.log10(1.0 - alpha)) if alpha < 1.0 else 1
    return f"{alpha:.{digits}f}".rstrip("0").rstrip(".")
