"""The gyroscope's bias, from the last seconds at rest."""

from __future__ import annotations

import math

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
        self._rates: list[tuple[float, Vector]] = []  # with the step before each, s
        self._most = 2 * SAMPLES

    def add(self, rate: Vector, dt: float) -> None:
        """Take raw rates (rad/s), ``dt`` s after the last.

        A 0 or a value not finite begins the rest anew.
        """
        self._rates.append((dt, rate))
        if len(self._rates) > self._most:  # seldom: what is older is looked for then
            self._rates = self._last()
            self._most = 2 * len(self._rates) + 2 * SAMPLES

    def _last(self) -> list[tuple[float, Vector]]:
        """Of the rates those of the last `WINDOW`, all good."""
        time = 0.0
        start = len(self._rates)
        for dt, rate in reversed(self._rates):
            if time > WINDOW or not (dt > 0.0 and math.isfinite(sum(rate))):
                break
            time += dt
            start -= 1
        return self._rates[start:]

    def bias(self) -> Vector:
        """The mean rate (rad/s) if the sensor rested; `MovedError` if it did not."""
        last = self._last()
        span = sum(dt for dt, _ in last[1:])
        if span < 0.9 * WINDOW or len(last) < SAMPLES:
            raise MovedError(
                f"{span:.1f} s of gyroscope samples so far ({len(last)}); "
                f"keep the sensor still for {WINDOW:g} s and call again."
            )
        rates = np.array([rate for _, rate in last])
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
