"""The gyroscope's bias, from the last seconds at rest."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from ..errors import AhrsError
from ..rotor import Vector

WINDOW = 2.0  # s
SAMPLES = 20  # at least, to tell rest from noise
STILL = np.radians(1.0)  # rad/s: rms about the mean; data-sheet noise at 92 Hz is 0.1 °/s
LARGEST = np.radians(10.0)  # rad/s: twice the data sheet's zero-rate offset


class MovedError(AhrsError):
    """The sensor was not at rest, or not for long enough."""


class RestWindow:
    """Keeps the rates of the last 2 s, so that a bias can be taken from them on request."""

    def __init__(self) -> None:
        self._rates: deque[tuple[float, Vector]] = deque()
        self._time = 0.0

    def add(self, rate: Vector, dt: float) -> None:
        """Take raw rates (rad/s), ``dt`` s after the last; 0 or a value not finite forgets all."""
        rates = self._rates
        if dt <= 0.0 or not abs(rate[0]) + abs(rate[1]) + abs(rate[2]) < math.inf:
            rates.clear()
            self._time = 0.0
            return
        time = self._time = self._time + dt
        rates.append((time, rate))
        while rates[0][0] < time - WINDOW:
            rates.popleft()

    def bias(self) -> Vector:
        """The mean rate (rad/s) if the sensor rested; `MovedError` if it did not."""
        span = self._rates[-1][0] - self._rates[0][0] if self._rates else 0.0
        if span < 0.9 * WINDOW or len(self._rates) < SAMPLES:
            raise MovedError(
                f"{span:.1f} s of gyroscope samples so far ({len(self._rates)}); "
                f"keep the sensor still for {WINDOW:g} s and call again."
            )
        rates = np.array([rate for _, rate in self._rates])
        mean = rates.mean(axis=0)
        spread = float(np.sqrt(((rates - mean) ** 2).sum(axis=1).mean()))
        if spread > STILL or float(np.abs(mean).max()) > LARGEST:
            raise MovedError(
                f"the sensor moved: rates of {np.degrees(np.abs(mean).max()):.1f} °/s, spread "
                f"{np.degrees(spread):.1f} °/s (rest is below {np.degrees(LARGEST):.0f} and "
                f"{np.degrees(STILL):.0f}); keep it still for {WINDOW:g} s and call again."
            )
        x, y, z = mean.tolist()
        return (x, y, z)
