"""The optimal two-vector rotor of Markley (2002), for equal weights.

F. L. Markley, "Fast Quaternion Attitude Estimation from Two Vector Measurements", Journal of
Guidance, Control, and Dynamics 25(2). The earth frame is north-west-up. The references are up and
a field whose dip is the measured one, with which any weights give the same rotor.

Singular set: the formula divides by 1 + d, which vanishes where the normals of measured and
reference vectors are opposite. There the references are turned by half a turn about north first
and the rotor back afterwards, so that no attitude is left without a rotor.
"""

from __future__ import annotations

import math

from ..rotor import Rotor, Vector
from .directions import directions


def markley(accel: Vector, mag: Vector) -> tuple[bool, Rotor]:
    """Rotor from specific force and magnetic field, of any length, in the sensor frame.

    Returns whether there is one, and the rotor sensor → earth (NWU); the identity where there
    is none, as in `dcm`.
    """
    found, a, m, north, vertical = directions(accel, mag)
    if not found:
        return False, (1.0, 0.0, 0.0, 0.0)
    normal = cross(a, m)
    s = 1.0 / math.sqrt(inner(normal, normal))
    normal = (s * normal[0], s * normal[1], s * normal[2])
    if normal[1] < -0.5:
        w, x, y, z = _two_vectors(a, m, normal, north, -1.0, -vertical)
        return True, (-x, w, -z, y)
    return True, _two_vectors(a, m, normal, north, 1.0, vertical)


def _two_vectors(
    a: Vector, m: Vector, normal: Vector, north: float, up: float, vertical: float
) -> Rotor:
    """Sensor → the frame in which gravity is (0, 0, up) and the field (north, 0, vertical)."""
    reference = (0.0, up, 0.0)  # unit normal of the two
    d = inner(normal, reference)
    u = add(cross(a, (0.0, 0.0, up)), cross(m, (north, 0.0, vertical)))
    over = cross(normal, reference)
    both = add(normal, reference)
    mu = (1.0 + d) * (up * a[2] + north * m[0] + vertical * m[2]) + inner(over, u)
    nu = inner(both, u)
    rho = math.sqrt(mu * mu + nu * nu)
    if mu >= 0.0:
        first, second = rho + mu, nu
        s = 1.0 / (2.0 * math.sqrt(rho * first * (1.0 + d)))
    else:
        first, second = nu, rho - mu
        s = 1.0 / (2.0 * math.sqrt(rho * second * (1.0 + d)))
    return (
        s * first * (1.0 + d),
        s * (first * over[0] + second * both[0]),
        s * (first * over[1] + second * both[1]),
        s * (first * over[2] + second * both[2]),
    )


def inner(u: Vector, v: Vector) -> float:
    """Inner product."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def cross(u: Vector, v: Vector) -> Vector:
    """Cross product."""
    return (
        u[1] * v[2] - u[2] * v[1],
        u[2] * v[0] - u[0] * v[2],
        u[0] * v[1] - u[1] * v[0],
    )


def add(u: Vector, v: Vector) -> Vector:
    """Sum."""
    return (u[0] + v[0], u[1] + v[1], u[2] + v[2])
