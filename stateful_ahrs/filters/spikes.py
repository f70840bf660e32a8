"""What a single bad sample may do: one that neither of its neighbours confirms is taken back.

A motion does not turn faster by 4 rad/s for one sample and is back with the next; a glitch on the
bus does. A rate and a force are taken back with the next sample; a field that differs from the
last good one by more than itself is not taken, unless it stays. Where steps are longer
gravity and north have to say so too, and a rate that they do not clear is doubted. Not in the
paper, and off where a filter is the paper's.

A start is one sample: if the next contradicts it, that is the start.
"""

from __future__ import annotations

import math

from ..rotor import Rotor, Vector, carried, conjugate, from_rate, minus, product, rotate, total
from .senses import STRONGEST, heard, usable

ZERO: Vector = (0.0, 0.0, 0.0)
JUMP_OF_RATE = 4.0  # rad/s
JUMP_OF_FORCE = 30.0  # m/s²
ALIKE = 1.0 / 16.0  # of the square of the jump: how near the two neighbours are
SHORT = 0.022  # s: in longer steps a motion may well turn and turn back
BETTER = 0.25  # of how far gravity and north are off
START_OFF = 0.06  # 1 − cos 20°
STAYS = 0.25  # s


# What is remembered for it, beside the last good rate: the rate before it (rad/s), the time that
# the last one turned for (s; negative where the mean of both did, in a gap), the last force and the
# one before (m/s²). Without names, because one is made for each sample.
Seen = tuple[Vector, float, Vector, Vector]
UNSEEN: Seen = (ZERO, 0.0, ZERO, ZERO)


def is_far(u: Vector, v: Vector, jump: float) -> bool:
    """Whether two vectors are further apart than that: one of them may be a glitch."""
    ux, uy, uz = u
    vx, vy, vz = v
    x, y, z = ux - vx, uy - vy, uz - vz
    return x * x + y * y + z * z > jump * jump


def way_back(last: Vector, seen: Seen, rate: Vector) -> Rotor:
    """What takes back the last turn if its rate (rad/s) was none; else the identity."""
    before, span, _, _ = seen
    meant = total(last, to_neighbours(last, before, rate, JUMP_OF_RATE))
    if span < 0.0:
        span, last, meant = -span, middle(before, last), middle(before, meant)
    return product(conjugate(from_rate(last, span)), from_rate(meant, span))


def doubt(last: Vector, seen: Seen, rate: Vector) -> float:
    """Variance (rad²) of the last turn, as its rate (rad/s) may have been none; else 0."""
    before, span, _, _ = seen
    return span * span * square(to_neighbours(last, before, rate, JUMP_OF_RATE))


def is_better(rotor: Rotor, other: Rotor, accel: Vector, mag: Vector) -> bool:
    """Whether gravity and north are much nearer to where they belong by ``rotor``."""
    return off(rotor, accel, mag) < BETTER * off(other, accel, mag)


def off(rotor: Rotor, accel: Vector, mag: Vector) -> float:
    """How far up and north are off by a rotor (sensor → earth): 1 − cos of each, 0 if not seen."""
    sum_ = 0.0
    if usable(accel):
        _, _, z = rotate(rotor, accel)
        sum_ += 1.0 - z / math.sqrt(square(accel))
    if heard(mag):
        x, y, _ = rotate(rotor, mag)
        sum_ += 1.0 - x / math.sqrt(x * x + y * y + 1e-30)
    return sum_


def put_right(seen: Seen, turn: Rotor, accel: Vector) -> Vector:
    """The force that undoes in a low-pass, which is linear, what the last did if it was none."""
    _, _, force, before = seen
    if not usable(force):
        return accel
    knock = to_neighbours(force, before, accel, JUMP_OF_FORCE)
    if square(knock) == 0.0:
        return accel
    x, y, z = total(accel, carried(turn, knock))
    length = math.sqrt(x * x + y * y + z * z)
    if length >= STRONGEST:  # it would be taken for none itself
        scale = 0.99 * STRONGEST / length
        x, y, z = scale * x, scale * y, scale * z
    return (x, y, z)


def to_neighbours(last: Vector, before: Vector, after: Vector, jump: float) -> Vector:
    """From the last vector to the mean of its neighbours if they agree without it; else zero."""
    one, other = minus(before, last), minus(after, last)
    far = min(square(one), square(other))
    if not (far > jump * jump and square(minus(one, other)) <= ALIKE * far):
        return ZERO
    return (0.5 * (one[0] + other[0]), 0.5 * (one[1] + other[1]), 0.5 * (one[2] + other[2]))


def is_glitch(mag: Vector, last: Vector, age: float, dt: float) -> bool:
    """Whether a field differs by more than itself from a last good one, ``age`` s old; no if none.

    Both are in the earth frame.
    """
    if last == ZERO or age - dt >= STAYS or dt >= STAYS:
        return False
    return square(minus(mag, last)) > min(square(mag), square(last))


def middle(u: Vector, v: Vector) -> Vector:
    """The mean of two vectors."""
    return (0.5 * (u[0] + v[0]), 0.5 * (u[1] + v[1]), 0.5 * (u[2] + v[2]))


def square(v: Vector) -> float:
    """Of the length."""
    return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
