"""The pictures of a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..filters.samples import Array
from ..filters.stateful import Settings
from .best import Best
from .score import short_alpha
from .svg import Chart, Scale, Tick
from .view import STATELESS, View, apart

ERROR = Scale(0.1, 200.0, log=True)  # degrees
ERROR_TICKS = [(0.1, "0.1°"), (1.0, "1°"), (10.0, "10°"), (100.0, "100°")]
LINE = 14  # pixels, from one line of text to the next
HUES = 8
WIDE, HALF = 920, 452  # pixels


def kinds(names: Sequence[str]) -> dict[str, str]:
    """The classes that colour each filter, the same in every picture; red is the stateless one."""
    others = [name for name in names if name != STATELESS]
    found = {name: f"h{n % HUES} d{n // HUES % 3}" for n, name in enumerate(others)}
    return found | {STATELESS: "red"}


def error_chart(view: View, kind: Mapping[str, str]) -> str:
    """Errors of all filters over time, each named at its end with its RMSE."""
    most = max(260, LINE * len(view.errors) + 50)
    seconds = Scale(0.0, max(view.duration, view.bin))
    chart = Chart((WIDE, most), seconds, ERROR, (8, 220, 24, 40))
    for start, stop in view.unscored:
        chart.band(start, stop, "unscored")
    chart.axes([*seconds.ticks(10)[:-1], (seconds.high, "s")], ERROR_TICKS)
    labels = []
    for name, error in view.errors.items():
        words = f"{name}  {view.rmse[name].total:.2f}°"
        chart.curve(view.time, error, kind[name], words)
        known = error[np.isfinite(error)]
        labels.append((float(ERROR(known[-1])) if len(known) else 0.0, words, kind[name]))
    _name_ends(chart, labels)
    x, y = chart.across(view.window[0]), chart.height - chart.bottom
    chart.add(f'<path class="window" d="M{x:.1f} {y}H{chart.across(view.window[1]):.1f}"/>')
    return chart.svg(f"Attitude error of {', '.join(view.errors)} over time on {view.name}")


def element_chart(view: View, name: str) -> str:
    """The elements w, x, y, z of a rotor over the truth's."""
    chart = _window_chart(view, Scale(-1.05, 1.05), [(-1.0, "−1"), (0.0, "0"), (1.0, "1")])
    if view.truth is not None:
        for values in view.truth.T:
            chart.curve(view.at, values, "truth")
    labels = []
    for element, values in zip("wxyz", view.rotors[name].T, strict=True):
        chart.curve(view.at, values, element)
        labels.append((float(chart.y(values[-1])), element, element))
    _name_ends(chart, labels)
    return chart.svg(f"Quaternion elements of {name} on {view.name}")


def angle_chart(view: View, kind: Mapping[str, str]) -> str:
    """The angle that runs on, and that within a turn of the stateless rotor."""
    every = np.concatenate([*view.angles.values(), [0.0]])
    low, high = (
        90.0 * f(edge / 90.0) for f, edge in ((np.floor, every.min()), (np.ceil, every.max()))
    )
    step = 90.0 * max(1.0, np.ceil((high - low) / 90.0 / 6.0))
    places = np.arange(low, high + 1.0, step).tolist()
    ticks = [(value, f"{value:.0f}°".replace("-", "−")) for value in places]
    chart = _window_chart(view, Scale(low, max(high, low + 90.0)), ticks)
    labels = []
    for name, values in reversed(list(view.angles.items())):
        hue, *_ = kind.get(name, "h0").split()
        chart.curve(view.at, values, hue + " thin" * (name == STATELESS), name)
        word = "stateless" if name == STATELESS else "stateful"
        labels.append((float(chart.y(values[-1])), word, hue))
    _name_ends(chart, labels)
    return chart.svg(f"Angle on {view.name}")


def axis_chart(view: View) -> str:
    """The axis of the rotor shown."""
    chart = _window_chart(view, Scale(-1.05, 1.05), [(-1.0, "−1"), (0.0, "0"), (1.0, "1")])
    labels = []
    for element, values in zip("xyz", view.axes.T, strict=True):
        chart.curve(view.at, values, element)
        labels.append((float(chart.y(values[-1])), element, element))
    _name_ends(chart, labels)
    return chart.svg(f"Axis of {view.shown} on {view.name}")


