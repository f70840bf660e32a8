"""Errors over time and the rotor's elements, as a figure for a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import AhrsError, UsageError
from ..filters.samples import Array
from .score import short_alpha
from .view import STATELESS, View, apart

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure

SUFFIXES = (".png", ".svg", ".pdf")
MOST = 50  # recordings; more would pass the 65536 rows of pixels that a PNG may have

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


def draw(views: Sequence[View], path: Path) -> None:
    """Draw, for each recording, the errors of its filters and two rotors."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(STYLE):
        heights = [5.0 if view.rmse else 2.6 for view in views]
        figure = Figure(figsize=(9.0, sum(heights)), layout="constrained")
        blocks = figure.subfigures(len(views), 1, height_ratios=heights, squeeze=False)
        for block, view in zip(blocks[:, 0], views, strict=True):
            _draw_view(block, view)
        undated: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
        form = path.suffix.lower()[1:]
        figure.savefig(path, format=form, dpi=160, metadata=undated.get(form))


def _draw_view(block: SubFigure, view: View) -> None:
    name, settings = next(iter(view.settings.items()))
    block.suptitle(
        f"{view.name}   α = {short_alpha(settings.alpha)}, τ = {view.time_constants[name]:.3g} s",
        x=0.008,
        ha="left",
        fontsize=10.5,
        fontweight="bold",
    )
    if view.rmse:
        axes = block.subplot_mosaic([["errors"] * 2, [*"ab"]], height_ratios=(1.25, 1.0))
        _draw_errors(axes["errors"], view)
    else:
        axes = block.subplot_mosaic([[*"ab"]])
    for ax, (name, rotors) in zip((axes["a"], axes["b"]), view.rotors.items(), strict=True):
        _draw_elements(ax, name, view, rotors)
    axes["b"].tick_params(labelleft=False)


def _draw_errors(ax: Axes, view: View) -> None:
    each = "second" if view.bin == 1.0 else f"{view.bin:.3g} s"
    ax.set_title(
        f"attitude error in degrees: the mean of each {each}, and at the right the RMSE",
        loc="left",
        fontsize=9,
    )
    for start, stop in view.unscored:
        ax.axvspan(start, stop, color=FAINT, alpha=0.6, lw=0, zorder=0)
        if stop - start > 0.08 * view.duration:
            place = (0.5 * (start + stop), 0.12)
            across = ax.get_xaxis_transform()
            ax.text(*place, "not scored", color=PALE, transform=across, ha="center")
    colours = iter(COLOURS * (1 + len(view.errors) // len(COLOURS)))
    labels = []
    for name, error in view.errors.items():
        colour = RED if name == STATELESS else next(colours)
        error = np.maximum(error, LEAST)
        ax.plot(view.time, error, color=colour)
        end = np.log(error[np.isfinite(error)][-1] / LEAST) / np.log(GREATEST / LEAST)
        labels.append((float(end), f"{name}  {view.rmse[name].total:.1f}°", colour))
    ax.set_yscale("log")
    ax.set_ylim(LEAST, GREATEST)
    ax.set_yticks([0.1, 1.0, 10.0, 100.0], ["0.1", "1", "10", "100"])
    ax.minorticks_off()
    ax.grid(axis="y")
    ax.set_xlim(0.0, max(view.duration, view.bin))
    _label_ends(ax, labels, 2.2)
    ax.hlines(LEAST * 1.2, *view.window, color=INK, lw=2.5)
    ax.text(view.window[1], LEAST * 1.2, "  shown below", color=INK, va="center")
    _name_seconds(ax)


def _draw_elements(ax: Axes, name: str, view: View, rotors: Array) -> None:
    grey = ", truth in grey" if view.truth is not None else ""
    ax.set_title(f"{name}: w, x, y, z{grey}", loc="left", fontsize=9)
    if view.truth is not None:
        ax.plot(view.at, view.truth, color="#d6d6d6", lw=3.4)
    labels = []
    for element, values in zip(ELEMENTS, rotors.T, strict=True):
        ax.plot(view.at, values, color=ELEMENTS[element])
        labels.append((float(values[-1] + 1.05) / 2.1, element, ELEMENTS[element]))
    ax.set_xlim(*view.window)
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
