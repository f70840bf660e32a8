"""What missing samples cost: in a step much longer than the last the sensor turned as nobody knows.

The mean of the rates before and after is the best guess of what it did. From then on the filter is
less sure: the slow room of its attitude, and the fast path averages as after a start that was only
so long ago that its mean would be as uncertain. Not in the paper.
"""

from __future__ import annotations

import math

from ..rotor import Vector
from .spikes import SHORT, square

MISSING = 3.0  # of the last step: a longer one is a gap
OF_TURN = 0.3  # of the turn in a gap: its standard deviation
AT_REST = 0.1  # rad/s: likewise where the sensor rests before and after
SURE = 0.05  # rad² s: over a variance, so many seconds of a mean of snapshots are as good


def is_gap(dt: float, last: float) -> bool:
    """Whether samples are missing in a step of ``dt`` s after one of ``last`` s."""
    return dt > SHORT and dt > MISSING * last > 0.0


def across(before: Vector, after: Vector, dt: float) -> tuple[Vector, float]:
    """The rate (rad/s) in a gap of ``dt`` s, by those at its ends; variance of its turn (rad²)."""
    x, y, z = before
    u, v, w = after
    x, y, z = 0.5 * (x + u), 0.5 * (y + v), 0.5 * (z + w)
    rate = math.sqrt(0.5 * (square(before) + square(after)))
    sigma = dt * (OF_TURN * rate + AT_REST)
    return (x, y, z), sigma * sigma