def box_chart(
    title: str, views: Sequence[View], names: Sequence[str], kind: Mapping[str, str]
) -> str:
    """For each filter the errors of some trials: 5, 25, 50, 75 and 95 %, and each trial's RMSE."""
    names = [name for name in names if any(name in view.bounds for view in views)]
    height = 46 + LINE * len(names)
    chart = Chart((HALF, height), ERROR, Scale(len(names), 0.0), (20, 12, 24, 128))
    chart.text(6, 12, title, "name")
    foot = height - chart.bottom
    for value, word in ERROR_TICKS:
        x = chart.across(value)
        chart.add(f'<path class="grid" d="M{x:.1f} {chart.top}V{foot}"/>')
        chart.text(x, foot + 15, word, "tick middle")
    for row, name in enumerate(names):
        y = chart.top + LINE * (row + 0.5)
        chart.text(chart.left - 6, y + 4, name, f"tick end {kind[name]}")
        own = [view for view in views if name in view.bounds]
        pooled = np.concatenate([view.bounds[name] for view in own])
        low, first, middle, third, high = map(
            chart.across, np.quantile(pooled, [0.05, 0.25, 0.5, 0.75, 0.95])
        )
        chart.add(
            f'<g class="box {kind[name]}"><path d="M{low:.1f} {y}H{first:.1f}M{third:.1f} {y}'
            f'H{high:.1f}"/><rect x="{first:.1f}" y="{y - 4}" width="{third - first:.1f}" '
            f'height="8"/><path class="median" d="M{middle:.1f} {y - 4}v8"/></g>'
        )
        for view in own:
            chart.dot(view.rmse[name].total, row + 0.5, "each", 1.8)
    return chart.svg(f"Errors on {title}")


def sweep_chart(
    best: Sequence[Best],
    each: Sequence[Mapping[float, float]],
    settings: Settings,
    kind: Mapping[str, str],
) -> str:
    """Error over α for each filter, the best marked; faint, over ``each`` recording alone."""
    curves = [*each, *(one.errors for one in best)]
    errors = [error for curve in curves for error in curve.values()]
    rests = [1.0 - alpha for curve in curves for alpha in curve]
    y = Scale(0.9 * max(min(errors), 0.01), 1.1 * max(*errors, 0.02), log=True)
    x = Scale(max(rests), min(rests), log=True)
    chart = Chart((WIDE, max(300, LINE * len(best) + 70)), x, y, (12, 320, 46, 46))
    chart.axes(_alpha_ticks(x, settings), [(value, f"{value:g}°") for value, _ in y.ticks()])
    for curve in each:
        chart.curve(*_points(curve), "faint")
    labels = []
    for one in best:
        tau = "" if one.time_constant is None else f", τ {one.time_constant:.3g} s"
        words = f"{one.filter}  {one.error:.2f}° at α {short_alpha(one.alpha)}{tau}"
        chart.curve(*_points(one.errors), kind[one.filter], words)
        chart.dot(1.0 - one.alpha, one.error, kind[one.filter])
        labels.append((float(y(list(one.errors.values())[-1])), words, kind[one.filter]))
    _name_ends(chart, labels)
    return chart.svg("Error over alpha")


def _alpha_ticks(x: Scale, settings: Settings) -> list[Tick]:
    """α, and below it its time constant where α is for a span of time."""
    found = []
    for rest, _ in x.ticks():
        alpha = 1.0 - rest
        tau = -1.0 / (settings.alpha_rate * np.log(alpha)) if settings.alpha_rate and alpha else 0.0
        found.append((rest, f"{alpha:.6g}" + (f"\n{tau:.3g} s" if tau else "")))
    return found


def _points(curve: Mapping[float, float]) -> tuple[Array, Array]:
    return 1.0 - np.array(list(curve)), np.array(list(curve.values()))


def _window_chart(view: View, y: Scale, ticks: Sequence[Tick]) -> Chart:
    seconds = Scale(*view.window)
    chart = Chart((HALF, 180), seconds, y, (8, 62, 24, 40))
    chart.axes([*seconds.ticks(6)[:-1], (seconds.high, "s")], ticks)
    return chart


def _name_ends(chart: Chart, labels: list[tuple[float, str, str]]) -> None:
    """Write each curve's name at its right end, moved apart where they would overlap."""
    labels = sorted(labels)
    step = min(LINE / chart.inner_height, 1.0 / max(len(labels), 1))
    x = chart.width - chart.right + 8
    dashed = any("d1" in kind for _, _, kind in labels)
    places = apart([place for place, _, _ in labels], step)
    for place, (_, words, kind) in zip(places, labels, strict=True):
        y = chart.height - chart.bottom - place * chart.inner_height
        if dashed:  # colours come again: show how the line is drawn
            chart.add(f'<path class="curve {kind}" d="M{x} {y:.1f}h24"/>')
        chart.text(x + 30 * dashed, y + 4, words, kind)
