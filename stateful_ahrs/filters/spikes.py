"""What a single bad sample may do: one that neither of its neighbours confirms is taken back.

A motion does not turn faster by 4 rad/s for one sample and is back with the next; a glitch on the
bus does. A rate and a force are taken back with the next sample; a field that differs from the
last good one by more than itself is not taken, unless it stays. In a vibration each sample jumps,
and no rate or force is taken back. In steps above 22 ms a motion may turn and turn back: there a
rate is taken back only if no motion is as abrupt, or if gravity and field say so too, and else
doubted. A start is one sample, and a first heading one field: if the next contradicts it, that is
the start, or the first heading. Beside a gap see `gaps`.

Not in the paper, and off where a filter is the paper's.
"""

from __future__ import annotations

import math

from ..rotor import Rotor, Vector, conjugate, from_rate, minus, product, rotate, total
from .gains import START_LOW_PASSED
from .learning import LEVEL
from .senses import ASKED, DOUBTED, FIRST_HEADING, Senses, heard, usable

ZERO: Vector = (0.0, 0.0, 0.0)
JUMP_OF_RATE = 4.0  # rad/s
JUMP_OF_FORCE = 30.0  # m/s²
JUMP_AT_START = 6.0  # m/s²: as each is much of a start's mean
ALIKE = 1.0 / 16.0  # of the square of the jump: how near the two neighbours are
CHANGE = 20.0  # rad/s²: in a gap a rate may well change so
SHORT = 0.022  # s: in longer steps a motion may well turn and turn back
BETTER = 0.25  # of a misfit: half of the angle
ABRUPT = 400.0  # rad/s²: in no motion does a rate come and go as fast
AGREEING = math.cos(math.radians(14.0))  # of the angle between two starts
STAYS = 0.25  # s: after as long nothing is a glitch
SELDOM = 1.0  # s: a field as old contradicts none; and what is taken back more often may vibrate
FOURFOLD = 4.0  # of the square of a field: twice as strong


# What is remembered for it, beside the last good rate: the rate before it (rad/s), the time that
# the last one turned for (s; negative where the mean of both did, in a gap), the last force and the
# one before (m/s²), the field before the last (earth frame; while a sample after a gap waits, its
# own, as it was measured), and the time since samples last jumped (s; 0 where the last one was the
# first to). Without names, because one is made for each sample.
Seen = tuple[Vector, float, Vector, Vector, Vector, float]
UNSEEN: Seen = (ZERO, 0.0, ZERO, ZERO, ZERO, SELDOM)


def is_far(u: Vector, v: Vector, jump: float) -> bool:
    """Whether two vectors are further apart than that: one of them may be a glitch."""
    ux, uy, uz = u
    vx, vy, vz = v
    x, y, z = ux - vx, uy - vy, uz - vz
    return x * x + y * y + z * z > jump * jump


def jump_of_force(elapsed: float) -> float:
    """How far off (m/s²) a force may be a glitch, where means are of so long (s)."""
    return JUMP_AT_START if elapsed < START_LOW_PASSED else JUMP_OF_FORCE


def jumps(rate: Vector, last: Vector, accel: Vector, before: Vector, elapsed: float) -> bool:
    """Whether rate (rad/s) or force (m/s²) is so far from the one before that one may be a glitch.

    One function, as it is asked of each sample.
    """
    x, y, z = rate
    lx, ly, lz = last
    x, y, z = x - lx, y - ly, z - lz
    if x * x + y * y + z * z > JUMP_OF_RATE * JUMP_OF_RATE:
        return True
    x, y, z = accel
    lx, ly, lz = before
    x, y, z = x - lx, y - ly, z - lz
    jump = jump_of_force(elapsed)
    return x * x + y * y + z * z > jump * jump


def is_rare(seen: Seen) -> bool:
    """Whether of late no sample jumped but the last: else it is no glitch, but a vibration."""
    return seen[5] == 0.0 or seen[5] >= SELDOM


def since_jump(seen: Seen, dt: float) -> float:
    """The time since samples last jumped (s) where one does, ``dt`` s after the last."""
    return 0.0 if seen[5] >= SELDOM else dt


