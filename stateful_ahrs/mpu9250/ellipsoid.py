"""The ellipsoid through what a sensor showed of a field that is the same all around.

A sensor with offset ``b`` and distortion ``D`` shows a vector ``u`` of constant length as
``x = D u + b``: turned through all directions, points on an ellipsoid. The ``matrix`` that makes a
sphere of it again is known up to a turn of the whole; the symmetric one is taken.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..filters.samples import Array
from .calibration import CalibrationError

# Places of the parameters in the symmetric matrix, and the sums of them in each element
ROWS, COLUMNS = np.array([0, 1, 2, 0, 0, 1]), np.array([0, 1, 2, 1, 2, 2])
SCALES = 3  # the first of them: no misalignment
LEAST_SCALE = 0.02  # of the robust loss: 2 % of the radius


class Ellipsoid(NamedTuple):
    """``|matrix (x − offset)| = 1`` on it."""

    offset: Array  # (3,) in the unit of the points
    matrix: Array  # (3, 3) symmetric, positive, in 1 / unit
    residuals: Array  # (n,) of the length 1
    condition: float  # of the fit: how much worse the worst-known parameter is than the best

    def apply(self, points: Array) -> Array:
        """The points (n, 3) on the unit sphere, as nearly as they are."""
        return np.asarray((points - self.offset) @ self.matrix)


def fit(points: Array, misaligned: bool = True) -> Ellipsoid | None:
    """The ellipsoid nearest to points (n, 3); None where they lie on none.

    Least squares of the distances, robust against outliers (soft L1), from the linear fit on.
    ``misaligned=False`` leaves the matrix diagonal: six unknowns instead of nine.
    """
    try:
        from scipy.optimize import least_squares  # type: ignore[import-untyped]
    except ModuleNotFoundError:
        raise CalibrationError(
            "fitting an ellipsoid needs the Python package scipy: install python3-scipy, "
            "or pip install 'stateful_ahrs[calibration]'."
        ) from None

    middle = points.mean(axis=0)
    size = float(np.sqrt(((points - middle) ** 2).sum(axis=1).mean()))
    if not 0.0 < size < np.inf:
        return None
    x = (points - middle) / size
    count = len(ROWS) if misaligned else SCALES
    start = _linear(x, count)
    if start is None:
        start = np.concatenate([np.zeros(3), np.ones(SCALES), np.zeros(count - SCALES)])
    noise = 1.4826 * float(np.median(np.abs(_residuals(start, x))))
    found = least_squares(
        _residuals,
        start,
        jac=_jacobian,
        args=(x,),
        method="trf",
        loss="soft_l1",
        f_scale=max(2.0 * noise, LEAST_SCALE),
        x_scale="jac",
        max_nfev=50,
    )
    matrix = _matrix(found.x[3:])
    if not (np.isfinite(found.x).all() and np.linalg.eigvalsh(matrix).min() > 1e-3):
        return None
    residuals = _residuals(found.x, x)
    u = (x - found.x[:3]) @ matrix
    directions = u / np.linalg.norm(u, axis=1, keepdims=True)
    condition = float(np.linalg.cond(_sensitivity(directions, count)))
    return Ellipsoid(middle + size * found.x[:3], matrix / size, residuals, condition)


def _matrix(parameters: Array) -> Array:
    matrix = np.zeros((3, 3))
    count = len(parameters)
    matrix[ROWS[:count], COLUMNS[:count]] = parameters
    matrix[COLUMNS[:count], ROWS[:count]] = parameters
    return matrix


def _residuals(parameters: Array, x: Array) -> Array:
    length = np.linalg.norm((x - parameters[:3]) @ _matrix(parameters[3:]), axis=1)
    return np.asarray(length - 1.0)


def _jacobian(parameters: Array, x: Array) -> Array:
    matrix = _matrix(parameters[3:])
    d = x - parameters[:3]
    v = d @ matrix
    u = v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-12)
    return np.hstack([-u @ matrix, _products(u, d)[:, : len(parameters) - 3]])


def _sensitivity(u: Array, count: int) -> Array:
    """The Jacobian where the ellipsoid is the unit sphere: it depends on the directions alone."""
    return np.hstack([-u, _products(u, u)[:, :count]])


def _products(u: Array, d: Array) -> Array:
    """How the length of ``matrix d``, along ``u``, grows with each parameter of the matrix."""
    twice = u[:, ROWS] * d[:, COLUMNS] + u[:, COLUMNS] * d[:, ROWS]
    twice[:, :SCALES] *= 0.5
    return np.asarray(twice)


def _linear(x: Array, count: int) -> Array | None:
    """Offset and matrix of the quadric ``xᵀ A x + 2 bᵀ x + c = 0`` that fits algebraically."""
    squares = x[:, ROWS] * x[:, COLUMNS] * np.where(ROWS == COLUMNS, 1.0, 2.0)
    design = np.hstack([squares[:, :count], 2.0 * x, np.ones((len(x), 1))])
    *_, last = np.linalg.svd(design, full_matrices=len(x) < design.shape[1])[2]
    a = _matrix(last[:count])
    if np.trace(a) < 0.0:
        a, last = -a, -last
    try:
        offset = np.linalg.solve(a, -last[count:-1])
    except np.linalg.LinAlgError:
        return None
    radius = float(offset @ a @ offset - last[-1])
    values, vectors = np.linalg.eigh(a)
    if not (radius > 0.0 and values.min() > 1e-3 * values.max()):
        return None
    matrix = (vectors * np.sqrt(values / radius)) @ vectors.T
    return np.concatenate([offset, matrix[ROWS[:count], COLUMNS[:count]]])
