"""A filter from its kernel: state in, one sample of all sensors, state out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..rotor import Rotor, Vector, unit
from .compiled import run_steps
from .samples import Array, Samples
from .senses import Senses
from .settings import DEFAULTS, Known, Settings
from .stamps import steps

NO_MAG: Vector = (math.nan, math.nan, math.nan)
COUNTS = ("sign_corrections", "gyro_rejected", "accel_rejected", "mag_rejected")


@dataclass(frozen=True)
class Kernel:
    """A filter as plain functions.

    ``step(state, gains, gyro, accel, mag, dt)`` takes one sample of all sensors (rad/s, m/s²,
    any unit, s) and returns the next state; ``mag`` is NaN where no new one came. A ``dt`` of 0
    starts anew. States and gains are named tuples, and a state has ``rotor`` and ``senses``.
    """

    step: Callable[..., Any]
    start: Any  # the state before the first sample
    gains: Callable[[Settings], Any]


@dataclass(frozen=True)
class Report:
    """What /diagnostics shows of a filter."""

    started: bool
    heading_from_mag: bool
    mag_age: float  # s, inf before the first
    sign_corrections: int
    gyro_rejected: int
    accel_rejected: int
    mag_rejected: int


class KernelFilter:
    """A kernel with its settings and state; one instance for each sensor.

    ``fixed`` are settings that belong to the filter's name and that no user changes. Rotors
    returned are of unit length, sensor → earth (north-west-up), and continue in sign.
    """

    def __init__(self, kernel: Kernel, settings: Settings = DEFAULTS, **fixed: Any) -> None:
        self._kernel = kernel
        self._fixed = fixed
        self._state = self._before = kernel.start
        self.settings = settings
        self.reset()

    @property
    def settings(self) -> Settings:
        """May be replaced at any time; the next sample is taken with the new ones."""
        return self._settings

    @settings.setter
    def settings(self, settings: Settings) -> None:
        self._settings = replace(settings, **self._fixed)
        self._gains = self._kernel.gains(self._settings)
        self._changed()

    def _changed(self) -> None:
        """Take α anew where a state keeps what it makes of a step."""
        if hasattr(self._kernel.start, "pace"):
            pace = self._kernel.start.pace
            self._state = self._state._replace(pace=pace)
            self._before = self._before._replace(pace=pace)

    def reset(self) -> None:
        """Forget everything but the counts; the next sample starts anew."""
        counts = {name: getattr(self._state.senses, name) for name in COUNTS}
        self._state = self._before = self._kernel.start._replace(senses=Senses(**counts))
        self._mag = NO_MAG
        self._inputs: tuple[Vector, Vector, float] | None = None

    def update_mag(self, mag: Vector) -> None:
        """Give the magnetometer sample (sensor frame, any unit) for the next `update_imu`."""
        self._mag = mag

    def update_imu(self, gyro: Vector, accel: Vector, dt: float) -> Rotor:
        """Take rates (rad/s) and specific force (m/s²), ``dt`` s after the last ones.

        A ``dt`` of 0 starts anew from this sample, continuing the sign of the last rotor.
        """
        self._before = self._state
        self._inputs = (gyro, accel, dt)
        self._take(gyro, accel, self._mag, dt)
        self._mag = NO_MAG
        return self.rotor

    def amend_mag(self, mag: Vector) -> None:
        """Take the last step again with its magnetometer sample, which came after it."""
        if self._inputs is not None:  # none since the reset
            gyro, accel, dt = self._inputs
            self._take(gyro, accel, mag, dt)

    def _take(self, gyro: Vector, accel: Vector, mag: Vector, dt: float) -> None:
        self._state = self._kernel.step(self._before, self._gains, gyro, accel, mag, dt)

    def run(self, samples: Samples) -> Array:
        """Rotors (n, 4) for a whole recording, from a fresh start; compiled where numba is."""
        rotors = np.empty((len(samples), 4))
        self._state = self._kernel.start
        self.reset()
        self._state = run_steps(self._kernel.step)(
            self._state,
            self._gains,
            samples.gyro,
            samples.accel,
            samples.mag,
            steps(samples.stamps),
            rotors,
        )
        return rotors

    @property
    def rotor(self) -> Rotor:
        """The present attitude; the identity before the first good accelerometer sample."""
        return unit(self._state.rotor)

    @property
    def uses_alpha(self) -> bool:
        """Whether α plays a role in it."""
        one, other = (
            self._kernel.gains(replace(self._settings, **{"alpha": alpha, **self._fixed}))
            for alpha in (0.25, 0.75)
        )
        return bool(one != other)

    @property
    def started(self) -> bool:
        """Whether the attitude is known."""
        return bool(self._state.senses.started)

    @property
    def heading_known(self) -> bool:
        """Whether a magnetometer has told north since the start."""
        return bool(self._state.senses.heading_known > 0)

    @property
    def bias(self) -> Vector:
        """The gyroscope's bias that the filter takes from its rates (rad/s)."""
        bias: Vector = getattr(self._state, "bias", (0.0, 0.0, 0.0))
        return bias

    @property
    def known(self) -> Known | None:
        """What it learned of the sensors; None if it does not learn."""
        return None

    @property
    def stddev(self) -> tuple[float, float] | None:
        """Standard deviations of tilt and heading (rad): a filter without a word on them."""
        return None

    @property
    def report(self) -> Report:
        """What the filter has to say of itself."""
        senses = self._state.senses
        return Report(
            started=senses.started,
            heading_from_mag=self._settings.use_mag
            and senses.heading_known > 0
            and senses.mag_age <= self._settings.mag_timeout,
            mag_age=senses.mag_age,
            sign_corrections=senses.sign_corrections,
            gyro_rejected=senses.gyro_rejected,
            accel_rejected=senses.accel_rejected,
            mag_rejected=senses.mag_rejected,
        )
