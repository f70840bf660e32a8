"""Errors over time and the rotor's elements, as a figure for a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import filters
from ..errors import AhrsError, UsageError
from ..filters.samples import Array
from ..filters.stamps import steps
from ..filters.stateful import Settings
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
STYLE: dict[Any, Any] = {
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
WINDOW = 12.0  # s, in which the elements are shown
LEAST, GREATEST = 0.1, 200.0  # °, ends of the logarithmic axis
LINE = 0.16  # in, from one label to the next


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
    baseline, in the seconds in which they differ most.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(STYLE):
        heights = [5.0 if trial.truth else 2.6 for trial in trials]
        figure = Figure(figsize=(9.0, sum(heights)), layout="constrained")
        blocks = figure.subfigures(len(trials), 1, height_ratios=heights, squeeze=False)
        for block, trial in zip(blocks[:, 0], trials, strict=True):
            _draw_trial(block, trial, names, settings)
        undated: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
        form = path.suffix.lower()[1:]
        figure.savefig(path, format=form, dpi=160, metadata=undated.get(form))


def _draw_trial(block: SubFigure, trial: Trial, names: Sequence[str], settings: Settings) -> None:
    shown = next((name for name in names if name != STATELESS), "stateful")
    rotors = {
        name: estimate(trial, filters.make(name, settings))
        for name in dict.fromkeys((*names, shown, STATELESS))
    }
    time = np.nancumsum(steps(trial.samples.stamps))  # jumps of the stamps take no time
    apart = errors(rotors[shown], rotors[STATELESS]).total
    window = _window(time, apart * trial.truth.counts if trial.truth else apart)
    tau = time_constant(settings, trial.samples)
    block.suptitle(
        f"{trial.name}   α = {short_alpha(settings.alpha)}, τ = {tau:.3g} s",
        x=0.008,
        ha="left",
        fontsize=10.5,
        fontweight="bold",
    )
    if trial.truth:
        axes = block.subplot_mosaic([["errors"] * 2, [*"ab"]], height_ratios=(1.25, 1.0))
        named = {name: rotors[name] for name in names}
        _draw_errors(axes["errors"], time, named, trial.truth, window)
    else:
        axes = block.subplot_mosaic([[*"ab"]])
    for name, ax in ((shown, axes["a"]), (STATELESS, axes["b"])):
        _draw_elements(ax, name, time, rotors[name], trial.truth, window)
    axes["b"].tick_params(labelleft=False)


def _draw_errors(
    ax: Axes, time: Array, rotors: dict[str, Array], truth: Truth, window: tuple[float, float]
) -> None:
    ax.set_title(
        "attitude error in degrees: the mean of each second, and at the right the RMSE",
        loc="left",
        fontsize=9,
    )
    for start, stop in _spans(time, ~truth.counts):
        ax.axvspan(start, stop, color=FAINT, alpha=0.6, lw=0, zorder=0)
        if stop - start > 0.08 * time[-1]:
            place = (0.5 * (start + stop), 0.12)
            across = ax.get_xaxis_transform()
            ax.text(*place, "not scored", color=PALE, transform=across, ha="center")
    colours = iter(COLOURS * (1 + len(rotors) // len(COLOURS)))
    labels = []
    for name, estimated in rotors.items():
        colour = RED if name == STATELESS else next(colours)
        middle, error = _binned(time, np.degrees(errors(estimated, truth.rotors).total))
        error = np.maximum(error, LEAST)
        ax.plot(middle, error, color=colour)
        end = np.log(error[np.isfinite(error)][-1] / LEAST) / np.log(GREATEST / LEAST)
        labels.append((float(end), f"{name}  {rmse_deg(estimated, truth).total:.1f}°", colour))
    ax.set_yscale("log")
    ax.set_ylim(LEAST, GREATEST)
    ax.set_yticks([0.1, 1.0, 10.0, 100.0], ["0.1", "1", "10", "100"])
    ax.minorticks_off()
    ax.grid(axis="y")
    ax.set_xlim(0.0, max(time[-1], BIN))
    _label_ends(ax, labels, 2.2)
    ax.hlines(LEAST * 1.2, *window, color=INK, lw=2.5)
    ax.text(window[1], LEAST * 1.2, "  shown below", color=INK, va="center")
    _name_seconds(ax)


def _draw_elements(
    ax: Axes,
    name: str,
    time: Array,
    rotors: Array,
    truth: Truth | None,
    window: tuple[float, float],
) -> None:
    ax.set_title(f"{name}: w, x, y, z{', truth in grey' * bool(truth)}", loc="left", fontsize=9)
    rows = slice(*np.searchsorted(time, window, side="left"))
    rotors = rotors[rows]
    if truth:
        ax.plot(time[rows], _continued(truth.rotors[rows], rotors), color="#d6d6d6", lw=3.4)
    labels = []
    for element, values in zip(ELEMENTS, rotors.T, strict=True):
        ax.plot(time[rows], values, color=ELEMENTS[element])
        labels.append((float(values[-1] + 1.05) / 2.1, element, ELEMENTS[element]))
    ax.set_xlim(*window)
    ax.set_ylim(-1.05, 1.05)
    ax.set_yticks([-1.0, 0.0, 1.0], ["−1", "0", "1"])
    ax.grid(axis="y")
    _label_ends(ax, labels, 1.7)
    _name_seconds(ax)


def _name_seconds(ax: Axes) -> None:
    from matplotlib.ticker import MaxNLocator

    ax.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    ax.annotate("s", (1.0, 0.0), (12, -6.0), "axes fraction", textcoords="offset points", va="top")


def _label_ends(ax: Axes, labels: list[tuple[float, str, str]], inches: float) -> None:
    """Write each curve's name at its right end, moved apart where they would overlap."""
    labels = sorted(labels)
    heights = apart([height for height, _, _ in labels], min(LINE / inches, 1.0 / len(labels)))
    for height, (_, text, colour) in zip(heights, labels, strict=True):
        ax.annotate(
            text,
            (1.0, height),
            (6, 0),
            "axes fraction",
            textcoords="offset points",
            color=colour,
            va="center",
        )


