"""How far an estimate is from the truth, by the metric of BROAD.

D. Laidig, M. Caruso, A. Cereatti, T. Seel, "BROAD: A Benchmark for Robust Inertial Orientation
Estimation", Data 6(7), 2021, 72. All rotors are (n, 4), w x y z, sensor → earth (ENU), and both
signs of a rotor are the same attitude. Nothing is aligned trial by trial: an estimate with the
wrong north is wrong.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..filters.samples import Array, Stamps
from ..filters.stamps import LONGEST_STEP_BACK
from ..rotor import conjugate, product

Mask = NDArray[np.bool_]

LONGEST_GAP = 100_000_000  # ns; a turn that starts at 20 rad/s² bends by 1.4° in it


class Errors(NamedTuple):
    """Angles in rad, in [0, π]: arrays (n,), or their root mean squares."""

    total: Array
    heading: Array
    inclination: Array


class Rmse(NamedTuple):
    """Root mean squares in degrees."""

    total: float
    heading: float
    inclination: float


class Truth(NamedTuple):
    """The reference at the stamps of an estimate."""

    rotors: Array  # (n, 4) of unit length; NaN where unknown
    counts: Mask  # (n,) the rows that the metric takes


def errors(estimate: Array, reference: Array) -> Errors:
    """Split the error rotor in the earth frame, ``estimate reference*``; NaN where either is.

    Heading is its turn about the vertical, 2 arctan|z/w|, and inclination the rest of it,
    2 arccos √(w² + z²); the total is 2 arccos|w|. All go through atan2, which is exact near 0.
    Rotors need not be of unit length.
    """
    w, x, y, z = np.abs(product(tuple(estimate.T), conjugate(tuple(reference.T))))
    level = np.hypot(x, y)
    return Errors(
        total=2.0 * np.arctan2(np.hypot(level, z), w),
        heading=2.0 * np.arctan2(z, w),
        inclination=2.0 * np.arctan2(level, np.hypot(w, z)),
    )


def rmse_deg(estimate: Array, truth: Truth) -> Rmse:
    """Root mean squares in degrees over the rows that count, of which there must be one."""
    found = errors(estimate[truth.counts], truth.rotors[truth.counts])
    return Rmse(*(float(np.degrees(np.sqrt(np.mean(error**2)))) for error in found))


def sign_flips(rotors: Array) -> int:
    """How often a rotor (n, 4) lies in the other hemisphere than the one before it."""
    return int(np.count_nonzero(np.einsum("ij,ij->i", rotors[1:], rotors[:-1]) < 0.0))


def passes(stamps: Stamps) -> NDArray[np.int64]:
    """How often the stamps (n,) had jumped back before each of them: the loops of a bag."""
    back = np.diff(stamps, prepend=stamps[:1]) < -LONGEST_STEP_BACK
    return np.cumsum(back, dtype=np.int64)


def truth_at(
    stamps: Stamps, reference_stamps: Stamps, reference: Array, movement: Mask | None = None
) -> Truth:
    """The reference (r, 4) and the phases that count (r,), at other stamps (n,) in ns.

    Where stamps coincide the reference is taken as it is. Elsewhere it is interpolated on the
    great circle between the two rows around the stamp (slerp), if these are at most
    `LONGEST_GAP` apart and both known; such a row counts if both of them count. The nth pass of
    the one belongs to the nth of the other where stamps jump back.
    """
    length = np.linalg.norm(reference, axis=1, keepdims=True)
    known = np.isfinite(length) & (length > 0.0)
    rotors = np.divide(reference, length, out=np.full_like(reference, np.nan), where=known)
    counts = np.ones(len(rotors), np.bool_) if movement is None else movement

    at = np.full((len(stamps), 4), np.nan)
    counted = np.zeros(len(stamps), np.bool_)
    own_pass, its_pass = passes(stamps), passes(reference_stamps)
    for number in range(int(its_pass.max(initial=-1)) + 1):
        rows, there = own_pass == number, np.flatnonzero(its_pass == number)
        known_stamps, first = np.unique(reference_stamps[there], return_index=True)
        there = there[first]
        before, after, part = _brackets(stamps[rows], known_stamps)
        before, after = there[before], there[after]
        at[rows] = slerp(rotors[before], rotors[after], part)
        counted[rows] = counts[before] & counts[after]
    return Truth(at, counted & np.isfinite(at).all(axis=1))


def slerp(p: Array, q: Array, part: Array) -> Array:
    """The unit rotors (n, 4) at ``part`` (n,) of the shorter way from p to q; p where that is 0."""
    q = np.where(np.einsum("ij,ij->i", p, q)[:, None] < 0.0, -q, q)
    way = 2.0 * np.arctan2(np.linalg.norm(p - q, axis=1), np.linalg.norm(p + q, axis=1))
    # np.sinc(x) is sin(πx)/(πx): the weights sin((1 − part) way)/sin(way) without 0/0.
    scale = np.sinc(way / np.pi)
    to_p = (1.0 - part) * np.sinc((1.0 - part) * way / np.pi) / scale
    to_q = part * np.sinc(part * way / np.pi) / scale
    between = to_p[:, None] * p + to_q[:, None] * q
    return np.where(part[:, None] == 0.0, p, between)


def _brackets(stamps: Stamps, known: Stamps) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """The rows of ``known`` (sorted) before and after each stamp, and the part of the way.

    Both are the same row where the stamps coincide; the part is NaN where there is no bracket.
    """
    after = np.minimum(np.searchsorted(known, stamps), len(known) - 1)
    same = known[after] == stamps
    before = np.where(same, after, np.maximum(after - 1, 0))
    gap = known[after] - known[before]
    inside = (known[before] < stamps) & (stamps < known[after]) & (gap <= LONGEST_GAP)
    part = np.full(len(stamps), np.nan)
    part[same] = 0.0
    part[inside] = (stamps - known[before])[inside] / gap[inside]
    return before, after, part
