"""Several charts on one sheet, as an SVG file that needs no page around it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from ...filters.samples import Array
from ..svg import Chart, Scale, Tick

STYLE = """\
svg{background:#fff;font:11px system-ui,sans-serif}
text{fill:var(--c,#1f2328)}.tick{fill:#667079}.middle{text-anchor:middle}.end{text-anchor:end}
.name{font-weight:600}.grid{stroke:#d6dade;stroke-width:.6;fill:none}.axis{stroke:#667079}
.curve{fill:none;stroke:var(--c);stroke-width:1.4;stroke-linejoin:round}
.w{--c:#1f2328}.x{--c:#c8372d}.y{--c:#23835f}.z{--c:#0b62a8}.grey{--c:#98a2ab}
.wide{stroke-width:4;opacity:.35}.dashed{stroke-dasharray:5 3}"""
POINTS = 240  # of a curve at most
SIZE = (440, 190)

Curve = tuple[str, Array, Array, str]  # its name, x, y, and its colour and kind


def panel(
    title: str,
    curves: Sequence[Curve],
    x: Scale,
    y: Scale,
    x_ticks: Sequence[Tick] | None = None,
    y_ticks: Sequence[Tick] | None = None,
) -> Chart:
    """A chart of some curves with its title and their names above it; '' for no name."""
    chart = Chart(SIZE, x, y, (26, 12, 24, 44))
    chart.text(chart.left, 14, title, "name")
    chart.axes(x_ticks, y_ticks)
    right = float(chart.width - chart.right)
    for name, _, _, kind in reversed(curves):
        if name:
            chart.text(right, 14, name, f"end {kind.split()[0]}")
            right -= 7.0 * len(name) + 8.0
    for name, xs, ys, kind in curves:
        chart.curve(xs, ys, kind, name)
    return chart


def thinned(values: Array) -> Array:
    """So few of the rows that a curve through them has no more than `POINTS`."""
    return values[:: -(-len(values) // POINTS)]


def elements(time: Array, rotors: Array, kind: str = "") -> list[Curve]:
    """The curves w, x, y, z of rotors (n, 4); broken where the sign jumps."""
    time, rotors = thinned(time), thinned(rotors)
    jumps = np.einsum("ij,ij->i", rotors[1:], rotors[:-1]) < 0.0
    at = np.flatnonzero(jumps) + 1
    time = np.insert(time, at, np.nan)
    return [
        ("" if kind else name, time, np.insert(column, at, np.nan), f"{name} {kind}".strip())
        for name, column in zip("wxyz", rotors.T, strict=True)
    ]


def sheet(title: str, charts: Sequence[Chart], columns: int = 2) -> str:
    """The charts, row by row."""
    rows = [charts[n : n + columns] for n in range(0, len(charts), columns)]
    width = max(sum(chart.width for chart in row) for row in rows)
    parts, top = [], 0
    for row in rows:
        left = 0
        for chart in row:
            place: Mapping[str, int] = {
                "x": left,
                "y": top,
                "width": chart.width,
                "height": chart.height,
            }
            where = " ".join(f'{name}="{value}"' for name, value in place.items())
            parts.append(chart.svg("").replace("<svg ", f"<svg {where} ", 1))
            left += chart.width
        top += row[0].height
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {top}" '
        f'width="{width}" height="{top}"><title>{escape(title)}</title>'
        f"<style>{STYLE}</style>{''.join(parts)}</svg>"
    )
