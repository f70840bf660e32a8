"""Corrections from samples, with figures of their quality; refused where the data carry none."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..filters.rest import LARGEST, STILL
from ..filters.samples import Array, Stamps
from ..rotor import Vector
from ..words import counted
from . import coverage, ellipsoid
from .burst import STANDARD_GRAVITY
from .calibration import CalibrationError, Correction, Matrix, now

BLOCK = 500_000_000  # ns; rest is judged over so long
LEAST_IN_BLOCK = 5  # samples
LEAST_REST = 2.0  # s, for the gyroscope
LEAST_HOLD = 1.0  # s, for a position of the accelerometer
DRIFT = np.radians(0.15)  # rad/s, of the mean rate within one rest
TILT = 0.02  # of gravity: 1.1°, within one rest
ONE_POSITION = np.radians(15.0)  # rests nearer to each other are one position

EARTH = 45e-6  # tesla; 22 to 67 on its surface
FIELDS = (10e-6, 150e-6)  # tesla, that can be the earth's in or near a building
GRAVITIES = (0.9, 1.1)  # of gravity: the data sheet's scale is good to 3 %
LEAST_SAMPLES = 100  # on a sphere: eleven for each unknown
MOST_SAMPLES = 4000
LEAST_COVERAGE = 0.5  # of the sphere
WORST_CONDITION = 12.0  # a half sphere has 18, the whole 1.6
FLATTEST = 0.08  # standard deviation of directions across the plane nearest to them
LARGEST_RESIDUAL = {"accel": 0.03, "mag": 0.05}  # rms; noise alone is 0.8 and 1.2 %

ENOUGH_REST = 5.0  # s
ENOUGH_COVERAGE = 0.75
ENOUGH_CONDITION = 6.0
HELD = "positions"  # the figure that only a fit to positions has
FULL_AT = 9  # positions, for as many unknowns


class MovedError(CalibrationError):
    """The sensor was not at rest where it had to be."""


class CoverageError(CalibrationError):
    """Too few directions, or all in a plane."""


class ResidualError(CalibrationError):
    """The data lie on no ellipsoid."""


class Rest(NamedTuple):
    """A time without motion."""

    first: int  # rows: first, and after the last
    end: int
    seconds: float
    spread: float  # rad/s rms about the mean
    gyro: Array  # (3,) rad/s, mean
    accel: Array  # (3,) m/s², mean


def fit_gyro(
    stamps: Stamps, gyro: Array, accel: Array, temperature: float | None = None
) -> Correction:
    """The bias: the mean rate (rad/s) over the longest rest of at least 2 s.

    ``stamps`` (n,) ns, ``gyro`` (n, 3) rad/s, ``accel`` (n, 3) m/s², NaN where not measured. A
    slow, steady turn about the vertical cannot be told from a bias below 10 °/s, twice what the
    data sheet allows. `MovedError` if there is no such rest.
    """
    found = rests(stamps, gyro, accel)
    best = max(found, key=lambda rest: rest.seconds, default=None)
    if best is None or best.seconds < LEAST_REST:
        raise MovedError(_unrest(stamps, gyro, best))
    return Correction(
        offset=_vector(best.gyro),
        date=now(),
        temperature=None if temperature is None else round(temperature, 2),
        quality={
            "samples": best.end - best.first,
            "seconds": round(best.seconds, 2),
            "spread_deg_s": _figure(np.degrees(best.spread)),
        },
    )


def fit_accel(
    stamps: Stamps, gyro: Array, accel: Array, gravity: float = STANDARD_GRAVITY
) -> Correction:
    """Offset and matrix, from positions held for a second each or from a slow tumble.

    Positions count if all six axes have pointed up in one; else every sample does. From nine
    positions on, and from a tumble, misalignment of the axes is found as well as their scale.
    Arguments as for `fit_gyro`; ``gravity`` is the place's, m/s². `CalibrationError` where the
    data carry no fit.
    """
    held = positions(stamps, gyro, accel)
    seen = coverage.faces(held)
    if len(seen) == len(coverage.FACES):
        found = _fit_positions(held)
        quality: dict[str, float] = {HELD: len(held)}
    else:
        points = _thinned(accel)
        missing = [face for face in coverage.FACES if face not in seen]
        remedy = (
            f"Still to be held for {LEAST_HOLD:g} s: {', '.join(missing)} up; or turn it slowly "
            "through all directions."
        )
        _require_sphere(points, points, remedy)
        found = _fit(points, misaligned=True, what="accel")
        quality = {"samples": len(points), "coverage_percent": _percent(points)}
    measured = _radius(found)
    low, high = GRAVITIES
    if not low * gravity < measured < high * gravity:
        raise ResidualError(
            f"gravity measures {measured:.2f} m/s², expected about {gravity:g}: are these samples "
            "in m/s²?"
        )
    return _correction(found, gravity, quality)


def fit_mag(mag: Array) -> Correction:
    """Hard iron (tesla) and the symmetric matrix against soft iron; the field keeps its strength.

    ``mag`` (n, 3) tesla, while the sensor turned through all directions in one place. Strength:
    the matrix has the determinant 1. `CalibrationError` where the data carry no fit.
    """
    points, centred = _thinned(mag), directions("mag", mag)
    _require_sphere(points, centred, "Turn it about all its axes, upside down too.")
    found = _fit(points, misaligned=True, what="mag")
    field = _radius(found)
    low, high = FIELDS
    if not low < field < high:
        raise ResidualError(
            f"the field measures {field * 1e6:.3g} µT, the earth's is 22 to 67: are these samples "
            "in tesla, and is the place away from iron?"
        )
    quality = {
        "samples": len(points),
        "field_microtesla": _figure(field * 1e6),
        "coverage_percent": _percent(centred),
    }
    return _correction(found, field, quality)


def is_enough(correction: Correction, positions: int = len(coverage.FACES)) -> bool:
    """Whether more data would hardly make it better; ``positions``: so many are wanted."""
    quality = correction.quality
    if "seconds" in quality:
        return quality["seconds"] >= ENOUGH_REST
    if HELD in quality:
        return quality[HELD] >= positions
    return (
        quality["coverage_percent"] >= 100.0 * ENOUGH_COVERAGE
        and quality["condition"] <= ENOUGH_CONDITION
    )


def directions(sensor: str, points: Array) -> Array:
    """Where the finite ones of vectors (n, 3) of "accel" or "mag" point to, (m, 3), any length."""
    points = _thinned(points)
    return points - coverage.centre(points, EARTH) if sensor == "mag" and len(points) else points


def rests(stamps: Stamps, gyro: Array, accel: Array) -> list[Rest]:
    """The times without motion, in order. Arguments as for `fit_gyro`."""
    good = np.isfinite(gyro).all(axis=1)
    rows = np.flatnonzero(good)
    stamps, gyro, accel = stamps[good], gyro[good], accel[good]
    found: list[Rest] = []
    first = before = -1  # rows of the running rest's first block, and after its last
    for begin, end in _blocks(stamps):
        still = _spread(gyro[begin:end]) <= STILL
        goes_on = first >= 0 and begin == before and 0 < stamps[begin] - stamps[begin - 1] < BLOCK
        if still and goes_on and _same(gyro, accel, first, begin, end):
            before = end
            continue
        if first >= 0:
            found.append(_rest(stamps, gyro, accel, first, before))
        first, before = (begin, end) if still else (-1, -1)
    if first >= 0:
        found.append(_rest(stamps, gyro, accel, first, before))
    return [
        rest._replace(first=int(rows[rest.first]), end=int(rows[rest.end - 1]) + 1)
        for rest in found
        if float(np.abs(rest.gyro).max()) <= LARGEST
    ]


def positions(stamps: Stamps, gyro: Array, accel: Array) -> Array:
    """Mean specific force (k, 3), m/s², in each position held; NaN gyro: judged by force alone."""
    blind = np.where(np.isfinite(gyro).all(axis=1, keepdims=True), gyro, 0.0)
    held = [rest for rest in rests(stamps, blind, accel) if rest.seconds >= LEAST_HOLD]
    apart: list[tuple[float, Array]] = []  # weight, mean
    for rest in held:
        if not np.isfinite(rest.accel).all():
            continue
        for n, (weight, mean) in enumerate(apart):
            if _angle(mean, rest.accel) < ONE_POSITION:
                total = weight + rest.seconds
                apart[n] = (total, (weight * mean + rest.seconds * rest.accel) / total)
                break
        else:
            apart.append((rest.seconds, rest.accel))
    return np.array([mean for _, mean in apart]).reshape(-1, 3)


def _blocks(stamps: Stamps) -> list[tuple[int, int]]:
    """Rows of each half second; none where samples are too few or stamps jump."""
    if not len(stamps):
        return []
    jumps = np.flatnonzero((np.diff(stamps) <= 0) | (np.diff(stamps) > BLOCK)) + 1
    blocks = []
    for begin, end in zip([0, *jumps], [*jumps, len(stamps)], strict=True):
        number = (stamps[begin:end] - stamps[begin]) // BLOCK
        edges = begin + np.searchsorted(number, np.arange(int(number[-1]) + 2))
        whole = zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
        blocks += [(a, b) for a, b in whole if b - a >= LEAST_IN_BLOCK]
    return blocks


def _same(gyro: Array, accel: Array, first: int, begin: int, end: int) -> bool:
    """Whether a block is like the rest that began in row ``first``."""
    drift = np.abs(gyro[begin:end].mean(axis=0) - gyro[first:begin].mean(axis=0)).max()
    force, at_first = accel[begin:end].mean(axis=0), accel[first:begin].mean(axis=0)
    tilt = np.abs(force - at_first).max()
    return bool(drift <= DRIFT and not tilt > TILT * STANDARD_GRAVITY)


def _rest(stamps: Stamps, gyro: Array, accel: Array, first: int, end: int) -> Rest:
    return Rest(
        first,
        end,
        float(stamps[end - 1] - stamps[first]) * 1e-9 * (1.0 + 1.0 / max(end - first - 1, 1)),
        _spread(gyro[first:end]),
        gyro[first:end].mean(axis=0),
        accel[first:end].mean(axis=0),
    )


def _spread(rates: Array) -> float:
    return float(np.sqrt(((rates - rates.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _unrest(stamps: Stamps, gyro: Array, best: Rest | None) -> str:
    """Why there is no bias."""
    remedy = f"Lay it down, keep it still for {ENOUGH_REST:g} s, and calibrate again."
    if best is not None:
        return (
            f"the sensor rested for {best.seconds:.1f} s at most, expected {LEAST_REST:g}. {remedy}"
        )
    good = gyro[np.isfinite(gyro).all(axis=1)]
    if len(good) < LEAST_IN_BLOCK:
        samples = counted(len(good), "gyroscope sample")
        return f"{samples}, expected {LEAST_REST:g} s of them. {remedy}"
    mean = np.degrees(np.abs(good.mean(axis=0)).max())
    return (
        f"the sensor moved: rates of {mean:.1f} °/s with a spread of "
        f"{np.degrees(_spread(good)):.1f} °/s (rest is below {np.degrees(LARGEST):.0f} and "
        f"{np.degrees(STILL):.0f}). {remedy}"
    )


def _thinned(points: Array) -> Array:
    """The finite ones, evenly thinned to what a fit can use."""
    points = points[np.isfinite(points).all(axis=1)]
    return points[:: max(1, -(-len(points) // MOST_SAMPLES))]


def _require_sphere(points: Array, directions: Array, remedy: str) -> None:
    """Raise `CoverageError` if the points are no good part of a sphere."""
    if len(points) < LEAST_SAMPLES:
        samples = counted(len(points), "sample")
        raise CoverageError(f"{samples}, expected {LEAST_SAMPLES} or more. {remedy}")
    seen = coverage.fraction(directions)
    u = directions / np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-30)
    flat = float(np.sqrt(np.linalg.eigvalsh(np.cov(u.T))[0]))
    figure = f"the directions cover {100.0 * seen:.0f} % of the sphere"
    if flat < FLATTEST:
        raise CoverageError(
            f"{figure} and lie in one plane (deviation from it {flat:.2f}, expected "
            f"{FLATTEST:g} or more): it was turned about one axis alone. {remedy}"
        )
    if seen < LEAST_COVERAGE:
        raise CoverageError(f"{figure}, expected {100.0 * LEAST_COVERAGE:.0f} or more. {remedy}")


def _fit(points: Array, misaligned: bool, what: str) -> ellipsoid.Ellipsoid:
    """The ellipsoid through enough points; `CalibrationError` if it is none to rely on."""
    found = ellipsoid.fit(points, misaligned)
    again = "Calibrate again, turning it slowly, in one place away from iron and currents."
    if found is None:
        raise ResidualError(f"the samples lie on no ellipsoid. {again}")
    residual, limit = _rms(found.residuals), LARGEST_RESIDUAL[what]
    if residual > limit:
        raise ResidualError(
            f"the residual is {100.0 * residual:.1f} % of the field, expected {100.0 * limit:g} or "
            f"less: the samples lie on no ellipsoid. {again}"
        )
    if found.condition > WORST_CONDITION:
        raise CoverageError(
            f"the condition of the fit is {found.condition:.3g}, expected {WORST_CONDITION:g} or "
            "less: a side of the sphere is missing. Turn it through all directions, upside down "
            "too."
        )
    return found


def _fit_positions(held: Array) -> ellipsoid.Ellipsoid:
    """Misalignment too, if the positions are enough and different enough."""
    if len(held) >= FULL_AT:
        try:
            return _fit(held, misaligned=True, what="accel")
        except CoverageError:
            pass
    return _fit(held, misaligned=False, what="accel")


def _radius(found: ellipsoid.Ellipsoid) -> float:
    """Of the sphere with the ellipsoid's volume, in the unit of the points."""
    return float(np.linalg.det(found.matrix) ** (-1.0 / 3.0))


def _correction(found: ellipsoid.Ellipsoid, length: float, quality: dict[str, float]) -> Correction:
    """The correction that makes the ellipsoid a sphere of that radius."""
    rows = (length * found.matrix).tolist()
    matrix: Matrix = (_vector(rows[0]), _vector(rows[1]), _vector(rows[2]))
    figures = {
        "residual_percent": _figure(100.0 * _rms(found.residuals)),
        "condition": _figure(found.condition),
    }
    return Correction(_vector(found.offset), matrix, now(), None, {**quality, **figures})


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean()))


def _angle(u: Array, v: Array) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v))


def _percent(directions: Array) -> float:
    return round(100.0 * coverage.fraction(directions), 1)


def _figure(value: float) -> float:
    return float(f"{value:.3g}")


def _vector(values: Array | list[float]) -> Vector:
    x, y, z = (float(value) for value in values)
    return (x, y, z)
