"""The unscented Kalman filter (UKF), and the KUKF of Yamagishi and Jing.

"The Unscented Kalman Filter with Reduced Computation Time for Estimating the Attitude of the
Attitude and Heading Reference System", 2024. Beside the points
x ± √(n+λ) sᵢ there is the centre, x itself. Sums are taken about what the centre gives, where its
weights λ/(n+λ), of which nearly all cancels, drop out: with k = 1 − α² + β, and δ the mean,

    Σ Wᵢ (zᵢ − ẑ)(zᵢ − ẑ)ᵀ = W Σ (zᵢ − z₀)(zᵢ − z₀)ᵀ + (k − 1) δ δᵀ,   ẑ = z₀ + δ.
"""

from __future__ import annotations

from ..rotor import Rotor, product
from .cubature import (
    AXES,
    NO_SUMS,
    POINTS,
    centred,
    gathered,
    gathered_pair,
    measured,
    turned_columns,
)
from .kalman import Model, drift, observed
from .linear import (
    ZERO,
    ZEROS,
    Matrix,
    Six,
    added,
    between,
    cholesky,
    minus,
    plus,
    plus_square,
    scaled,
    times,
    transposed,
)

ALPHA, BETA = 0.1, 2.0  # the paper's α is lost; it does not matter. κ = 0, n = 4
NEAR = ALPHA  # √(n + λ) = α √n, in units of the cubature's 2
WEIGHT = 1.0 / (8.0 * ALPHA * ALPHA)
REST = ALPHA * ALPHA - BETA  # 1 − k


def ukf(x: Rotor, p: Matrix, model: Model) -> tuple[Rotor, Matrix]:
    """Unscented: mean and covariance of nine points, each of which is turned."""
    root = transposed(cholesky(p))
    centre = product(x, model.turn)
    z0 = observed(centre, model.north, model.vertical)
    total, squares, sums = ZERO, ZEROS, NO_SUMS
    for xi in POINTS:
        q = product(plus(scaled(NEAR, times(root, xi)), x), model.turn)
        z = observed(q, model.north, model.vertical)
        q = minus(q, centre)
        total, squares = plus(total, q), plus_square(squares, 1.0, q)
        sums = gathered(sums, q, minus6(z, z0))
    mean = scaled(WEIGHT, total)
    a, b, c, d = squares
    p = (scaled(WEIGHT, a), scaled(WEIGHT, b), scaled(WEIGHT, c), scaled(WEIGHT, d))
    x = plus(centre, mean)
    p = added(plus_square(p, -REST, mean), drift(x, model.gyro))
    return measured(x, p, centred(sums, WEIGHT, REST, mean, z0, model), model)


def kukf(x: Rotor, p: Matrix, model: Model) -> tuple[Rotor, Matrix]:
    """Kaisoku unscented: the same, turning x and the columns of the root as the KCKF does."""
    root = transposed(turned_columns(p, model.turn))
    x = product(x, model.turn)
    p = added(between(root, root), drift(x, model.gyro))
    z0 = observed(x, model.north, model.vertical)
    sums = NO_SUMS
    for xi in AXES:
        d = scaled(NEAR, times(root, xi))
        u = observed(plus(x, d), model.north, model.vertical)
        v = observed(minus(x, d), model.north, model.vertical)
        sums = gathered_pair(sums, d, minus6(u, z0), minus6(v, z0))
    return measured(x, p, centred(sums, WEIGHT, REST, ZERO, z0, model), model)


def minus6(u: Six, v: Six) -> Six:
    """Difference."""
    return (u[0] - v[0], u[1] - v[1], u[2] - v[2], u[3] - v[3], u[4] - v[4], u[5] - v[5])
