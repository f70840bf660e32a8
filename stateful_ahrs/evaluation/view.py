"""What is drawn of a recording: few enough numbers to travel, to stay and to fill a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .. import filters
from ..filters.samples import Array
from ..filters.stamps import steps
from ..filters.stateful import Settings
from ..rotor import Turn, angle
from .metrics import Mask, Rmse, errors, rmse_deg, truth_at
from .score import Trial, estimate, time_constant

STATELESS = "paper_stateless"

BIN = 1.0  # s, over which errors are averaged, if that makes no more than
BINS = 240
WINDOW = 12.0  # s, in which the elements are shown, in about so many
POINTS = 240
SHARES = np.linspace(0.0, 1.0, 101)  # of the errors, whose bounds are kept


@dataclass(frozen=True, eq=False)
class View:
    """One recording under a choice of filters, each with one α; angles in degrees."""

    name: str
    settings: Mapping[str, Settings]  # of each filter
    time_constants: Mapping[str, float]  # of each filter, s
    duration: float  # s
    bin: float  # s
    time: Array  # (b,) s, the middle of each bin
    errors: Mapping[str, Array]  # of each filter and estimate (b,): the mean of a bin; NaN: unknown
    rmse: Mapping[str, Rmse]  # and this over all that counts; both empty without a reference
    bounds: Mapping[str, Array]  # of `SHARES` of the errors that count
    unscored: Sequence[tuple[float, float]]  # s, from when to when

    shown: str  # the stateful filter whose rotors are drawn, beside those of `STATELESS`
    window: tuple[float, float]  # s, in which these two differ most
    at: Array  # (m,) s, in the window
    rotors: Mapping[str, Array]  # (m, 4), of both
    truth: Array | None  # (m, 4), continued in sign
    axes: Array  # (m, 3), of the one shown, which keeps its direction
    angles: Mapping[str, Array]  # (m,), of both: one runs on, the other is within a turn


def look(trial: Trial, chosen: Mapping[str, Settings]) -> View:
    """Run the filters chosen and keep what can be seen on a page.

    The rotors are those of the first filter that is stateful and of the paper's stateless
    baseline.
    """
    shown = next((name for name in chosen if name != STATELESS), "stateful")
    settings = dict(chosen)
    settings.setdefault(shown, next(iter(chosen.values())))
    settings.setdefault(STATELESS, settings[shown])
    rotors = {name: estimate(trial, filters.make(name, own)) for name, own in settings.items()}
    stamps, truth = trial.samples.stamps, trial.truth
    for topic, own in trial.estimates.items():
        rotors[topic] = truth_at(stamps, own.stamps, own.rotors).rotors

    time = np.nancumsum(steps(stamps))  # jumps of the stamps take no time
    duration = float(time[-1])
    width = max(BIN, duration / BINS)
    binned, rmse, bounds = {}, {}, {}
    middle = _binned(time, time, width)[0]
    if truth:
        for name in (*chosen, *trial.estimates):
            counts = truth.counts & np.isfinite(rotors[name]).all(axis=1)
            if not counts.any():
                continue
            total = np.degrees(errors(rotors[name], truth.rotors).total)
            binned[name] = _binned(time, total, width)[1]
            rmse[name] = rmse_deg(rotors[name], truth._replace(counts=counts))
            bounds[name] = np.quantile(total[counts], SHARES)

    apart = errors(rotors[shown], rotors[STATELESS]).total
    window = _window(time, apart * truth.counts if truth else apart)
    first, end = np.searchsorted(time, window, side="left").tolist()
    stride = max(1, (end - first) // POINTS)
    rows = np.arange(first, max(end, first + 1), stride)
    until = rotors[shown][first % stride : rows[-1] + 1 : stride]
    turn = Turn()
    turned = [(turn.update(tuple(q)), turn.axis) for q in _continued(until, until).tolist()]
    del turned[: -len(rows)]  # those before the window count the turns
    pair = {name: rotors[name][rows] for name in (shown, STATELESS)}
    return View(
        name=trial.name,
        settings={name: settings[name] for name in chosen},
        time_constants={name: time_constant(settings[name], trial.samples) for name in chosen},
        duration=duration,
        bin=width,
        time=middle,
        errors=binned,
        rmse=rmse,
        bounds=bounds,
        unscored=_spans(time, ~truth.counts) if truth else [],
        shown=shown,
        window=window,
        at=time[rows],
        rotors=pair,
        truth=_continued(truth.rotors[rows], pair[shown]) if truth else None,
        axes=np.array([axis for _, axis in turned]),
        angles={
            shown: np.degrees([now for now, _ in turned]),
            STATELESS: np.degrees([angle(tuple(q)) for q in pair[STATELESS].tolist()]),
        },
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


def _binned(time: Array, values: Array, width: float) -> tuple[Array, Array]:
    """The middle of each bin of that width and the mean over it; NaN where no value is known."""
    bins = (time / width).astype(np.int64)
    known = np.isfinite(values)
    size = int(bins[-1]) + 1
    count = np.bincount(bins[known], minlength=size)
    total = np.bincount(bins[known], values[known], minlength=size)
    mean = np.full(size, np.nan)
    np.divide(total, count, out=mean, where=count > 0)
    return width * (np.arange(size, dtype=np.float64) + 0.5), mean


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
