"""The factored quaternion algorithm of Yun, Bachmann and McGhee (FQA, 2008).

The rotor is a product of elevation, roll and azimuth, each from half-angle formulas. FQA's earth
frame is north-east-down; half a turn about north makes it north-west-up.

Singular set: where the x axis is vertical, elevation is ±90° and roll is undefined. Near it, as
the authors say, the measurements are turned by a fixed angle about y first and the rotor back
afterwards, so that no attitude is left without a rotor.
"""

from __future__ import annotations

import math

from ..rotor import Rotor, Vector, product, rotate
from .dcm import PARALLEL
from .directions import directions

STEEP = 0.1  # cosine of the elevation below which the measurements are turned first
OFFSET = math.radians(20.0)
ASIDE: Rotor = (math.cos(OFFSET / 2.0), 0.0, math.sin(OFFSET / 2.0), 0.0)


def fqa(accel: Vector, mag: Vector) -> tuple[bool, Rotor]:
    """Rotor from specific force and magnetic field, of any length, in the sensor frame.

    Returns whether there is one, and the rotor sensor → earth (NWU); the identity where there
    is none, as in `dcm`.
    """
    found, a, m, _, _ = directions(accel, mag)
    if not found:
        return False, (1.0, 0.0, 0.0, 0.0)
    if 1.0 - a[0] * a[0] < STEEP * STEEP:
        return True, product(_north_west_up(rotate(ASIDE, a), rotate(ASIDE, m)), ASIDE)
    return True, _north_west_up(a, m)


def _north_west_up(a: Vector, m: Vector) -> Rotor:
    cos_elevation = math.sqrt(1.0 - a[0] * a[0])
    w, y = half_angle(cos_elevation, a[0])
    elevation = (w, 0.0, y, 0.0)
    w, x = half_angle(-a[2] / cos_elevation, -a[1] / cos_elevation)
    level = product(elevation, (w, x, 0.0, 0.0))
    hx, hy, _ = rotate(level, m)
    horizontal = math.sqrt(hx * hx + hy * hy)
    if not horizontal > 0.0:
        horizontal = PARALLEL
    w, z = half_angle(hx / horizontal, -hy / horizontal)
    w, x, y, z = product((w, 0.0, 0.0, z), level)
    return (-x, w, -z, y)  # half a turn about north: the product of (0, 1, 0, 0) and NED's


def half_angle(cosine: float, sine: float) -> tuple[float, float]:
    """Cosine and sine of half an angle in (−π, π].

    The smaller of √((1 ± cosine)/2) comes from the sine instead, which does not cancel.
    """
    if cosine >= 0.0:
        half = math.sqrt(0.5 + 0.5 * min(cosine, 1.0))
        return half, 0.5 * sine / half
    half = math.sqrt(0.5 + 0.5 * min(-cosine, 1.0))
    if sine < 0.0:
        half = -half
    return 0.5 * sine / half, half
