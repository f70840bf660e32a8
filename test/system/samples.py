"""What was published, as the chip's counts, against what the chip took."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

from sensor import read_log

Row = tuple[int, ...]


def counts(message: Any, gyro_range: float, accel_range: float) -> Row:
    """The six axes of an Imu message in the counts of the chip."""
    a, g = 32768 / (accel_range * 9.80665), 32768 / math.radians(gyro_range)
    accel, gyro = message.linear_acceleration, message.angular_velocity
    return (
        *(round(n * a) for n in (accel.x, accel.y, accel.z)),
        *(round(n * g) for n in (gyro.x, gyro.y, gyro.z)),
    )


def lost_and_torn(messages: list[Any], log: Path, ranges: tuple[float, float]) -> tuple[int, int]:
    """Samples of the log that no message brought, between the first and the last that one did;
    and messages that are no sample of the log, or not a later one than the last."""
    published = [counts(message, *ranges) for message in messages]
    logged = read_log(log)
    taken = [row for _, row in logged]
    period = min((b[0] - a[0] for a, b in pairwise(logged[-200:])), default=1)
    places: dict[Row, list[int]] = {}
    for n, row in enumerate(taken):
        places.setdefault(row, []).append(n)
    at, lost, torn = -1, 0, 0
    for row in published:
        following = [n for n in places.get(row, []) if n > at]
        if not following:
            torn += 1
            continue
        if at >= 0:
            lost += round((logged[following[0]][0] - logged[at][0]) / period) - 1
        at = following[0]
    return lost, torn
