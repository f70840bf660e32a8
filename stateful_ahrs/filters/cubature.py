"""The cubature Kalman filter (CKF), the KCKF of Yamagishi and Jing, and one without points.

Cubature replaces integrals over the state by means over eight points S ξᵢ + x, where S Sᵀ = P and
ξᵢ are ± 2 times the axes. KCKF (eq. 16–19) gives the same result as the CKF (eq. 20–23) with fewer
operations: its points need not be turned, because the columns of the root were.

`point_free` is in none of the papers. h is quadratic, so its means over the points have closed
forms: with dᵢ the turned columns of S, s = Σ h(dᵢ), and H the Jacobian of h at the predicted x,

    ẑ = h(x) + s,   P_xz = D Dᵀ Hᵀ,   P_zz = H D Dᵀ Hᵀ + 4 Σ h(dᵢ) h(dᵢ)ᵀ − s sᵀ + R.

It is taken in the earth frame, where dᵢ = εᵢ ⊗ x. There the gyroscope, which turns on the right,
leaves the errors alone (εᵢ = sᵢ ⊗ q* with the last rotor q), and H is the same at every attitude.
"""

from __future__ import annotations

from ..rotor import Rotor, product, rotate
from .kalman import Model, drift, innovation, observed
from .linear import (
    ZERO,
    ZEROS,
    Four,
    Matrix,
    Row,
    Rows,
    Six,
    added,
    between,
    cholesky,
    explained,
    minus,
    mixed,
    more,
    plus,
    plus_square,
    plus_times,
    scaled,
    subtracted,
    times,
    transposed,
    turned,
)

A = 2.0
AXES = ((A, 0.0, 0.0, 0.0), (0.0, A, 0.0, 0.0), (0.0, 0.0, A, 0.0), (0.0, 0.0, 0.0, A))
OPPOSITES = ((-A, 0.0, 0.0, 0.0), (0.0, -A, 0.0, 0.0), (0.0, 0.0, -A, 0.0), (0.0, 0.0, 0.0, -A))
POINTS = AXES + OPPOSITES  # ξᵢ
WEIGHT = 0.125  # of each

NONE: Row = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
NO_SUMS: Rows = (NONE, NONE, NONE, NONE, NONE, NONE)
ORIGIN: Six = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def ckf(x: Rotor, p: Matrix, model: Model) -> tuple[Rotor, Matrix]:
    """Cubature: mean and covariance of the points, each of which is turned (eq. 20–23)."""
    root = transposed(cholesky(p))
    total, squares, sums = ZERO, ZEROS, NO_SUMS
    for xi in POINTS:
        q = product(plus(times(root, xi), x), model.turn)
        total, squares = plus(total, q), plus_square(squares, 1.0, q)
        sums = gathered(sums, q, observed(q, model.north, model.vertical))
    x = scaled(WEIGHT, total)
    a, b, c, d = squares
    p = (scaled(WEIGHT, a), scaled(WEIGHT, b), scaled(WEIGHT, c), scaled(WEIGHT, d))
    p = added(plus_square(p, -1.0, x), drift(x, model.gyro))
    return measured(x, p, centred(sums, WEIGHT, 1.0, x, ORIGIN, model), model)


def kckf(x: Rotor, p: Matrix, model: Model) -> tuple[Rotor, Matrix]:
    """Kaisoku cubature: x and the columns of the root are turned (eq. 16–19).

    Beyond the paper, the points are taken in pairs x ± A ξᵢ: for P_xz the differences of what
    the two see are enough.
    """
    root = transposed(turned_columns(p, model.turn))
    x = product(x, model.turn)
    p = added(between(root, root), drift(x, model.gyro))
    sums = NO_SUMS
    for xi in AXES:
        d = times(root, xi)
        sums = gathered_pair(
            sums,
            d,
            observed(plus(x, d), model.north, model.vertical),
            observed(minus(x, d), model.north, model.vertical),
        )
    return measured(x, p, centred(sums, WEIGHT, 1.0, ZERO, ORIGIN, model), model)


def turned_columns(p: Matrix, turn: Rotor) -> Matrix:
    """The columns of A = F S (eq. 16)."""
    a, b, c, d = cholesky(p)
    return (product(a, turn), product(b, turn), product(c, turn), product(d, turn))


