"""Filters: samples over time → rotor. One registry, for the fusion node and for `evaluate`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

from ..errors import UsageError
from ..rotor import Rotor, Vector
from ..snapshot.aqua import aqua as aqua_snapshot
from ..snapshot.fqa import fqa
from ..snapshot.markley import markley
from ..snapshot.saam import saam
from . import aqua, lerp
from .cubature import ckf, kckf, point_free
from .fkf import fkf
from .gdalkf import gdalkf
from .kalman import Noise, ekf, kalman
from .kernel import KernelFilter, Report
from .samples import Array, Samples
from .settings import DEFAULTS, NOTHING, Known, Settings
from .stateful import DISTURBED as DISTURBED
from .stateful import PRINTED, StatefulFilter, over
from .unscented import kukf, ukf


class Filter(Protocol):
    """What every filter has: one door for a sample, one for a whole recording.

    Rotors are of unit length, sensor → earth (north-west-up). Units are rad/s, m/s² (specific
    force) and s; the magnetic field may be in any.
    """

    settings: Settings

    def update_imu(self, gyro: Vector, accel: Vector, dt: float) -> Rotor:
        """Take a gyroscope and accelerometer sample; a ``dt`` of 0 starts anew."""

    def update_mag(self, mag: Vector) -> None:
        """Give the magnetometer sample that belongs to the next `update_imu`."""

    def amend_mag(self, mag: Vector) -> None:
        """Give the magnetometer sample that belonged to the last `update_imu`."""

    def reset(self) -> None:
        """Forget everything."""

    def run(self, samples: Samples) -> Array:
        """Rotors (n, 4) for a whole recording, from a fresh start."""

    @property
    def uses_alpha(self) -> bool:
        """Whether α plays a role in it."""

    @property
    def started(self) -> bool:
        """Whether the attitude is known."""

    @property
    def heading_known(self) -> bool:
        """Whether a magnetometer has told north since the start."""

    @property
    def bias(self) -> Vector:
        """The gyroscope's bias that the filter takes from its rates (rad/s)."""

    @property
    def known(self) -> Known | None:
        """What it learned of the sensors; None if it does not learn."""

    @property
    def stddev(self) -> tuple[float, float] | None:
        """Standard deviations of tilt and heading (rad), inf for no north; None if unknown."""

    @property
    def report(self) -> Report:
        """What /diagnostics shows."""


UNLEARNED: dict[str, Any] = {
    "alpha_heading": -1.0,
    "average_start": False,
    "despike": False,
    "low_pass": False,
    "learn_bias": False,
    "learn_misalignment": False,
    "learn_mag": False,
    "weigh_mag": False,
}
AS_PUBLISHED: dict[str, Any] = {**UNLEARNED, "normalise": False, "known": NOTHING}
OTHERS = {"saam": saam, "fqa": fqa, "markley": markley, "aqua": aqua_snapshot}

# How each filter is made of the user's settings.
FILTERS: dict[str, Callable[[Settings], Filter]] = {
    "stateful": StatefulFilter,
    "paper": partial(StatefulFilter, **AS_PUBLISHED),
    "paper_stateless": partial(StatefulFilter, **AS_PUBLISHED, stateful=False),
    "paper_printed": partial(KernelFilter, PRINTED, **AS_PUBLISHED),
    **{
        f"paper_{name}": partial(KernelFilter, over(snapshot), **AS_PUBLISHED)
        for name, snapshot in OTHERS.items()
    },
    **{
        f"paper_stateless_{name}": partial(
            KernelFilter, over(snapshot), **AS_PUBLISHED, stateful=False
        )
        for name, snapshot in OTHERS.items()
    },
    "gyro": partial(StatefulFilter, **UNLEARNED, alpha=1.0),
    "lerp": partial(KernelFilter, lerp.LERP, **UNLEARNED, known=NOTHING),
    "lerp_as_printed": partial(KernelFilter, lerp.AS_PRINTED),
    "aqua": partial(KernelFilter, aqua.AQUA),
    "aqua_as_printed": partial(KernelFilter, aqua.AS_PRINTED),
    "ekf": partial(KernelFilter, kalman(ekf)),
    "ckf": partial(KernelFilter, kalman(ckf)),
    "kckf": partial(KernelFilter, kalman(kckf)),
    "ckf_point_free": partial(KernelFilter, kalman(point_free)),
    "ukf": partial(KernelFilter, kalman(ukf)),
    "kukf": partial(KernelFilter, kalman(kukf)),
    "fkf": partial(KernelFilter, kalman(fkf, Noise(accel=0.29, mag=0.5))),
    "gdalkf": partial(KernelFilter, kalman(gdalkf, Noise(accel=0.39, mag=0.14))),
}


def make(name: str, settings: Settings = DEFAULTS) -> Filter:
    """The filter of that name; `UsageError` for an unknown one."""
    if name not in FILTERS:
        raise UsageError(f"there is no filter {name!r}; there are {', '.join(FILTERS)}.")
    return FILTERS[name](settings)
