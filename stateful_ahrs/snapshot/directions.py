"""What every snapshot but the `dcm` needs first: the two measurements as directions."""

from __future__ import annotations

import math

from ..rotor import Vector
from .dcm import PARALLEL

NONE: Vector = (0.0, 0.0, 0.0)


def directions(accel: Vector, mag: Vector) -> tuple[bool, Vector, Vector, float, float]:
    """Unit vectors of specific force and magnetic field, and the field in the earth frame.

    Returns whether they determine an attitude, the two, and the horizontal and vertical parts
    ``m_N ≥ 0`` and ``m_D`` of the unit field (Wu et al., eq. 12), vertical being up. They do not
    where one is zero, not finite, or absurdly long, or where they are parallel.
    """
    ax, ay, az = accel
    mx, my, mz = mag
    force = ax * ax + ay * ay + az * az
    field = mx * mx + my * my + mz * mz
    if not (1e-24 < force < 1e24 and 1e-24 < field < 1e24):
        return False, NONE, NONE, 0.0, 0.0
    s = 1.0 / math.sqrt(force)
    ax, ay, az = s * ax, s * ay, s * az
    s = 1.0 / math.sqrt(field)
    mx, my, mz = s * mx, s * my, s * mz
    north, vertical = reference((ax, ay, az), (mx, my, mz))
    if not north > PARALLEL:
        return False, NONE, NONE, 0.0, 0.0
    return True, (ax, ay, az), (mx, my, mz), north, vertical


def reference(up: Vector, field: Vector) -> tuple[float, float]:
    """``m_N ≥ 0`` and ``m_D`` of a unit field, given the unit vector that is up."""
    vertical = up[0] * field[0] + up[1] * field[1] + up[2] * field[2]
    return math.sqrt(max(0.0, 1.0 - vertical * vertical)), vertical