def cleared(
    rotor: Rotor,
    turn: Rotor,
    rate: Vector,
    last: Vector,
    seen: Seen,
    accel: Vector,
    mag: Vector,
    mean: Vector,
    time: float,
    elapsed: float,
    dt: float,
) -> tuple[Rotor, int, float, Vector, float]:
    """What becomes of a step of ``dt`` s by ``turn`` where the last rate or force may be none.

    Takes the rotor before the step (sensor → earth), the rate and the last one (rad/s), specific
    force (m/s²) and field of this sample, the mean of forces (m/s², earth frame) over ``time`` s, 0
    if there is none, and the time since the start (s). Returns turn, whether it takes back the last
    one, and variance as `judged` does, mean and time as `put_right` does.
    """
    taken_back, doubt, undone = 0, 0.0, 0.0
    if is_far(rate, last, JUMP_OF_RATE):
        turn, taken_back, doubt = judged(rotor, turn, rate, last, seen, accel, mag, elapsed, dt)
    jump = jump_of_force(elapsed)
    if time > 0.0 and is_far(accel, seen[2], jump):
        mean, undone = put_right(mean, time, rotor, turn, seen, accel, jump)
    return turn, taken_back, doubt, mean, undone


def judged(
    rotor: Rotor,
    turn: Rotor,
    rate: Vector,
    last: Vector,
    seen: Seen,
    accel: Vector,
    mag: Vector,
    elapsed: float,
    dt: float,
) -> tuple[Rotor, int, float]:
    """Whether a step takes back the last rate; the arguments are those of `cleared`.

    Returns the turn, which takes back the last one or not; whether it does; and the variance (rad²)
    of the last one where that stays open.
    """
    knock = to_neighbours(last, seen[0], rate, JUMP_OF_RATE)
    if knock == ZERO:
        return turn, 0, 0.0
    back = product(way_back(last, seen, knock), turn)
    if elapsed > STAYS and is_abrupt(knock, dt, seen):
        return back, 1, 0.0
    better = is_better(product(rotor, back), product(rotor, turn), accel, mag, seen[4])
    # A start takes so much of each sample that it has taken back much itself, or in part.
    doubt = 0.0 if better and elapsed > STAYS else variance_doubted(seen, knock)
    return back if better else turn, int(better), doubt


def way_back(last: Vector, seen: Seen, knock: Vector) -> Rotor:
    """What takes back the last turn, whose rate (rad/s) was ``knock`` off."""
    before, span, _, _, _, _ = seen
    meant = total(last, knock)
    if span < 0.0:
        span, last, meant = -span, middle(before, last), middle(before, meant)
    return product(conjugate(from_rate(last, span)), from_rate(meant, span))


def is_abrupt(knock: Vector, dt: float, seen: Seen) -> bool:
    """Whether no motion comes and goes so in two steps: of a rate that is ``knock`` off (rad/s)."""
    longest = max(dt, abs(seen[1]))
    return longest < SHORT or square(knock) > (ABRUPT * longest) ** 2


def variance_doubted(seen: Seen, knock: Vector) -> float:
    """Variance (rad²) of the last turn, as its rate may have been ``knock`` off (rad/s)."""
    span = seen[1] if seen[1] > 0.0 else 0.5 * seen[1]
    return span * span * square(knock)


def is_better(rotor: Rotor, other: Rotor, accel: Vector, mag: Vector, field: Vector) -> bool:
    """Whether gravity and field are much nearer to where they were by ``rotor``; see `misfit`."""
    return misfit(rotor, accel, mag, field) < BETTER * misfit(other, accel, mag, field)


def contradicts(rotor: Rotor, seen: Seen, accel: Vector) -> bool:
    """Whether gravity shows that the start was none; not three times in a row."""
    if seen[3] != ZERO or not usable(accel):
        return False
    up = rotate(rotor, accel)
    return up[2] < AGREEING * math.sqrt(square(up))