def gathered(sums: Rows, q: Four, z: Six) -> Rows:
    """Add a point and what it sees to the rows of [Σ z zᵀ, Σ z qᵀ, Σ z]."""
    a, b, c, d, e, f = sums
    row = (z[0], z[1], z[2], z[3], z[4], z[5], q[0], q[1], q[2], q[3], 1.0)
    return (
        more(a, z[0], row),
        more(b, z[1], row),
        more(c, z[2], row),
        more(d, z[3], row),
        more(e, z[4], row),
        more(f, z[5], row),
    )


def gathered_pair(sums: Rows, d: Four, u: Six, v: Six) -> Rows:
    """Add the points x ± d, which see u and v, to the rows of [Σ z zᵀ, Σ z (q − x)ᵀ, Σ z]."""
    a, b, c, e, f, g = sums
    return (
        more_pair(a, d, u[0], u, v[0], v),
        more_pair(b, d, u[1], u, v[1], v),
        more_pair(c, d, u[2], u, v[2], v),
        more_pair(e, d, u[3], u, v[3], v),
        more_pair(f, d, u[4], u, v[4], v),
        more_pair(g, d, u[5], u, v[5], v),
    )


def more_pair(row: Row, d: Four, s: float, u: Six, t: float, v: Six) -> Row:
    """One row of `gathered_pair`."""
    w = s - t
    return (
        row[0] + s * u[0] + t * v[0],
        row[1] + s * u[1] + t * v[1],
        row[2] + s * u[2] + t * v[2],
        row[3] + s * u[3] + t * v[3],
        row[4] + s * u[4] + t * v[4],
        row[5] + s * u[5] + t * v[5],
        row[6] + w * d[0],
        row[7] + w * d[1],
        row[8] + w * d[2],
        row[9] + w * d[3],
        row[10] + s + t,
    )


def centred(sums: Rows, weight: float, rest: float, x: Four, centre: Six, model: Model) -> Rows:
    """The rows of [P_zz, P_zx, innovation], still without R, from sums about ``centre``.

    With δ and x the means of z and q about it: weight Σ z zᵀ − rest δ δᵀ, and so with q.
    """
    a, b, c, d, e, f = sums
    z = (
        weight * a[10],
        weight * b[10],
        weight * c[10],
        weight * d[10],
        weight * e[10],
        weight * f[10],
    )
    i = innovation(model, centre)
    return (
        about(a, weight, rest * z[0], z, x, i[0] - z[0]),
        about(b, weight, rest * z[1], z, x, i[1] - z[1]),
        about(c, weight, rest * z[2], z, x, i[2] - z[2]),
        about(d, weight, rest * z[3], z, x, i[3] - z[3]),
        about(e, weight, rest * z[4], z, x, i[4] - z[4]),
        about(f, weight, rest * z[5], z, x, i[5] - z[5]),
    )


def about(row: Row, weight: float, s: float, z: Six, x: Four, innovation: float) -> Row:
    """One row of `centred`."""
    return (
        weight * row[0] - s * z[0],
        weight * row[1] - s * z[1],
        weight * row[2] - s * z[2],
        weight * row[3] - s * z[3],
        weight * row[4] - s * z[4],
        weight * row[5] - s * z[5],
        weight * row[6] - s * x[0],
        weight * row[7] - s * x[1],
        weight * row[8] - s * x[2],
        weight * row[9] - s * x[3],
        innovation,
    )


def measured(x: Rotor, p: Matrix, rows: Rows, model: Model) -> tuple[Rotor, Matrix]:
    """Correct the state by the rows of [P_zz, P_zx, innovation], still without R."""
    less, by = explained(noisy(rows, model))
    return plus(x, by), subtracted(p, less)


def noisy(rows: Rows, model: Model) -> Rows:
    """Add R to P_zz, of which the upper triangle is kept."""
    a, b, c, d, e, f = rows
    r, s = model.accel, model.mag
    return (
        (a[0] + r, a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10]),
        (0.0, b[1] + r, b[2], b[3], b[4], b[5], b[6], b[7], b[8], b[9], b[10]),
        (0.0, 0.0, c[2] + r, c[3], c[4], c[5], c[6], c[7], c[8], c[9], c[10]),
        (0.0, 0.0, 0.0, d[3] + s, d[4], d[5], d[6], d[7], d[8], d[9], d[10]),
        (0.0, 0.0, 0.0, 0.0, e[4] + s, e[5], e[6], e[7], e[8], e[9], e[10]),
        (0.0, 0.0, 0.0, 0.0, 0.0, f[5] + s, f[6], f[7], f[8], f[9], f[10]),
    )


