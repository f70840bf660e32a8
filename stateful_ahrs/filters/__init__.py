"""Filters: samples over time → rotor. One registry, for the fusion node and for `evaluate`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

from ..errors import UsageError
from ..rotor import Rotor, Vector
from .learning_filter import LearningFilter
from .samples import Array, Samples
from .stateful import Report, Settings, StatefulFilter


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
    def started(self) -> bool:
        """Whether the attitude is known."""

    @property
    def heading_known(self) -> bool:
        """Whether a magnetometer has told north since the start."""

    @property
    def report(self) -> Report:
        """What /diagnostics shows."""


AS_PUBLISHED: dict[str, Any] = {"normalise": False, "average_start": False}

FILTERS: dict[str, Callable[[Settings], Filter]] = {
    "stateful": StatefulFilter,
    "paper": partial(StatefulFilter, **AS_PUBLISHED),
    "paper_stateless": partial(StatefulFilter, **AS_PUBLISHED, stateful=False),
    "learning": LearningFilter,
}


def make(name: str, settings: Settings = Settings()) -> Filter:
    """The filter of that name; `UsageError` for an unknown one."""
    if name not in FILTERS:
        raise UsageError(f"there is no filter {name!r}; there are {', '.join(FILTERS)}.")
    return FILTERS[name](settings)
