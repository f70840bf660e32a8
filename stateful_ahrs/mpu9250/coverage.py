"""Which directions have been seen, as cells of equal solid angle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..filters.samples import Array

BANDS, SECTORS = 6, 12  # of equal height along z, which makes them equal in area; and around z

FACES = ("+x", "-x", "+y", "-y", "+z", "-z")
FACE_ANGLE = np.radians(35.0)  # a direction so near an axis is that face's


def cells(directions: Array) -> NDArray[np.bool_]:
    """The cells (BANDS, SECTORS) that vectors (n, 3) of any length point to; +z is on top."""
    seen = np.zeros((BANDS, SECTORS), dtype=bool)
    length = np.linalg.norm(directions, axis=1)
    x, y, z = directions[length > 0.0].T
    height = z / length[length > 0.0]
    band = np.clip(((1.0 - height) * (BANDS / 2)).astype(int), 0, BANDS - 1)
    sector = ((np.arctan2(y, x) / (2.0 * np.pi) + 0.5) * SECTORS).astype(int) % SECTORS
    seen[band, sector] = True
    return seen


def fraction(directions: Array) -> float:
    """Part of the sphere that has been seen, 0 to 1."""
    return float(cells(directions).mean())


def faces(directions: Array) -> list[str]:
    """The axes that have pointed along the vectors (n, 3), such as "+x", in fixed order."""
    length = np.linalg.norm(directions, axis=1, keepdims=True)
    u = directions / np.where(length > 0.0, length, 1.0)
    near = np.concatenate([u, -u], axis=1).max(axis=0, initial=-1.0) > np.cos(FACE_ANGLE)
    x, y, z, minus_x, minus_y, minus_z = near
    found = (x, minus_x, y, minus_y, z, minus_z)
    return [name for name, there in zip(FACES, found, strict=True) if there]


def centre(points: Array, radius: float, steps: int = 8) -> Array:
    """Centre (3,) of the sphere of about that radius on which vectors (n, 3) lie.

    For the picture while samples come in. An arc tells its sphere badly; here the radius is
    believed to within a third, so that a short arc stays a small part of a sphere.
    """
    mean = points.mean(axis=0)
    spread = np.sqrt(((points - mean) ** 2).sum(axis=1).mean())
    if spread < 1e-3 * radius:
        return np.asarray(mean - [0.0, 0.0, radius])
    r = radius
    weight = np.sqrt(0.01 * len(points)) * 3.0 / radius
    c = np.asarray(_start(points, mean, radius))
    for _ in range(steps):
        d = points - c
        length = np.maximum(np.linalg.norm(d, axis=1), 1e-9 * radius)
        jacobian = np.empty((len(points) + 1, 4))
        jacobian[:-1, :3] = -d / length[:, None]
        jacobian[:-1, 3] = -1.0
        jacobian[-1] = (0.0, 0.0, 0.0, weight)
        residual = np.append(length - r, weight * (r - radius))
        step = np.linalg.lstsq(jacobian, -residual, rcond=1e-6)[0]
        c, r = c + step[:3], r + step[3]
    return c


def _start(points: Array, mean: Array, radius: float) -> Array:
    """On the hollow side of the points, where there is one."""
    d = points - mean
    length = (d**2).sum(axis=1)
    bend = np.linalg.lstsq(2.0 * d, length - length.mean(), rcond=1e-2)[0]
    size = np.linalg.norm(bend)
    return mean + bend * min(1.0, radius / size) if size > 0.0 else mean