def apart(places: Sequence[float], step: float) -> list[float]:
    """The sorted places, moved as little as need be to be a step apart and within 0 to 1.

    Least squares under an order: neighbours that are too near are pooled about their mean.
    """
    pools: list[tuple[float, int]] = []
    for n, place in enumerate(places):
        mean, size = place - n * step, 1
        while pools and pools[-1][0] > mean:
            before, number = pools.pop()
            mean = (mean * size + before * number) / (size + number)
            size += number
        pools.append((mean, size))
    highest = 1.0 - (len(places) - 1) * step
    lowered = [min(max(mean, 0.0), highest) for mean, size in pools for _ in range(size)]
    return [place + n * step for n, place in enumerate(lowered)]


def _window(time: Array, apart: Array) -> tuple[float, float]:
    """The span of `WINDOW` s in which two rotors differ most, or all there is."""
    last = float(time[-1])
    if last <= WINDOW:
        return 0.0, max(last, BIN)
    starts = np.arange(0.0, last - WINDOW, 1.0)
    sums = np.concatenate(([0.0], np.cumsum(apart)))
    difference = np.diff(sums[np.searchsorted(time, [starts, starts + WINDOW])], axis=0)
    start = float(starts[np.argmax(difference)])
    return start, start + WINDOW


def _binned(time: Array, values: Array) -> tuple[Array, Array]:
    """The middle of each `BIN` and the mean over it; NaN where no value is known."""
    bins = (time / BIN).astype(np.int64)
    known = np.isfinite(values)
    size = int(bins[-1]) + 1
    count = np.bincount(bins[known], minlength=size)
    total = np.bincount(bins[known], values[known], minlength=size)
    mean = np.full(size, np.nan)
    np.divide(total, count, out=mean, where=count > 0)
    return BIN * (np.arange(size, dtype=np.float64) + 0.5), mean


def _spans(time: Array, mask: Mask) -> list[tuple[float, float]]:
    """From when to when the mask is true, where that is longer than a `BIN`."""
    edges = np.flatnonzero(np.diff(mask, prepend=False, append=False))
    bounds = time[np.minimum(edges, len(time) - 1)].reshape(-1, 2)
    return [(start, stop) for start, stop in bounds.tolist() if stop - start > BIN]


def _continued(truth: Array, rotors: Array) -> Array:
    """The truth (n, 4) with the sign that continues, beginning as the rotors do."""
    known = np.isfinite(truth).all(axis=1)
    if not known.any():
        return truth
    found = truth[known]
    chain = np.concatenate((rotors[known][:1], found))
    turned = np.einsum("ij,ij->i", chain[1:], chain[:-1]) < 0.0
    continued = np.full_like(truth, np.nan)
    continued[known] = np.cumprod(np.where(turned, -1.0, 1.0))[:, None] * found
    return continued
