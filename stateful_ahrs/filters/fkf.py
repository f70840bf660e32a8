"""The fast Kalman filter of Guo et al. (FKF), and what it shares with the GDALKF.

"Novel MARG-Sensor Orientation Estimation Algorithm Using Fast Kalman Filter", Journal of Sensors,
2017. Accelerometer and magnetometer make one rotor y out of another, and a linear Kalman filter
takes y for its measurement.

Deviation: the paper makes y out of the last rotor, which is late by the turn of a step; here it is
made out of the predicted one.
"""

from __future__ import annotations

import math

from ..rotor import Rotor, Vector, dot, product
from .kalman import Model, drift, north_rows, up_rows
from .linear import (
    Four,
    Matrix,
    added,
    explained4,
    minus,
    mixed,
    plus,
    plus_square,
    plus_times,
    scaled,
    subtracted,
    turned,
)

Three = tuple[Four, Four, Four]

T = 1e-12  # the measured rotor's covariance has not full rank
TINY: Matrix = ((T, 0.0, 0.0, 0.0), (0.0, T, 0.0, 0.0), (0.0, 0.0, T, 0.0), (0.0, 0.0, 0.0, T))


def fkf(x: Rotor, p: Matrix, model: Model) -> tuple[Rotor, Matrix]:
    """Take for measured y = ¼ (I + W_z(a)) (I + m_N W_x(m) + m_D W_z(m)) x, normalised."""
    x, p = predicted(x, p, model)
    up, north = up_rows(x), north_rows(x)
    seen = mixed(model.north, along(north, model.field), model.vertical, along(up, model.field))
    u = plus(x, seen)
    y = plus(u, along(up_rows(u), model.up))
    noise = squares(TINY, model.accel / 16.0, up_rows(u))
    columns = (
        shown(north[0], up[0], model),
        shown(north[1], up[1], model),
        shown(north[2], up[2], model),
    )
    noise = squares(noise, model.mag / 16.0, columns)
    return corrected(x, p, scaled(1.0 / math.sqrt(dot(y, y)), y), noise)


def shown(north: Four, up: Four, model: Model) -> Four:
    """4 ∂y/∂m of one of the field's elements, given the columns of ∂(W_x x) and ∂(W_z x)."""
    v = mixed(model.north, north, model.vertical, up)
    return plus(v, along(up_rows(v), model.up))


def along(columns: Three, v: Vector) -> Four:
    """W(v) x, from the columns of its derivative by v."""
    a, b, c = columns
    return plus_times(mixed(v[0], a, v[1], b), v[2], c)


def squares(m: Matrix, s: float, columns: Three) -> Matrix:
    """``m`` and ``s`` times the square of each column."""
    a, b, c = columns
    return plus_square(plus_square(plus_square(m, s, a), s, b), s, c)


def predicted(x: Rotor, p: Matrix, model: Model) -> tuple[Rotor, Matrix]:
    """What the gyroscope makes of the state."""
    x = product(x, model.turn)
    return x, added(turned(p, model.turn), drift(x, model.gyro))


def corrected(x: Rotor, p: Matrix, y: Four, noise: Matrix) -> tuple[Rotor, Matrix]:
    """Correct the state by a measured rotor y, H = I, with the covariance ``noise``."""
    less, by = explained4(added(p, noise), p, minus(y, x))
    return plus(x, by), subtracted(p, less)
