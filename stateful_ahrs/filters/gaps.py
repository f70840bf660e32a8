"""What missing rates cost: in a gap between samples the sensor turned as nobody knows.

The mean of the rates before and after is the best guess of what it did; where a rate is none, the
one before it is held. From then on the filter is less sure: the slow room of its attitude, and the
fast path takes its means for those of a shorter time, as after a start. If too little is left, both
have lost the attitude. The first sample after a gap waits for the second (`stateful.take`), since
one that is bad would stand for the whole gap. Not in the paper.
"""

from __future__ import annotations

import math

from ..rotor import Vector, minus
from .spikes import square

GAP = 0.03  # s: no step so short is one
MISSING = 3.0  # of the last step: a longer one is a gap
OF_RATE = 0.3  # of the rates at its ends: how far (standard deviation) that between is off
OF_CHANGE, PER_SECOND = 0.4, 1.5  # likewise of their difference; less in a gap below 0.27 s
AT_REST = 0.1  # rad/s: likewise where the sensor rests before and after
SURE = 0.05  # rad² s: variance of a mean of snapshots, times the time that it is of
MUCH_LOST = 0.003  # rad²: the slow room should know at once, and the last field be forgotten
COUNTS = 0.1  # s: what a force after a longer gap counts for
OFTEN = 1.0  # s: gaps that come as often are no accident, and cost no good sample its weight
ALL_LOST = 0.25  # rad²: half a radian, and nothing is known any more


def is_gap(dt: float, last: float) -> bool:
    """Whether samples are missing in a step of ``dt`` s after one of ``last`` s.

    A second step as long as the first is none: then samples have come to be seldom.
    """
    return dt > GAP and dt > MISSING * last > 0.0


def variance_lost(before: Vector, after: Vector, span: float) -> float:
    """Variance (rad²) of a turn that took ``span`` s, by the rates (rad/s) before and after it."""
    sigma = span * (OF_RATE * math.sqrt(0.5 * (square(before) + square(after))) + AT_REST)
    return sigma * sigma


def variance_over_gap(before: Vector, after: Vector, span: float) -> float:
    """The same where one of the rates may be bad: what it does not know, their difference tells."""
    of_change = span * min(OF_CHANGE, PER_SECOND * span)
    change = of_change * of_change * square(minus(after, before))
    return variance_lost(before, after, span) + change


def left_of(time: float, lost: float) -> float:
    """What a mean over ``time`` s is still worth (s) after a turn of this variance (rad²)."""
    return time / (1.0 + time * lost / SURE)
