"""Results as a table to read, and as JSON and CSV to compute with."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from statistics import fmean
from typing import Any, TextIO

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from .best import best_alphas, best_of_each
from .score import Result, short_alpha

UNLIMITED = 100_000  # columns
FOLDED = 16  # columns at least for the name of a recording
NONE = "-"
BEST = "*"
ERRORS = ("total", "heading", "inclination")
INNOVATION = "innovation"


def as_json(results: Sequence[Result]) -> dict[str, Any]:
    """The results as `evaluate --json` writes them; after a sweep also the best α."""
    found: dict[str, Any] = {
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
            | ({} if result.innovation is None else {"innovation_deg": result.innovation})
            for result in results
        ]
    }
    best = best_alphas(results)
    if best:
        found["best"] = [
            {
                "filter": one.filter,
                "alpha": one.alpha,
                "time_constant_s": one.time_constant,
                "by": one.by,
                "error_deg": one.error,
                "recordings": one.recordings,
            }
            for one in best
        ]
    return found


def write_csv(results: Sequence[Result], file: TextIO) -> None:
    """A header and a row for each result, in full precision; cells that say nothing are empty."""
    rows = csv.writer(file, lineterminator="\n")
    rows.writerow(
        [
            *("recording", "filter", "alpha", "time_constant_s", "samples"),
            *(f"{error}_deg" for error in (*ERRORS, INNOVATION)),
            *("sign_flips", "ns_per_sample"),
        ]
    )
    for result in results:
        rows.writerow(
            [
                *(result.recording, result.filter, result.alpha, result.time_constant),
                *(result.samples, *(result.rmse or [None] * 3), result.innovation),
                *(result.sign_flips, result.ns_per_sample),
            ]
        )


def headings(results: Sequence[Result]) -> list[str]:
    """Of the columns of `cells` and `means`."""
    ranked = any(result.innovation is not None for result in results)
    return [
        *("recording", "filter", "alpha", "tau (s)", "samples"),
        *(*ERRORS, *[INNOVATION] * ranked),
        *("flips", "ns/sample"),
    ]


def write_table(results: Sequence[Result], file: TextIO) -> None:
    """Print the table, never a cell shortened: framed on a terminal, elsewhere plain."""
    console = Console(file=file)
    framed = console.is_terminal
    best = best_of_each(results)
    caption = "total, heading and inclination: RMSE in degrees"
    table = Table(
        box=SIMPLE_HEAD if framed else None,
        padding=(0, 0, 0, 1) if framed else (0, 2, 0, 0),
        pad_edge=False,
        caption=caption + f"; {BEST} the best alpha" * bool(best) if framed else None,
    )
    name, filter_, *numbers = headings(results)
    table.add_column(name, overflow="fold")
    table.add_column(filter_, no_wrap=True)
    for name in numbers:
        table.add_column(name, justify="right", no_wrap=True)
    last = None
    for (recording, *others), result in zip(cells(results), results, strict=True):
        if recording != last:
            table.add_section()
        shown = "" if framed and recording == last else recording
        table.add_row(shown, *others, style="bold" if result in best else None)
        last = recording
    table.add_section()
    for row in means(results):
        table.add_row(*row, style="bold")

    needed = console.measure(table, options=console.options.update(width=UNLIMITED)).maximum
    if framed:  # names of recordings may be folded
        needed -= max(0, max(len(result.recording) for result in results) - FOLDED)
        needed = max(needed, console.width)
    console = Console(file=file, width=needed, height=console.height)
    with console.capture() as shown_table:
        console.print(table)
    file.write(shown_table.get())


def cells(results: Sequence[Result]) -> list[list[str]]:
    """A row for each result."""
    best = best_of_each(results)
    ranked = INNOVATION in headings(results)
    return [
        [
            result.recording,
            result.filter,
            _alpha(result.alpha, result in best),
            number(result.time_constant, ".4g"),
            str(result.samples),
            *(number(angle, ".2f") for angle in result.rmse or [None] * 3),
            *[number(result.innovation, ".2f")] * ranked,
            str(result.sign_flips),
            number(result.ns_per_sample, ".0f"),
        ]
        for result in results
    ]


def means(results: Sequence[Result], least: int = 2) -> list[list[str]]:
    """For each filter and α over several recordings: over those with a reference, or all.

    Means of fewer than ``least`` are left out.
    """
    ranked = INNOVATION in headings(results)
    best = {(one.filter, one.alpha) for one in best_alphas(results)}
    runs: dict[tuple[str, float | None], list[Result]] = {}
    for result in results:
        runs.setdefault((result.filter, result.alpha), []).append(result)
    rows = []
    for (name, alpha), own in runs.items():
        told = [result for result in own if result.rmse] or own
        if len(told) < least:
            continue
        errors = [result.rmse for result in told if result.rmse]
        innovations = [result.innovation for result in told if result.innovation is not None]
        times = [result.ns_per_sample for result in told if result.ns_per_sample is not None]
        time_constants = {result.time_constant for result in told}
        rows.append(
            [
                f"mean of {len(told)}",
                name,
                _alpha(alpha, (name, alpha) in best),
                number(time_constants.pop() if len(time_constants) == 1 else None, ".4g"),
                f"{fmean(result.samples for result in told):.0f}",
                *([f"{fmean(error):.2f}" for error in zip(*errors, strict=True)] or [NONE] * 3),
                *[number(fmean(innovations) if innovations else None, ".2f")] * ranked,
                f"{fmean(result.sign_flips for result in told):.4g}",
                number(fmean(times) if times else None, ".0f"),
            ]
        )
    return rows


def number(value: float | None, form: str) -> str:
    """The number in that form, or a dash."""
    return NONE if value is None else format(value, form)


def _alpha(alpha: float | None, best: bool) -> str:
    return NONE if alpha is None else short_alpha(alpha) + BEST * best
