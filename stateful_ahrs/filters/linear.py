"""Linear algebra of four and six dimensions for kernels, on tuples.

A matrix is a tuple of its rows. Nearly everything is written out, because a kernel has no arrays;
compiled, nothing of the tuples is left.
"""

from __future__ import annotations

import math

from ..rotor import Rotor, dot, product

Four = tuple[float, float, float, float]
Six = tuple[float, float, float, float, float, float]
Matrix = tuple[Four, Four, Four, Four]
# A row of [S C z]: six elements of S, four of C, and z.
Row = tuple[float, float, float, float, float, float, float, float, float, float, float]
Rows = tuple[Row, Row, Row, Row, Row, Row]

ZERO: Four = (0.0, 0.0, 0.0, 0.0)
ZEROS: Matrix = (ZERO, ZERO, ZERO, ZERO)
SMALLEST = 1e-18  # of a pivot: what is left of a variance when the rest is rounding


def plus(u: Four, v: Four) -> Four:
    """Sum."""
    return (u[0] + v[0], u[1] + v[1], u[2] + v[2], u[3] + v[3])


def minus(u: Four, v: Four) -> Four:
    """Difference."""
    return (u[0] - v[0], u[1] - v[1], u[2] - v[2], u[3] - v[3])


def plus_times(u: Four, s: float, v: Four) -> Four:
    """``u + s v``."""
    return (u[0] + s * v[0], u[1] + s * v[1], u[2] + s * v[2], u[3] + s * v[3])


def scaled(s: float, u: Four) -> Four:
    """``s u``."""
    return (s * u[0], s * u[1], s * u[2], s * u[3])


def mixed(a: float, u: Four, b: float, v: Four) -> Four:
    """``a u + b v``."""
    return (a * u[0] + b * v[0], a * u[1] + b * v[1], a * u[2] + b * v[2], a * u[3] + b * v[3])


def hadamard(u: Four, v: Four) -> Four:
    """Product, element by element."""
    return (u[0] * v[0], u[1] * v[1], u[2] * v[2], u[3] * v[3])


def times(m: Matrix, v: Four) -> Four:
    """``m v``."""
    return (dot(m[0], v), dot(m[1], v), dot(m[2], v), dot(m[3], v))


def added(m: Matrix, n: Matrix) -> Matrix:
    """Sum of two matrices."""
    return (plus(m[0], n[0]), plus(m[1], n[1]), plus(m[2], n[2]), plus(m[3], n[3]))


def subtracted(m: Matrix, n: Matrix) -> Matrix:
    """Difference of two matrices."""
    return (minus(m[0], n[0]), minus(m[1], n[1]), minus(m[2], n[2]), minus(m[3], n[3]))


def plus_square(m: Matrix, s: float, u: Four) -> Matrix:
    """``m + s u uᵀ``."""
    return (
        plus_times(m[0], s * u[0], u),
        plus_times(m[1], s * u[1], u),
        plus_times(m[2], s * u[2], u),
        plus_times(m[3], s * u[3], u),
    )


def transposed(m: Matrix) -> Matrix:
    """The columns of a matrix."""
    a, b, c, d = m
    return (
        (a[0], b[0], c[0], d[0]),
        (a[1], b[1], c[1], d[1]),
        (a[2], b[2], c[2], d[2]),
        (a[3], b[3], c[3], d[3]),
    )


def between(m: Matrix, n: Matrix) -> Matrix:
    """``m nᵀ``, which must be symmetric."""
    (a, b, c, d), (e, f, g, h) = m, n
    ab, ac, ad, bc, bd, cd = dot(a, f), dot(a, g), dot(a, h), dot(b, g), dot(b, h), dot(c, h)
    return (
        (dot(a, e), ab, ac, ad),
        (ab, dot(b, f), bc, bd),
        (ac, bc, dot(c, g), cd),
        (ad, bd, cd, dot(d, h)),
    )


def turned(m: Matrix, q: Rotor) -> Matrix:
    """``F m Fᵀ``, the covariance of ``v ⊗ q`` where that of v is ``m``; F v = v ⊗ q."""
    w, x, y, z = q
    a, b, c, d = m
    half = transposed((product(a, q), product(b, q), product(c, q), product(d, q)))
    return between(half, ((w, -x, -y, -z), (x, w, z, -y), (y, -z, w, x), (z, y, -x, w)))


def cholesky(p: Matrix) -> Matrix:
    """The columns of the lower triangle S with ``S Sᵀ = p``, where rounding may have hurt ``p``.

    By way of L D Lᵀ, in which each pivot waits for a division alone.
    """
    a = max(p[0][0], SMALLEST)
    i = 1.0 / a
    b, c, d = i * p[1][0], i * p[2][0], i * p[3][0]
    e = max(p[1][1] - b * p[1][0], SMALLEST)
    f, g = p[2][1] - b * p[2][0], p[3][1] - b * p[3][0]
    i = 1.0 / e
    h, j = i * f, i * g
    k = max(p[2][2] - c * p[2][0] - h * f, SMALLEST)
    m = p[3][2] - c * p[3][0] - h * g
    n = m / k
    o = max(p[3][3] - d * p[3][0] - j * g - n * m, SMALLEST)
    s, t, u, v = math.sqrt(a), math.sqrt(e), math.sqrt(k), math.sqrt(o)
    return (
        (s, s * b, s * c, s * d),
        (0.0, t, t * h, t * j),
        (0.0, 0.0, u, u * n),
        (0.0, 0.0, 0.0, v),
    )