def confirmed(
    senses: Senses, field: Vector, mag: Vector, rotor: Rotor, dt: float, corrects: bool
) -> tuple[Senses, Vector, Vector]:
    """What is known of a heading that one ``field`` (earth frame) told, now that the next came.

    It is given up if they contradict, but not three times in a row; and so is the field. The next
    one, ``mag``, is in the sensor frame, and ``rotor`` (sensor → earth) predicted; if no field
    ``corrects`` heading, it confirms, and if it is along gravity, it does not. After a gap, of
    which no field is left, one twice or half as strong as the last is not taken, if a heading was
    known before: then ``mag`` is NaN, and the next is believed.
    """
    (
        rate, last_mag, mag_age, started, heading_known, turned, sign_corrections, gyro_rejected,
        accel_rejected, mag_rejected,
    ) = senses  # fmt: skip
    found = rotate(rotor, mag)
    x, y, _ = found
    level = x * x + y * y
    if level <= LEVEL * LEVEL * square(found):
        return senses, field, mag
    off = is_glitch(found, field, mag_age + dt, dt) or x < AGREEING * math.sqrt(level)
    known = heading_known == 1 or heading_known == ASKED
    if known and corrects and field == ZERO and is_other(mag, last_mag, mag_age + dt, dt):
        heading_known = DOUBTED if heading_known == 1 else FIRST_HEADING
        mag_rejected += 1
        mag = (math.nan, math.nan, math.nan)
    elif heading_known <= 1 or heading_known == DOUBTED:
        heading_known = min(heading_known, 1)
    elif corrects and off and field == ZERO:  # by the gap, where it was known before
        mag_rejected += int(heading_known <= FIRST_HEADING)
        heading_known = 0
    elif corrects and off:
        heading_known -= FIRST_HEADING + 1
        mag_rejected += 1
        field = ZERO
    else:
        heading_known = 1
    senses = Senses(
        rate, last_mag, mag_age, started, heading_known, turned, sign_corrections, gyro_rejected,
        accel_rejected, mag_rejected,
    )  # fmt: skip
    return senses, field, mag


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


def put_right(
    mean: Vector, time: float, rotor: Rotor, turn: Rotor, seen: Seen, accel: Vector, jump: float
) -> tuple[Vector, float]:
    """A mean of forces (earth frame) over ``time`` s without the last one, if that was none.

    ``rotor`` (sensor → earth) is that of the last, ``turn`` the one since, ``accel`` (m/s²) what
    came after it, ``jump`` (m/s²) how far one that is none is off. Also returns for how long (s)
    it counted, 0 if it stays.
    """
    _, span, force, before, _, _ = seen
    if not (usable(force) and usable(accel) and span > 0.0):
        return mean, 0.0
    after = rotate(turn, accel)
    knock = to_neighbours(force, before, after, jump)
    if before == ZERO and knock != ZERO:  # the first after a start, four times as long as the next
        knock = minus(after, force)
    elif knock == ZERO or not usable(before):
        return mean, 0.0
    share = span / time
    x, y, z = rotate(rotor, knock)
    return (mean[0] + share * x, mean[1] + share * y, mean[2] + share * z), span


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
    if last == ZERO or age - dt >= SELDOM or dt >= STAYS:
        return False
    return square(minus(mag, last)) > min(square(mag), square(last))


def is_other(mag: Vector, last: Vector, age: float, dt: float) -> bool:
    """Whether a field is twice or half as strong as a last good one, ``age`` s old; no if none."""
    strength, usual = square(mag), square(last)
    return age - dt < SELDOM and max(strength, usual) > FOURFOLD * min(strength, usual)


def likely(before: Vector, last: Vector, after: Vector) -> Vector:
    """What the last vector was if one of the three may be none.

    It is the odd one if the next is nearer to the one before; then their median, axis by axis.
    """
    if square(minus(after, before)) > square(minus(last, before)):
        return last
    return (
        of_three(before[0], last[0], after[0]),
        of_three(before[1], last[1], after[1]),
        of_three(before[2], last[2], after[2]),
    )


def of_three(a: float, b: float, c: float) -> float:
    """Neither the least nor the largest."""
    return max(min(a, b), min(max(a, b), c))


def shorter(u: Vector, v: Vector) -> Vector:
    """Of two vectors."""
    return u if square(u) < square(v) else v


def over_gap(before: Vector, after: Vector, span: float) -> Vector:
    """The rate (rad/s) in a gap of ``span`` s, by those at its ends.

    If they are further apart than in a motion, the latter may be none.
    """
    far = is_far(before, after, JUMP_OF_RATE + CHANGE * span)
    return before if far else middle(before, after)


def middle(u: Vector, v: Vector) -> Vector:
    """The mean of two vectors."""
    return (0.5 * (u[0] + v[0]), 0.5 * (u[1] + v[1]), 0.5 * (u[2] + v[2]))


def square(v: Vector) -> float:
    """Of the length."""
    return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
