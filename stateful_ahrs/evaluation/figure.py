"""Errors over time and the rotor's elements, as a figure for a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .. import filters
from ..errors import AhrsError, UsageError
from ..filters import Settings
from ..filters.samples import Array
from ..filters.stamps import steps
from .metrics import Mask, Truth, errors, rmse_deg
from .score import Trial, estimate, time_constant
from .table import short_alpha

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure

SUFFIXES = (".png", ".svg", ".pdf")
MOST = 50  # recordings; more would pass the 65536 rows of pixels that a PNG may have
STATELESS = "paper_stateless"

INK, PALE, FAINT = "#2b2b2b", "#8a8a8a", "#e4e4e4"
RED = "#cf3f3f"
COLOURS = ("#0b62a8", "#2f9e77", "#d98c10", "#7a5195", "#5b8fb9", "#8a6d3b", "#a05a7c")
ELEMENTS = dict(zip("wxyz", (INK, "#cf3f3f", "#2f9e77", "#0b62a8"), strict=True))
STYLE = {
    "font.size": 9.0,
    "text.color": INK,
    "axes.edgecolor": PALE,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": PALE,
    "ytick.color": PALE,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "grid.color": FAINT,
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "lines.solid_capstyle": "round",
    "savefig.facecolor": "white",
    "svg.hashsalt": "stateful_ahrs",  # the same picture is the same file
}

BIN = 1.0  # s, over which errors are averaged
WINDOW = 20.0  # s, in which the elements are shown
LEAD = 4.0  # s of the window before the two rotors part
APART = np.radians(20.0)
LEAST = 0.1  # °, the foot of the logarithmic axis


def check_plot(path: Path, recordings: int, alphas: int) -> None:
    """Refuse in advance what cannot be drawn; `UsageError`, or `AhrsError` without matplotlib."""
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f"--plot {path}: the name must end in {', '.join(SUFFIXES)}.")
    if alphas > 1:
        raise UsageError(f"--plot draws one alpha, and --alpha names {alphas}.")
    if recordings > MOST:
        raise UsageError(f"--plot draws up to {MOST} recordings, got {recordings}.")
    try:
        import matplotlib  # noqa: F401
    except ModuleNotFoundError:
        raise AhrsError(
            "--plot needs the Python package matplotlib: "
            "pip install 'stateful_ahrs[plot]' brings it."
        ) from None


def draw(trials: Sequence[Trial], names: Sequence[str], settings: Settings, path: Path) -> None:
    """Draw, for each trial, the errors of the filters of these names and two rotors.

    The rotors are those of the first filter that is stateful and of the paper's stateless
    baseline, over the first seconds in which they part.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(STYLE):
        heights = [5.0 if trial.truth else 2.6 for trial in trials]
        figure = Figure(figsize=(9.0, sum(heights)), layout="constrained")
        blocks = figure.subfigures(len(trials), 1, height_ratios=heights, squeeze=False)
        for block, trial in zip(blocks[:, 0], trials, strict=True):
            _draw_trial(block, trial, names, settings)
        dated = {"png": None, "svg": {"Date": None}, "pdf": {"CreationDate": None}}
        form = path.suffix.lower()[1:]
        figure.savefig(path, format=form, dpi=160, metadata=dated[form])


def _draw_trial(
    block: SubFigure, trial: Trial, names: Sequence[str], settings: Settings
) -> None:
    rotors = {name: estimate(trial, filters.make(name, settings)) for name in names}
    shown = next((name for name in names if name != STATELESS), "stateful")
    pair = {
        name: rotors[name] if name in rotors else estimate(trial, filters.make(name, settings))
        for name in (shown, STATELESS)
    }
    time = np.nancumsum(steps(trial.samples.stamps))  # jumps of the stamps take no time
    window = _window(time, errors(pair[shown], pair[STATELESS]).total)
    tau = time_constant(settings, trial.samples)
    block.suptitle(
        f"{trial.name}   α = {short_alpha(settings.alpha)}, τ = {tau:.3g} s",
        x=0.01,
        ha="left",
        fontweight="bold",
    )
    if trial.truth:
        axes = block.subplot_mosaic([["errors"] * 2, [*"ab"]], height_ratios=(1.25, 1.0))
        _draw_errors(axes["errors"], time, rotors, trial.truth, window)
    else:
        axes = block.subplot_mosaic([[*"ab"]])
    for (name, elements), ax in zip(pair.items(), (axes["a"], axes["b"]), strict=True):
        truth = trial.truth.rotors if trial.truth else None
        _draw_elements(ax, f"rotor of {name}", time, elements, truth, window)
    axes["b"].tick_params(labelleft=False)


