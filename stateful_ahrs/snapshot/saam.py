"""The super-fast attitude of Wu, Zhou, Fourati and Cheng (SAAM, 2018, eq. 16–18).

The earth frame is north-west-up. The paper calls it north-east-down, but takes (0, 0, 1) for the
accelerometer's reference, which reads +g upwards.

Singular set: SAAM is one column of the `dcm` snapshot (−m_N M₁ of Kusaka and Tanaka's eq. 6),
whatever the attitude. All of it is proportional to ``x``, so it vanishes on the whole surface
``x = 0``: level at any yaw, facing north at any pitch, and so on. Near it the rounding errors are
1/|x| times as large. Its rotor always has ``x ≤ 0``.
"""

from __future__ import annotations

import math

from ..rotor import Rotor, Vector
from .directions import directions

SINGULAR = 1e-6  # of |q̃| = 4 m_N |x|; rounding turns the rotor by 1e-8 rad there


def saam(accel: Vector, mag: Vector) -> tuple[bool, Rotor]:
    """Rotor from specific force and magnetic field, of any length, in the sensor frame.

    Returns whether there is one, and the rotor sensor → earth (NWU); the identity where there
    is none, as in `dcm`, and on the singular set.
    """
    found, a, m, north, vertical = directions(accel, mag)
    if not found:
        return False, (1.0, 0.0, 0.0, 0.0)
    ax, ay, az = a
    mx, my, mz = m
    x = (az - 1.0) * (north + mx) + ax * (vertical - mz)
    y = (az - 1.0) * my + ay * (vertical - mz)
    z = az * vertical - ax * north - mz
    w = ax * my - ay * (north + mx)
    square = w * w + x * x + y * y + z * z
    if not square > SINGULAR * SINGULAR:
        return False, (1.0, 0.0, 0.0, 0.0)
    s = 1.0 / math.sqrt(square)
    return True, (s * w, s * x, s * y, s * z)
