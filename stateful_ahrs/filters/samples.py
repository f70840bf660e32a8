"""Samples over time, as every filter takes them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..rotor import Vector
from .pairing import Pairing
from .stamps import steps

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]


@dataclass(frozen=True)
class Samples:
    """One row for each gyroscope and accelerometer sample, in the order received.

    ``mag`` has a row of NaN where no new magnetometer sample belongs to the row.
    All three sensors share one right-handed sensor frame.
    """

    stamps: Stamps  # (n,) ns
    gyro: Array  # (n, 3) rad/s
    accel: Array  # (n, 3) m/s², specific force: +g up at rest
    mag: Array  # (n, 3) tesla

    def __len__(self) -> int:
        return len(self.stamps)


def pair(
    stamps: Stamps,
    gyro: Array,
    accel: Array,
    mag_stamps: Stamps,
    mag: Array,
    received: NDArray[np.int64] | None = None,
) -> Samples:
    """Give each magnetometer sample to the inertial sample that the live node gives it to.

    That is the first inertial sample that is not older (see `Pairing`); one that is not finite
    is none, and none is ever a reason to drop an inertial sample. ``received`` (k,) counts the
    inertial samples received before each magnetometer sample. It may be left to the stamps if
    they never jump back; ValueError if they do.
    """
    if received is None:
        if (np.diff(stamps) < 0).any() or (np.diff(mag_stamps) < 0).any():
            raise ValueError("stamps jump back: only `received` can tell what came first")
        received = np.searchsorted(stamps, mag_stamps)
    good = np.isfinite(mag).all(axis=1)
    arrivals = deque(
        zip(received[good].tolist(), mag_stamps[good].tolist(), mag[good].tolist(), strict=True)
    )
    pairing = Pairing()
    rows: list[Vector] = [(np.nan, np.nan, np.nan)] * len(stamps)
    last = 0
    for row, (stamp, dt) in enumerate(zip(stamps.tolist(), steps(stamps).tolist(), strict=True)):
        while arrivals and arrivals[0][0] <= row:
            _, mag_stamp, vector = arrivals.popleft()
            if pairing.add(mag_stamp, vector):
                rows[last] = vector
        if dt != dt:  # a sample that every filter skips
            continue
        if dt == 0.0:
            pairing.restart(stamp)
        rows[row] = pairing.take(stamp) or rows[row]
        last = row
    for _, mag_stamp, vector in arrivals:
        if pairing.add(mag_stamp, vector):
            rows[last] = vector
    return Samples(stamps, gyro, accel, np.array(rows, dtype=float).reshape(-1, 3))
