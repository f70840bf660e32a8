"""The gradient-descent linear Kalman filter of Wu et al. (RMr-GDALKF), with recursive reference.

"MARG Attitude Estimation Using Gradient-Descent Linear Kalman Filter", IEEE Transactions on
Automation Science and Engineering 17(4), 2020.
One step of descent on both vectors makes one rotor y out of another, and the linear Kalman filter
of `fkf` takes y for its measurement. The magnetic reference is what that rotor makes of the field.

Deviations: as in `fkf`, y is made out of the predicted rotor and not of the last. In the published
code, rows 2–4 of the derivative of m_D have wrong signs and entries; here it is the derivative.
"""

from __future__ import annotations

import math

from ..rotor import Rotor, Vector, conjugate, rotate
from .fkf import TINY, Three, along, corrected, predicted, squares
from .kalman import FAR, Model, north_rows, up_rows
from .linear import Matrix, mixed, plus, plus_square
from .senses import UP

WEIGHT = 0.8  # of one of the two vectors in Wahba's problem
SHARED = WEIGHT * (1.0 - WEIGHT)
FLAT = 1e-6  # of m_N, below which there is no north


def gdalkf(x: Rotor, p: Matrix, model: Model) -> tuple[Rotor, Matrix]:
    """Take for measured y = x + μ K̃ x, K̃ = 2 (W_z(a) + m_N W_x(m) + m_D W_z(m)) − 4 I."""
    x, p = predicted(x, p, model)
    field = model.field
    h = rotate(x, field)
    north, vertical = math.sqrt(h[0] * h[0] + h[1] * h[1]), h[2]
    gain = step_size(model.up, field, north, vertical)
    about_up = up_rows(x)
    seen = mixed(north, along(north_rows(x), field), vertical, along(about_up, field))
    k = plus(along(about_up, model.up), seen)
    y = mixed(1.0 - 4.0 * gain, x, 2.0 * gain, k)
    s = 4.0 * gain * gain
    noise = squares(TINY, s * model.accel, about_up)
    if model.mag < FAR:
        noise = squares(noise, s * model.mag, by_north(x, field, h, north))
        noise = squares(noise, s * model.mag, by_vertical(x, field, vertical))
    else:  # nothing is known of heading, the turn about the vertical
        noise = plus_square(noise, FAR, (-x[3], -x[2], x[1], x[0]))
    return corrected(x, p, y, noise)


def by_north(x: Rotor, field: Vector, h: Vector, north: float) -> Three:
    """The columns of ∂(m_N W_x x)/∂m, h being the field in the earth frame."""
    a, b, c = north_rows(x)
    seen = along((a, b, c), field)
    i = 1.0 / max(north, FLAT)
    u = rotate(conjugate(x), (i * h[0], i * h[1], 0.0))  # ∂m_N/∂m
    return mixed(north, a, u[0], seen), mixed(north, b, u[1], seen), mixed(north, c, u[2], seen)


def by_vertical(x: Rotor, field: Vector, vertical: float) -> Three:
    """The columns of ∂(m_D W_z x)/∂m."""
    a, b, c = up_rows(x)
    seen = along((a, b, c), field)
    u = rotate(conjugate(x), UP)  # ∂m_D/∂m
    return (
        mixed(vertical, a, u[0], seen),
        mixed(vertical, b, u[1], seen),
        mixed(vertical, c, u[2], seen),
    )


def step_size(up: Vector, field: Vector, north: float, vertical: float) -> float:
    """The adaptive μ, from how far the angle of the two vectors is that of their references.

    (1 − √((1−g)² + g² + 2g(1−g)s)) / (4 − 2√(2 + 2s)), s being the cosine of the difference, in a
    form that is not 0/0 at s = 1.
    """
    cosine = up[0] * field[0] + up[1] * field[1] + up[2] * field[2]
    s = cosine * vertical + north * math.sqrt(max(0.0, 1.0 - cosine * cosine))
    short = max(0.0, 1.0 - s)
    return (
        SHARED
        * (1.0 + math.sqrt(1.0 - 0.5 * short))
        / (1.0 + math.sqrt(1.0 - 2.0 * SHARED * short))
    )
