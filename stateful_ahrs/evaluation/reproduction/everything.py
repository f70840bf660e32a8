"""All filters of the registry on BROAD, by its own metric."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ... import filters
from ...filters.frames import WorldFrame
from ...filters.samples import Array
from ...rotor import IDENTITY, Rotor
from ...snapshot.aqua import aqua
from ...snapshot.dcm import dcm
from ...snapshot.fqa import fqa
from ...snapshot.markley import markley
from ...snapshot.saam import saam
from ..metrics import rmse_deg
from ..score import Trial, estimate
from .kusaka import SLOW
from .page import Section

Trials = Callable[[], Sequence[Trial]]


def snapshots_alone(trials: Trials) -> list[tuple[str, ...]]:
    """Rows for the snapshots without a filter."""
    rows = []
    for kernel in (dcm, saam, fqa, markley, aqua):
        found = np.array([rmse_deg(_shot(kernel, t), t.truth) for t in trials() if t.truth]).mean(
            axis=0
        )
        rows.append((f"snapshot {kernel.__name__} alone", *(f"{x:.2f}" for x in found)))
    return rows


def _shot(kernel: Callable[..., tuple[bool, Rotor]], trial: Trial) -> Array:
    """The rotors (n, 4), sensor → earth (ENU), each the last one where there is none."""
    rotors, last = [], IDENTITY
    pairs = zip(trial.samples.accel.tolist(), trial.samples.mag.tolist(), strict=True)
    for accel, mag in pairs:
        found, rotor = kernel(accel, mag)
        last = rotor if found else last
        rotors.append(last)
    return WorldFrame("enu").all(np.array(rotors))


def everything(trials: Trials) -> Section:
    """Mean RMSE of each filter."""
    rows: list[tuple[str, ...]] = [("", "total", "heading", "inclination")]
    rows += snapshots_alone(trials)
    for name in filters.FILTERS:
        found = np.array(
            [rmse_deg(estimate(t, filters.make(name, SLOW)), t.truth) for t in trials() if t.truth]
        ).mean(axis=0)
        rows.append((f"`{name}`", *(f"{x:.2f}" for x in found)))
    return Section(
        "Every filter on BROAD",
        f"Mean RMSE in degrees over {len(trials())} trials, BROAD's metric, with τ = 12 s (α = "
        f"{SLOW.alpha:.6f} at 100 Hz) where a filter has an α.",
        table=rows,
    )