def _draw_errors(
    ax: Axes, time: Array, rotors: dict[str, Array], truth: Truth, window: tuple[float, float]
) -> None:
    ax.set_title("error of the attitude in degrees, mean over each second", loc="left", fontsize=9)
    colours = iter(COLOURS * (1 + len(rotors) // len(COLOURS)))
    ends = []
    for name, estimated in rotors.items():
        colour = RED if name == STATELESS else next(colours)
        centre, error = _binned(time, np.degrees(errors(estimated, truth.rotors).total))
        ax.plot(centre, np.maximum(error, LEAST), color=colour)
        last = error[np.isfinite(error)][-1]
        text = f"{name}  {rmse_deg(estimated, truth).total:.1f}° RMSE"
        ends.append((max(float(last), LEAST), text, colour))
    ax.set_yscale("log")
    ax.set_ylim(LEAST, 200.0)
    ax.set_yticks([0.1, 1.0, 10.0, 100.0], ["0.1", "1", "10", "100"])
    ax.minorticks_off()
    ax.grid(axis="y")
    ax.set_xlim(0.0, time[-1])
    _label_ends(ax, ends, LEAST, 200.0, logarithmic=True)
    ax.set_xlabel("s", loc="right", labelpad=-8)
    for start, stop in _spans(time, ~truth.counts):
        ax.axvspan(start, stop, color=FAINT, alpha=0.6, lw=0, zorder=0)
    ax.hlines(LEAST * 1.15, *window, color=INK, lw=3)


def _draw_elements(
    ax: Axes,
    title: str,
    time: Array,
    rotors: Array,
    truth: Array | None,
    window: tuple[float, float],
) -> None:
    ax.set_title(title, loc="left", fontsize=9)
    rows = slice(*np.searchsorted(time, window))
    if truth is not None:
        ax.plot(time[rows], _continued(truth[rows], rotors[rows]), color="#d4d4d4", lw=3.2)
    for column, (name, colour) in enumerate(ELEMENTS.items()):
        ax.plot(time[rows], rotors[rows, column], color=colour, label=name)
    ends = [
        (float(rotors[rows][-1, column]), name, colour)
        for column, (name, colour) in enumerate(ELEMENTS.items())
    ]
    ax.set_xlim(*window)
    ax.set_ylim(-1.05, 1.05)
    ax.set_yticks([-1.0, 0.0, 1.0])
    ax.grid(axis="y")
    _label_ends(ax, ends, -1.05, 1.05)


def _label_ends(
    ax: Axes,
    ends: list[tuple[float, str, str]],
    low: float,
    high: float,
    *,
    logarithmic: bool = False,
) -> None:
    """Write each curve's name at its right end, moved apart where they would overlap."""
    scale = np.log if logarithmic else np.asarray
    span = scale(high) - scale(low)
    places = sorted(((scale(y) - scale(low)) / span, text, colour) for y, text, colour in ends)
    ax_height = ax.get_position().height
    step = 0.1
    heights = [place for place, _, _ in places]
    for n in range(1, len(heights)):
        heights[n] = max(heights[n], heights[n - 1] + step)
    over = max(0.0, heights[-1] - 1.0)
    for n in range(len(heights) - 1, -1, -1):
        ceiling = heights[n + 1] - step if n + 1 < len(heights) else 1.0
        heights[n] = min(heights[n], ceiling)
    for height, (_, text, colour) in zip(heights, places, strict=True):
        ax.annotate(text, (1.0, height), (6, 0), "axes fraction", "offset points", color=colour, va="center")


def _window(time: Array, apart: Array) -> tuple[float, float]:
    """The span of s around the moment when two rotors part; the first one if they never do."""
    far = np.flatnonzero(apart > APART)
    start = time[far[0]] - LEAD if len(far) else 0.0
    start = max(0.0, min(start, time[-1] - WINDOW))
    return float(start), float(min(start + WINDOW, time[-1]))


def _binned(time: Array, values: Array) -> tuple[Array, Array]:
    """Means over each `BIN` and the middle of it; NaN where no value is known."""
    bins = (time / BIN).astype(np.int64)
    known = np.isfinite(values)
    size = int(bins[-1]) + 1
    count = np.bincount(bins[known], minlength=size)
    total = np.bincount(bins[known], values[known], minlength=size)
    mean = np.divide(total, count, out=np.full(size, np.nan), where=count > 0)
    return (np.arange(size) + 0.5) * BIN, mean


def _spans(time: Array, mask: Mask) -> list[tuple[float, float]]:
    edges = np.flatnonzero(np.diff(mask, prepend=False, append=False))
    ends = np.minimum(edges[1::2], len(time) - 1)
    return list(zip(time[edges[::2]].tolist(), time[ends].tolist(), strict=True))


def _continued(truth: Array, rotors: Array) -> Array:
    """The truth (n, 4) with the sign that continues, beginning as the rotors do."""
    known = np.isfinite(truth).all(axis=1)
    found = truth[known]
    if not len(found):
        return truth
    turned = np.einsum("ij,ij->i", found[1:], found[:-1]) < 0.0
    sign = np.cumprod(np.where(turned, -1.0, 1.0))
    sign = np.concatenate(([1.0], sign)) * (1.0 if found[0] @ rotors[known][0] >= 0.0 else -1.0)
    continued = np.full_like(truth, np.nan)
    continued[known] = sign[:, None] * found
    return continued
