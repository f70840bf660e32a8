"""The direction-cosine snapshot of Kusaka and Tanaka (eq. 5–10), known as TRIAD.

The earth frame is north-west-up. No attitude is singular; only a magnetic field along gravity,
which has no north, is.
"""

from __future__ import annotations

import math

from ..rotor import IDENTITY, Rotor, Vector

# Below this sine of the angle between field and gravity (0.06°) there is no north to be had.
PARALLEL = 1e-3


def dcm(accel: Vector, mag: Vector) -> tuple[bool, Rotor]:
    """Rotor from specific force and magnetic field, of any length, in the sensor frame.

    Returns whether there is one, and the rotor sensor → earth (NWU). There is none where a
    vector is zero, not finite, or absurdly long, or where the two are parallel; the rotor is
    then the identity.
    """
    ax, ay, az = accel
    mx, my, mz = mag
    square = ax * ax + ay * ay + az * az
    field = mx * mx + my * my + mz * mz
    if not (1e-24 < square < 1e24 and 1e-24 < field < 1e24):
        return False, IDENTITY
    cx, cy, cz = ay * mz - az * my, az * mx - ax * mz, ax * my - ay * mx
    across = cx * cx + cy * cy + cz * cz
    if not across > PARALLEL * PARALLEL * square * field:
        return False, IDENTITY
    a, c = math.sqrt(square), math.sqrt(across)
    one = a * c  # in units of which the three columns of eq. 5 are of length one
    mx, my, mz = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax  # north
    cx, cy, cz = a * cx, a * cy, a * cz  # west
    ax, ay, az = c * ax, c * ay, c * az  # up
    return True, from_columns(one, (mx, my, mz), (cx, cy, cz), (ax, ay, az))


def from_columns(one: float, north: Vector, west: Vector, up: Vector) -> Rotor:
    """Rotor sensor → earth from the earth's axes in the sensor frame, ``one`` long (eq. 6–10)."""
    (mx, my, mz), (cx, cy, cz), (ax, ay, az) = north, west, up
    more, less, both, apart = one + mx, one - mx, cy + az, cy - az
    d0, d1, d2, d3 = more + both, more - both, less + apart, less - apart  # eq. 7
    largest = max(d0, d1, d2, d3)
    s = 0.5 / math.sqrt(largest * one)  # eq. 9, with the columns of eq. 6 and 8
    if largest == d0:
        return (s * d0, s * (ay - cz), s * (mz - ax), s * (cx - my))
    if largest == d1:
        return (s * (ay - cz), s * d1, s * (cx + my), s * (mz + ax))
    if largest == d2:
        return (s * (mz - ax), s * (cx + my), s * d2, s * (ay + cz))
    return (s * (cx - my), s * (mz + ax), s * (ay + cz), s * d3)
