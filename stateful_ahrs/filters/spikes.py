"""What a single bad sample may do: one that neither of its neighbours confirms is taken back.

A motion does not turn faster by 4 rad/s for one sample and is back with the next; a glitch on the
bus does. A rate and a force are taken back with the next sample; a field that differs from the
last good one by more than itself is not taken, unless it stays. In steps above 22 ms a motion may
turn and turn back: there a rate is taken back only if gravity and field say so too, and else
doubted. A start is one sample: if the next contradicts it, that is the start.

Not in the paper, and off where a filter is the paper's.
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
BETTER = 0.25  # of a misfit: half of the angle
START_OFF = 0.03  # likewise: 1 − cos 14°
STAYS = 0.25  # s: after as long nothing is a glitch


# What is remembered for it, beside the last good rate: the rate before it (rad/s), the time that
# the last one turned for (s; negative where the mean of both did, in a gap), the last force and the
# one before (m/s²), the field before the last (earth frame). Without names, because one is made for
# each sample.
Seen = tuple[Vector, float, Vector, Vector, Vector]
UNSEEN: Seen = (ZERO, 0.0, ZERO, ZERO, ZERO)


def is_far(u: Vector, v: Vector, jump: float) -> bool:
    """Whether two vectors are further apart than that: one of them may be a glitch."""
    ux, uy, uz = u
    vx, vy, vz = v
    x, y, z = ux - vx, uy - vy, uz - vz
    return x * x + y * y + z * z > jump * jump


def way_back(last: Vector, seen: Seen, rate: Vector) -> Rotor:
    """What takes back the last turn if its rate (rad/s) was none; else the identity."""
    before, span, _, _, _ = seen
    meant = total(last, to_neighbours(last, before, rate, JUMP_OF_RATE))
    if span < 0.0:
        span, last, meant = -span, middle(before, last), middle(before, meant)
    return product(conjugate(from_rate(last, span)), from_rate(meant, span))


def variance_doubted(last: Vector, seen: Seen, rate: Vector) -> float:
    """Variance (rad²) of the last turn, as its rate (rad/s) may have been none; else 0."""
    before, span, _, _, _ = seen
    if span < 0.0:
        span *= 0.5
    return span * span * square(to_neighbours(last, before, rate, JUMP_OF_RATE))


def is_better(rotor: Rotor, other: Rotor, accel: Vector, mag: Vector, field: Vector) -> bool:
    """Whether gravity and field are much nearer to where they were by ``rotor``; see `misfit`."""
    return misfit(rotor, accel, mag, field) < BETTER * misfit(other, accel, mag, field)


def contradicts(rotor: Rotor, seen: Seen, accel: Vector, mag: Vector, field: Vector) -> bool:
    """Whether a sample shows that the start was none; not three times in a row. See `misfit`."""
    again = seen[3] != ZERO
    return not again and usable(accel) and misfit(rotor, accel, mag, field) > START_OFF


def misfit(rotor: Rotor, accel: Vector, mag: Vector, field: Vector) -> float:
    """How far up and ``field`` (earth frame) are off by a rotor (sensor → earth).

    The sum of 1 − cos of both angles, 0 for what is not there.
    """
    found = 0.0
    if usable(accel):
        up = rotate(rotor, accel)
        found += 1.0 - up[2] / math.sqrt(square(up))
    if heard(mag) and heard(field):
        x, y, z = rotate(rotor, mag)
        along = x * field[0] + y * field[1] + z * field[2]
        found += 1.0 - along / math.sqrt(square((x, y, z)) * square(field))
    return found


def put_right(seen: Seen, turn: Rotor, accel: Vector) -> Vector:
    """The force that undoes in a low-pass, which is linear, what the last did if it was none."""
    _, _, force, before, _ = seen
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
