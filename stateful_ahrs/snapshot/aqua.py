"""The algebraic quaternion algorithm of Valenti, Dryanovski and Xiao (AQUA, 2015).

The rotor is a product of one that brings gravity to the vertical and one about the vertical that
brings the field to north. The authors' are earth → sensor; this is the conjugate, and the earth
frame is north-west-up.

Singular set: each of the two formulas has one (gravity turned by 180°, the field by 180°), and
gives way to a second formula before it comes near, so that no attitude is left without a rotor.
"""

from __future__ import annotations

import math

from ..rotor import Rotor, Vector, conjugate, product, rotate
from .directions import directions


def aqua(accel: Vector, mag: Vector) -> tuple[bool, Rotor]:
    """Rotor from specific force and magnetic field, of any length, in the sensor frame.

    Returns whether there is one, and the rotor sensor → earth (NWU); the identity where there
    is none, as in `dcm`.
    """
    found, a, m, _, _ = directions(accel, mag)
    if not found:
        return False, (1.0, 0.0, 0.0, 0.0)
    ax, ay, az = a
    if az >= 0.0:
        k = math.sqrt(0.5 + 0.5 * az)
        level: Rotor = (k, -ay / (2.0 * k), ax / (2.0 * k), 0.0)
    else:
        k = math.sqrt(0.5 - 0.5 * az)
        level = (-ay / (2.0 * k), k, 0.0, ax / (2.0 * k))
    hx, hy, _ = rotate(conjugate(level), m)
    square = hx * hx + hy * hy
    length = math.sqrt(square)
    if hx >= 0.0:
        k = math.sqrt(square + hx * length)
        heading: Rotor = (k / math.sqrt(2.0 * square), 0.0, 0.0, hy / (math.sqrt(2.0) * k))
    else:
        k = math.sqrt(square - hx * length)
        heading = (hy / (math.sqrt(2.0) * k), 0.0, 0.0, k / math.sqrt(2.0 * square))
    return True, conjugate(product(level, heading))