def point_free(x: Rotor, p: Matrix, model: Model) -> tuple[Rotor, Matrix]:
    """The CKF in closed form."""
    north, vertical = model.north, model.vertical
    a, b, c, d = errors(x, p)
    h, i = observed(a, north, vertical), observed(b, north, vertical)
    j, k = observed(c, north, vertical), observed(d, north, vertical)
    s, f = sum_and_difference(h, i, j, k)
    _, g = sum_and_difference(h, j, i, k)
    _, e = sum_and_difference(h, k, i, j)  # f fᵀ + g gᵀ + e eᵀ = 4 Σ h hᵀ − s sᵀ
    root = transposed((a, b, c, d))
    p = between(root, root)
    t, u = seen(p[0], north, vertical), seen(p[1], north, vertical)
    v, w = seen(p[2], north, vertical), seen(p[3], north, vertical)
    x = product(x, model.turn)
    up, field = rotate(x, model.up), rotate(x, model.field)
    rows = (
        row(model, (t[0], u[0], v[0], w[0]), f[0], f, g[0], g, e[0], e, up[0] - s[0]),
        row(model, (t[1], u[1], v[1], w[1]), f[1], f, g[1], g, e[1], e, up[1] - s[1]),
        row(model, (t[2], u[2], v[2], w[2]), f[2], f, g[2], g, e[2], e, up[2] - 1.0 - s[2]),
        row(model, (t[3], u[3], v[3], w[3]), f[3], f, g[3], g, e[3], e, field[0] - north - s[3]),
        row(model, (t[4], u[4], v[4], w[4]), f[4], f, g[4], g, e[4], e, field[1] - s[4]),
        row(model, (t[5], u[5], v[5], w[5]), f[5], f, g[5], g, e[5], e, field[2] - vertical - s[5]),
    )
    less, by = explained(noisy(rows, model))
    p = drifted(subtracted(p, less), model.gyro)
    return plus(x, product(by, x)), turned(p, x)


def errors(q: Rotor, p: Matrix) -> Matrix:
    """The columns sᵢ ⊗ q* of the root, errors in the earth frame; a triangle saves operations."""
    a, b, c, d = cholesky(p)
    w, x, y, z = q
    i, j, k = (x, w, z, -y), (y, -z, w, x), (z, y, -x, w)  # by q*
    return (
        plus_times(plus_times(mixed(a[0], (w, -x, -y, -z), a[1], i), a[2], j), a[3], k),
        plus_times(mixed(b[1], i, b[2], j), b[3], k),
        mixed(c[2], j, c[3], k),
        scaled(d[3], k),
    )


def drifted(p: Matrix, q: float) -> Matrix:
    """Add Q to a covariance of errors in the earth frame."""
    a, b, c, d = p
    return (
        a,
        (b[0], b[1] + q, b[2], b[3]),
        (c[0], c[1], c[2] + q, c[3]),
        (d[0], d[1], d[2], d[3] + q),
    )


def seen(error: Four, north: float, vertical: float) -> Six:
    """H: how an error of the rotor shows in up and field, all in the earth frame."""
    w, x, y, z = 2.0 * error[0], 2.0 * error[1], 2.0 * error[2], 2.0 * error[3]
    return (-y, x, w, north * w - vertical * y, vertical * x - north * z, vertical * w + north * y)


def sum_and_difference(u: Six, v: Six, w: Six, t: Six) -> tuple[Six, Six]:
    """``u + v + w + t`` and ``u + v − w − t``."""
    a = (u[0] + v[0], u[1] + v[1], u[2] + v[2], u[3] + v[3], u[4] + v[4], u[5] + v[5])
    b = (w[0] + t[0], w[1] + t[1], w[2] + t[2], w[3] + t[3], w[4] + t[4], w[5] + t[5])
    return (
        (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]),
        (a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3], a[4] - b[4], a[5] - b[5]),
    )


def row(
    model: Model,
    c: Four,
    r: float,
    f: Six,
    s: float,
    g: Six,
    t: float,
    e: Six,
    innovation: float,
) -> Row:
    """One row of [P_zz, P_zε, innovation], still without R."""
    z = seen(c, model.north, model.vertical)
    return (
        z[0] + r * f[0] + s * g[0] + t * e[0],
        z[1] + r * f[1] + s * g[1] + t * e[1],
        z[2] + r * f[2] + s * g[2] + t * e[2],
        z[3] + r * f[3] + s * g[3] + t * e[3],
        z[4] + r * f[4] + s * g[4] + t * e[4],
        z[5] + r * f[5] + s * g[5] + t * e[5],
        c[0],
        c[1],
        c[2],
        c[3],
        innovation,
    )
