"""A report of an evaluation: one page that holds all it shows and needs no network."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from .. import __version__
from ..words import counted
from .best import CONSISTENCY, Best, best_alphas, best_of_each
from .charts import (
    angle_chart,
    axis_chart,
    box_chart,
    element_chart,
    error_chart,
    kinds,
    sweep_chart,
)
from .consistency import AHEAD
from .groups import groups
from .score import Result
from .style import SCRIPT, STYLE
from .table import BEST, ERRORS, NONE, cells, headings, means
from .view import STATELESS, View

GREEK = {"alpha": "α", "tau (s)": "τ (s)"}
SCORED = (
    "Errors are root mean squares in degrees by BROAD's metric: nothing is aligned trial by trial, "
    "and only samples with a known reference count. Flips are steps at which the rotor changes "
    "its hemisphere; ns/sample is the filter alone. τ is the time in which α leaves 1/e to the "
    "gyroscope path."
)
BLIND = "There is no reference, so errors are unknown."
SWEPT = (
    "Mean total RMSE against the reference over α, whose time constant stands below it; dots mark "
    "the best."
)
RANKED = (
    "There is no reference: α is ranked by self-consistency, the RMS innovation between the rotor "
    f"and the snapshot of the {AHEAD:g} s that follow, over α, whose time constant stands below "
    "it; dots mark the best."
)
BOXES = (
    "Errors per group of trials, filters by their mean. Boxes: quartiles of the error over all "
    "samples that count, each trial with equal weight; whiskers: 5 and 95 %; dots: the RMSE of "
    "each trial."
)


def report(
    results: Sequence[Result],
    views: Sequence[View],
    paths: Mapping[str, Path],
    command: Sequence[str],
) -> str:
    """The page, as HTML; ``paths`` are the files of the recordings."""
    best = best_alphas(results)
    chosen = _chosen(results, best)
    summary = sorted(means(chosen, 1), key=lambda row: _value(row[5]))
    names = [row[1] for row in summary]
    kind = kinds(names)
    figures, tables = _Numbers("Figure"), _Numbers("Table")
    on = f"{len(views)} recordings" if len(views) > 1 else views[0].name
    title = f"{counted(len(names), 'orientation filter')} on {on}"
    mean = f"Means of {on}. " if len(views) > 1 else ""
    body = [
        f"<h1>{escape(title)}</h1>",
        f"<p>{SCORED if any(result.rmse for result in results) else BLIND}</p>",
        _table(
            headings(chosen)[1:],
            [row[1:] for row in summary],
            tables(f"{mean}The lowest of each column is bold."),
            words=1,
            least=True,
        ),
    ]
    if best:
        body += ["<h2>The choice of α</h2>", _sweep(results, best, views[0], kind, figures)]
    if any(view.rmse for view in views):
        body += ["<h2>Groups of trials</h2>", _boxes(views, paths, names, kind, figures)]
    body.append("<h2>Recordings</h2>")
    if len(views) > 1:
        links = (f'<a href="#r{n}">{escape(view.name)}</a>' for n, view in enumerate(views))
        body.append(f"<nav>{''.join(links)}</nav>")
    for number, view in enumerate(views):
        body += [f'<h3 id="r{number}">{escape(view.name)}</h3>', *_recording(view, kind, figures)]
    marked = best_of_each(results)
    note = f"; {BEST} marks the best α of a recording and filter" if marked else ""
    body += [
        "<h2>Everything</h2>",
        _table(
            headings(results),
            cells(results),
            tables(f"All results{note}. A click on a heading sorts them."),
            words=2,
            best=[result in marked for result in results],
        ),
        f"<footer>Made by stateful_ahrs {__version__}: <code>{escape(shlex.join(command))}</code>"
        "</footer>",
    ]
    return _page(title, body)


class _Numbers:
    """Captions, numbered."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._last = 0

    def __call__(self, caption: str) -> str:
        self._last += 1
        return f"<b>{self._what} {self._last}.</b> {caption}"


def _chosen(results: Sequence[Result], best: Sequence[Best]) -> list[Result]:
    """The results with the best α of each filter, or the only one."""
    alphas = {one.filter: one.alpha for one in best}
    return [result for result in results if alphas.get(result.filter, result.alpha) == result.alpha]