def explained4(s: Matrix, c: Matrix, z: Four) -> tuple[Matrix, Four]:
    """``cᵀ s⁻¹ c`` and ``cᵀ s⁻¹ z``, by Gaussian elimination; ``s`` is symmetric and positive."""
    (a, b, d, e), (p, q, r, t), (w, x, y, v) = s, c, z
    f = 1.0 / a[0]
    i, j, k = f * a[1], f * a[2], f * a[3]
    b, q, x = plus_times(b, -i, a), plus_times(q, -i, p), x - i * w
    d, r, y = plus_times(d, -j, a), plus_times(r, -j, p), y - j * w
    e, t, v = plus_times(e, -k, a), plus_times(t, -k, p), v - k * w
    g = 1.0 / b[1]
    i, j = g * b[2], g * b[3]
    d, r, y = plus_times(d, -i, b), plus_times(r, -i, q), y - i * x
    e, t, v = plus_times(e, -j, b), plus_times(t, -j, q), v - j * x
    h = 1.0 / d[2]
    i = h * d[3]
    e, t, v = plus_times(e, -i, d), plus_times(t, -i, r), v - i * y
    weights = (f, g, h, 1.0 / e[3])
    m = transposed((p, q, r, t))
    n = (
        hadamard(weights, m[0]),
        hadamard(weights, m[1]),
        hadamard(weights, m[2]),
        hadamard(weights, m[3]),
    )
    return between(n, m), times(n, (w, x, y, v))


def explained(rows: Rows) -> tuple[Matrix, Four]:
    """``Cᵀ S⁻¹ C`` and ``Cᵀ S⁻¹ z`` from the rows of ``[S C z]``, by Gaussian elimination.

    S is 6×6, symmetric and positive, and only its upper triangle is read. Where S is the
    covariance of a measurement, C its covariance with a state and z the innovation, these are
    what the measurement takes off the state's covariance and adds to the state.
    """
    a, b, c, d, e, f = rows
    s = 1.0 / a[0]
    b, c = more(b, -s * a[1], a), more(c, -s * a[2], a)
    d, e, f = more(d, -s * a[3], a), more(e, -s * a[4], a), more(f, -s * a[5], a)
    t = 1.0 / b[1]
    c, d = more(c, -t * b[2], b), more(d, -t * b[3], b)
    e, f = more(e, -t * b[4], b), more(f, -t * b[5], b)
    u = 1.0 / c[2]
    d, e, f = more(d, -u * c[3], c), more(e, -u * c[4], c), more(f, -u * c[5], c)
    v = 1.0 / d[3]
    e, f = more(e, -v * d[4], d), more(f, -v * d[5], d)
    w = 1.0 / e[4]
    f = more(f, -w * e[5], e)
    x = 1.0 / f[5]
    p0 = (a[6], b[6], c[6], d[6], e[6], f[6])
    p1 = (a[7], b[7], c[7], d[7], e[7], f[7])
    p2 = (a[8], b[8], c[8], d[8], e[8], f[8])
    p3 = (a[9], b[9], c[9], d[9], e[9], f[9])
    q0 = (s * a[6], t * b[6], u * c[6], v * d[6], w * e[6], x * f[6])
    q1 = (s * a[7], t * b[7], u * c[7], v * d[7], w * e[7], x * f[7])
    q2 = (s * a[8], t * b[8], u * c[8], v * d[8], w * e[8], x * f[8])
    q3 = (s * a[9], t * b[9], u * c[9], v * d[9], w * e[9], x * f[9])
    z = (a[10], b[10], c[10], d[10], e[10], f[10])
    r01, r02, r03 = dot6(q0, p1), dot6(q0, p2), dot6(q0, p3)
    r12, r13, r23 = dot6(q1, p2), dot6(q1, p3), dot6(q2, p3)
    return (
        (dot6(q0, p0), r01, r02, r03),
        (r01, dot6(q1, p1), r12, r13),
        (r02, r12, dot6(q2, p2), r23),
        (r03, r13, r23, dot6(q3, p3)),
    ), (dot6(q0, z), dot6(q1, z), dot6(q2, z), dot6(q3, z))


def more(u: Row, s: float, v: Row) -> Row:
    """``u + s v``."""
    return (
        u[0] + s * v[0],
        u[1] + s * v[1],
        u[2] + s * v[2],
        u[3] + s * v[3],
        u[4] + s * v[4],
        u[5] + s * v[5],
        u[6] + s * v[6],
        u[7] + s * v[7],
        u[8] + s * v[8],
        u[9] + s * v[9],
        u[10] + s * v[10],
    )


def dot6(u: Six, v: Six) -> float:
    """Inner product."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2] + u[3] * v[3] + u[4] * v[4] + u[5] * v[5]
