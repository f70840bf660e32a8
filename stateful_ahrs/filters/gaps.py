"""What missing rates cost: in a gap between samples the sensor turned as nobody knows.

The mean of the rates before and after is the best guess of what it did; a rate that is none leaves
the one before it. From then on the filter is less sure: the slow room of its attitude, and the fast
path averages as after a start that was only so long ago that its mean would be as uncertain. Not in
the paper.
"""

from __future__ import annotations

import math

from ..rotor import Vector
from .spikes import SHORT, square

MISSING = 3.0  # of the last step: a longer one is a gap
OF_RATE = 0.3  # of the rates at its ends: how far (standard deviation) that between is off
AT_REST = 0.1  # rad/s: likewise where the sensor rests before and after
SURE = 0.05  # rad² s: over a variance, so many seconds of a mean of snapshots are as good
MUCH_LOST = 0.003  # rad²: the slow room should know of it at once


def is_gap(dt: float, last: float) -> bool:
    """Whether samples are missing in a step of ``dt`` s after one of ``last`` s."""
    return dt > SHORT and dt > MISSING * last > 0.0


def middle(before: Vector, after: Vector) -> Vector:
    """The mean of two rates."""
    x, y, z = before
    u, v, w = after
    return (0.5 * (x + u), 0.5 * (y + v), 0.5 * (z + w))


def variance_lost(before: Vector, after: Vector, span: float) -> float:
    """Variance (rad²) of a turn that took ``span`` s, by the rates (rad/s) before and after it."""
    sigma = span * (OF_RATE * math.sqrt(0.5 * (square(before) + square(after))) + AT_REST)
    return sigma * sigma


def left_of(time: float, lost: float) -> float:
    """What a mean over ``time`` s is still worth (s) after a turn of this variance (rad²)."""
    return time / (1.0 + time * lost / SURE)