def _sweep(
    results: Sequence[Result],
    best: Sequence[Best],
    view: View,
    kind: Mapping[str, str],
    figures: _Numbers,
) -> str:
    """The error over α, and by what the best was found."""
    caption = RANKED if best[0].by == CONSISTENCY else SWEPT
    each: dict[str, dict[float, float]] = {}
    if len(best) == 1 and best[0].recordings > 1:
        caption += " Faint: each recording alone."
        for result in results:
            if result.alpha is not None and result.error is not None:
                each.setdefault(result.recording, {})[result.alpha] = result.error
    ends = [escape(one.filter) for one in best if one.at_end]
    if ends:
        caption += (
            f" At an end of the sweep, so that a better one may lie beyond: {', '.join(ends)}."
        )
    settings = next(iter(view.settings.values()))
    return _figure(sweep_chart(best, list(each.values()), settings, kind), figures(caption))


def _boxes(
    views: Sequence[View],
    paths: Mapping[str, Path],
    names: Sequence[str],
    kind: Mapping[str, str],
    figures: _Numbers,
) -> str:
    """The errors of each group of trials."""
    scored = {view.name: view for view in views if view.rmse}
    boxes = []
    for group, members in groups({name: paths[name] for name in scored}).items():
        title = f"{group} ({len(members)} trials)" if len(members) > 1 else members[0]
        boxes.append(box_chart(title, [scored[name] for name in members], names, kind))
    return _figure(_pair(boxes), figures(BOXES))


def _recording(view: View, kind: Mapping[str, str], figures: _Numbers) -> list[str]:
    """The figures of one recording."""
    parts = []
    if view.rmse:
        each = "second" if view.bin == 1.0 else f"{view.bin:.2g} s"
        grey = " Grey: not scored." if view.unscored else ""
        parts.append(
            _figure(
                error_chart(view, kind),
                figures(
                    f"Attitude error, the mean of each {each}, and the RMSE.{grey} "
                    "The bar marks the time of the next figure."
                ),
            )
        )
    shown = escape(view.shown)
    pictures = {
        f"{shown}: w, x, y, z": element_chart(view, view.shown),
        f"{STATELESS}: w, x, y, z": element_chart(view, STATELESS),
        "angle": angle_chart(view, kind),
        f"{shown}: axis x, y, z": axis_chart(view),
    }
    grey = " over the reference in grey" if view.truth is not None else ""
    parts.append(
        _figure(
            _pair([f"<h4>{title}</h4>{chart}" for title, chart in pictures.items()]),
            figures(
                f"Elements of the rotor{grey}, stateful and stateless; the angle, which runs on "
                "over whole turns where the rotor is stateful, and the axis."
            ),
        )
    )
    return parts


def _value(cell: str) -> float:
    return math.inf if cell == NONE else float(cell)


def _figure(content: str, caption: str) -> str:
    return f"<figure>{content}<figcaption>{caption}</figcaption></figure>"


def _pair(contents: Sequence[str]) -> str:
    return f'<div class="pair">{"".join(f"<div>{content}</div>" for content in contents)}</div>'


def _table(
    head: Sequence[str],
    rows: Sequence[Sequence[str]],
    caption: str,
    *,
    words: int,
    least: bool = False,
    best: Sequence[bool] = (),
) -> str:
    """A table whose first ``words`` columns are no numbers."""
    ranked = {*ERRORS, "innovation", "ns/sample"} if least and len(rows) > 1 else set()
    lowest = {
        n: min(_value(row[n]) for row in rows) for n, name in enumerate(head) if name in ranked
    }
    kinds = [' class="word"' if n < words else "" for n in range(len(head))]
    heads = (
        f"<th{kind}><button>{escape(GREEK.get(name, name))}</button></th>"
        for name, kind in zip(head, kinds, strict=True)
    )
    lines = []
    for number, row in enumerate(rows):
        shown = (
            f'<td class="least">{cell}</td>'
            if n in lowest and _value(cell) == lowest[n] < math.inf
            else f"<td{kinds[n]}>{escape(cell)}</td>"
            for n, cell in enumerate(row)
        )
        kind = ' class="best"' if best and best[number] else ""
        lines.append(f"<tr{kind}>{''.join(shown)}</tr>")
    return (
        f'<div class="wide"><table class="sortable"><caption>{caption}</caption><thead><tr>'
        f"{''.join(heads)}</tr></thead><tbody>{''.join(lines)}</tbody></table></div>"
    )


def _page(title: str, body: Sequence[str]) -> str:
    newline = "\n"
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(title)}</title>
<style>
{STYLE}</style>
</head>
<body>
{newline.join(body)}
<script>
{SCRIPT}</script>
</body>
</html>
"""
