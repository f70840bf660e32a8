"""Rotors: quaternion algebra, the stateful rotor, axis and angle.

A rotor ``(w, x, y, z)`` is a Hamilton quaternion, scalar first, that turns the sensor frame into
the earth frame: ``v_earth = q v_sensor q*``. Equation numbers are those of T. Kusaka and
T. Tanaka, "Stateful Rotor for Continuity of Quaternion and Fast Sensor Fusion Algorithm Using
9-Axis Sensors", Sensors 22 (2022) 7989.

Everything here is floats in, floats out, so that the same source runs in plain Python for one
sample and compiled for a whole recording.
"""

from __future__ import annotations

import math

Rotor = tuple[float, float, float, float]
Vector = tuple[float, float, float]

IDENTITY: Rotor = (1.0, 0.0, 0.0, 0.0)
BETA = 0.351  # of eq. 19
COARSE = math.cos(math.radians(6.0) / 2.0)


def dot(p: Rotor, q: Rotor) -> float:
    """Inner product: how near two rotors are, with their signs (eq. 3)."""
    pw, px, py, pz = p
    qw, qx, qy, qz = q
    return pw * qw + px * qx + py * qy + pz * qz


def negative(q: Rotor) -> Rotor:
    """The other rotor of the same attitude."""
    return (-q[0], -q[1], -q[2], -q[3])


def conjugate(q: Rotor) -> Rotor:
    """The inverse of a unit rotor: earth → sensor."""
    return (q[0], -q[1], -q[2], -q[3])


def product(p: Rotor, q: Rotor) -> Rotor:
    """Hamilton product ``p q``: first ``q``, then ``p``."""
    pw, px, py, pz = p
    qw, qx, qy, qz = q
    return (
        pw * qw - px * qx - py * qy - pz * qz,
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
    )


def rotate(q: Rotor, v: Vector) -> Vector:
    """``q v q*`` (eq. 2) for a unit rotor: sensor → earth."""
    w, x, y, z = q
    vx, vy, vz = v
    tx = 2.0 * (y * vz - z * vy)
    ty = 2.0 * (z * vx - x * vz)
    tz = 2.0 * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )


def carried(q: Rotor, v: Vector) -> Vector:
    """``q* v q`` for a unit rotor: earth → sensor; what stands still, as a turn leaves it."""
    w, x, y, z = q
    vx, vy, vz = v
    tx = 2.0 * (z * vy - y * vz)
    ty = 2.0 * (x * vz - z * vx)
    tz = 2.0 * (y * vx - x * vy)
    return (
        vx + w * tx + z * ty - y * tz,
        vy + w * ty + x * tz - z * tx,
        vz + w * tz + y * tx - x * ty,
    )


def slightly(q: Rotor, v: Vector) -> Vector:
    """`rotate` by a rotor that is nearly one: to first order where it turns by less than 0.5°."""
    w, x, y, z = q
    if not 0.99999 < w < 1.00001:
        return rotate(unit(q), v)
    vx, vy, vz = v
    x, y, z = 2.0 * x, 2.0 * y, 2.0 * z
    return (vx + y * vz - z * vy, vy + z * vx - x * vz, vz + x * vy - y * vx)


def minus(u: Vector, v: Vector) -> Vector:
    """Difference of two vectors."""
    ux, uy, uz = u
    vx, vy, vz = v
    return (ux - vx, uy - vy, uz - vz)


def total(u: Vector, v: Vector) -> Vector:
    """Sum of two vectors."""
    return (u[0] + v[0], u[1] + v[1], u[2] + v[2])


def unit(q: Rotor) -> Rotor:
    """The rotor of length one in the same direction; the length must not be zero."""
    w, x, y, z = q
    s = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    return (w * s, x * s, y * s, z * s)


def blend(p: Rotor, q: Rotor, weight: float) -> Rotor:
    """``weight p + (1 − weight) q``, element by element (eq. 15); not normalised."""
    rest = 1.0 - weight
    pw, px, py, pz = p
    qw, qx, qy, qz = q
    return (
        weight * pw + rest * qw,
        weight * px + rest * qx,
        weight * py + rest * qy,
        weight * pz + rest * qz,
    )


def follow(q: Rotor, state: Rotor) -> Rotor:
    """Pick the sign of ``q`` that continues ``state`` (eq. 3–4): the stateful rotor.

    ``q`` and ``-q`` are the same attitude; the stateful rotor is the one nearer to the last.
    """
    return q if dot(q, state) >= 0.0 else negative(q)


def from_rate(rate: Vector, dt: float) -> Rotor:
    """The turn that a gyroscope saw: ``rate`` (rad/s, sensor frame) held for ``dt`` s (eq. 12).

    Eq. 12 approximates to second order. A turn above 0.2 rad in one step, as across a gap
    between samples, takes the exact eq. 11 instead.
    """
    h = 0.5 * dt
    x, y, z = rate
    x, y, z = h * x, h * y, h * z
    square = x * x + y * y + z * z
    if square > 0.01:
        half = math.sqrt(square)
        s = math.sin(half) / half
        return (math.cos(half), s * x, s * y, s * z)
    return (1.0 - 0.5 * square, x, y, z)


