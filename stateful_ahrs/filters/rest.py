"""The gyroscope's bias, from the last seconds at rest."""

from __future__ import annotations

import struct

import numpy as np

from ..errors import AhrsError
from ..rotor import Vector
from .samples import Array

WINDOW = 2.0  # s
SAMPLES = 20  # at least, to tell rest from noise
STILL = np.radians(1.0)  # rad/s: rms about the mean; data-sheet noise at 92 Hz is 0.1 °/s
LARGEST = np.radians(10.0)  # rad/s: twice the data sheet's zero-rate offset

ROW = struct.Struct("4d")


class MovedError(AhrsError):
    """The sensor was not at rest, or not for long enough."""


class RestWindow:
    """Keeps the rates of the last 2 s, so that a bias can be taken from them on request."""

    def __init__(self) -> None:
        # Rows of a step (s) and the rate after it. Bytes, because each object that is kept would
        # make the next one take memory that no cache holds.
        self._rows = bytearray()
        self._most = 2 * SAMPLES * ROW.size

    def add(self, rate: Vector, dt: float) -> None:
        """Take raw rates (rad/s), ``dt`` s after the last.

        A 0 or a value not finite begins the rest anew.
        """
        self._rows += ROW.pack(dt, *rate)
        if len(self._rows) > self._most:  # seldom: what is older is looked for then
            self._rows = bytearray(self._last().tobytes())
            self._most = 2 * (len(self._rows) + SAMPLES * ROW.size)

    def _last(self) -> Array:
        """Of the rows those of the last `WINDOW`, all good."""
        rows = np.frombuffer(bytes(self._rows)).reshape(-1, 4)
        good = (rows[:, 0] > 0.0) & np.isfinite(rows).all(axis=1)
        age = np.cumsum(rows[::-1, 0])[::-1] - rows[:, 0]  # s before the last
        taken = good & (age <= WINDOW)
        return rows[len(rows) - int(np.argmin(np.append(taken[::-1], False))) :]

    def bias(self) -> Vector:
        """The mean rate (rad/s) if the sensor rested; `MovedError` if it did not."""
        last = self._last()
        span = last[1:, 0].sum()
        if span < 0.9 * WINDOW or len(last) < SAMPLES:
            raise MovedError(
                f"{span:.1f} s of gyroscope samples so far ({len(last)}); "
                f"keep the sensor still for {WINDOW:g} s and call again."
            )
        rates = last[:, 1:]
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