def from_axis_angle(axis: Vector, angle: float) -> Rotor:
    """The rotor that turns by ``angle`` rad about the unit vector ``axis`` (eq. 1)."""
    s = math.sin(0.5 * angle)
    return (math.cos(0.5 * angle), s * axis[0], s * axis[1], s * axis[2])


def angle(q: Rotor) -> float:
    """Angle of a unit rotor in [0, 2π] rad (eq. 17).

    The arccosine is taken through atan2, which keeps full precision at small angles too.
    """
    return 2.0 * math.atan2(math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]), q[0])


def fast_angle(q: Rotor) -> float:
    """Angle of a unit rotor in [0, 2π] rad by square roots alone (eq. 19), within 0.492°."""
    w = min(1.0, max(-1.0, q[0]))
    if w >= 0.0:
        return (math.pi - BETA * w) * math.sqrt(1.0 - w)
    return 2.0 * math.pi - (math.pi + BETA * w) * math.sqrt(1.0 + w)


def axis(q: Rotor, last: Vector = (0.0, 0.0, 1.0)) -> Vector:
    """Unit axis of a rotor (eq. 18); ``last`` where the rotor is ±1 and has none."""
    length = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if length < 1e-12:
        return last
    return (q[1] / length, q[2] / length, q[3] / length)


class Turn:
    """Axis and angle that continue from sample to sample: two turns are 4π, not 0.

    Eq. 17–18 jump where a rotor passes a whole turn: the axis turns round and the angle comes
    back. Here the axis keeps its direction and the angle runs on, over any number of turns.

    No real motion passes a whole turn exactly, and near one the axis is lost in noise. So within
    `NEAR` of a whole turn the axis has inertia (it follows the rotor's axis by the way travelled,
    not by time) and the angle is that about this axis: a pass up to about 10° beside a whole turn
    still counts. After a stop at a whole turn, where every axis is as good as another, a new axis
    takes the sign with which the angle goes on growing.
    """

    NEAR = 0.35  # of |sin(angle/2)|: within 41° of a whole turn
    STEP = 0.02  # of the same: motion below it is taken for noise
    PULL = 3.0

    def __init__(self) -> None:
        self.axis: Vector = (0.0, 0.0, 1.0)
        self.angle = 0.0
        self._has_axis = False
        self._rotor: Rotor = (0.0, 0.0, 0.0, 0.0)
        self._last: Vector = (0.0, 0.0, 0.0)

    def update(self, q: Rotor, coarse: bool = False) -> float:
        """Take the next unit rotor, sign-continuous with the last; return the angle in rad.

        ``coarse`` passes over motion below 6°: it keeps the count at next to no cost.
        """
        w, x, y, z = q
        p, i, j, k = self._rotor
        if coarse and w * p + x * i + y * j + z * k > COARSE:
            return self.angle
        self._rotor = q
        length = math.sqrt(x * x + y * y + z * z)
        if not self._has_axis:  # since the start nothing but rest and small motion: eq. 17–18
            self._has_axis = length >= self.NEAR
            self.axis = axis(q)
            self.angle = angle(q)
            self._last = (x, y, z)
            return self.angle
        if length >= self.NEAR:
            self._turn_axis(q, length, 1.0)
        elif (way := math.dist((x, y, z), self._last)) > self.STEP:
            self._turn_axis(q, length, min(1.0, self.PULL * way * length / self.NEAR**2))
        along = x * self.axis[0] + y * self.axis[1] + z * self.axis[2]
        now = 2.0 * math.atan2(along, w)
        self.angle = now + 4.0 * math.pi * round((self.angle - now) / (4.0 * math.pi))
        return self.angle

    def _turn_axis(self, q: Rotor, length: float, weight: float) -> None:
        """Turn the axis towards that of ``q``, or its opposite, whichever continues it."""
        w, x, y, z = q
        nx, ny, nz = self.axis
        along = x * nx + y * ny + z * nz
        sign = math.copysign(1.0, along)
        if length < self.NEAR and abs(along) < 0.5 * length:
            sign = math.copysign(1.0, w * self.angle)
        to, rest = sign * weight / length, 1.0 - weight
        self.axis = axis((0.0, rest * nx + to * x, rest * ny + to * y, rest * nz + to * z))
        self._last = (x, y, z)


def euler(q: Rotor) -> Vector:
    """Roll, pitch and yaw in rad of a unit rotor (REP-103: fixed axes x, y, z; yaw last)."""
    w, x, y, z = q
    sin_pitch = min(1.0, max(-1.0, 2.0 * (w * y - z * x)))
    return (
        math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        math.asin(sin_pitch),
        math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )


def difference(p: Rotor, q: Rotor) -> float:
    """Angle in [0, π] rad between two attitudes, whatever the signs of their rotors."""
    w, x, y, z = product(p, conjugate(q))
    return 2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), abs(w))
