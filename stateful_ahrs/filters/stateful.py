"""The stateful complementary filter of Kusaka and Tanaka (eq. 12 and 16), and its calibration.

The gyroscope path ``q ⊗ q_ω`` and the snapshot of accelerometer and magnetometer are blended
element by element, which is allowed because the snapshot takes the sign that continues the
gyroscope path. Only multiplications, additions and square roots, but for the power of α.

Beside it a slow room (`learning`) looks back twice a second and hands better inputs to the same
step: rates less their bias and through the misalignment, a magnetic field freed of hard iron and
of its delay, how far to trust it, and how fast heading should follow it.

Deviations from the paper
- The rotor of eq. 12 is exact (eq. 11) where one step turns by more than 0.2 rad.
- Eq. 14 multiplies the gyroscope's rotor on the left, as if rates were measured in the earth
  frame. A strapped-down gyroscope measures in the sensor frame: the rotor goes on the right.
- The sign of the snapshot is compared with the predicted rotor; eq. 3 has the last one.
- The paper leaves the start open: the first snapshot is taken as it is, after a restart with the
  sign that continues, and so is the first heading that a magnetometer gives.
- The paper blends once for each sample of all three sensors. Here α may be given for a fixed
  span of time, and a magnetometer sample that is missing, stale or useless costs only its
  heading: the snapshot is then taken with the north that the gyroscope predicts.

Not in the paper, each with a switch in `Settings`, all off where the filter is called the paper's:
the slow room's parts, and with any of them care about missing samples (`gaps`); single bad samples
taken back (`spikes`); up low-passed, and heading corrected slower (or faster) than tilt
(`correction`); the rotor normalised after each blend; a start that is the mean of all samples so
far.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ..rotor import (
    IDENTITY,
    Rotor,
    Vector,
    blend,
    carried,
    conjugate,
    from_rate,
    minus,
    negative,
    product,
    rotate,
    slightly,
    total,
    unit,
)
from .compiled import bind, compiled, packed, run_steps
from .correction import NO_EARTH, Earth, corrected, toward, uprighted
from .gains import (
    AVERAGED,
    NO_PACE,
    START_LOW_PASSED,
    Gains,
    Pace,
    at_start,
    gains,
    paced,
    plain_gains,
    weight_of_gyro,
)
from .gaps import (
    ALL_LOST,
    COUNTS,
    GAP,
    MUCH_LOST,
    OFTEN,
    is_gap,
    left_of,
    variance_lost,
    variance_over_gap,
)
from .kernel import NO_MAG, Kernel, KernelFilter, Report
from .learning import (
    COLUMNS,
    IRON_SEEN,
    LOG,
    LOW_PASS,
    MISALIGNMENT_SEEN,
    ROW_TIME,
    ROWS,
    SIZE,
    WINDOW,
    Floats,
    Learned,
    Room,
    Window,
    attitude_lost,
    begin,
    first_heading,
    hear,
    lasting,
    learn,
    less_sure,
    measure,
    memory,
    start_anew,
)
from .samples import Array, Samples
from .senses import (
    ASKED,
    FASTEST,
    Senses,
    Sources,
    amended,
    came,
    heard,
    held,
    look,
    usable,
)
from .settings import DEFAULTS, Known
from .settings import Settings as Settings
from .spikes import (
    JUMP_OF_RATE,
    SELDOM,
    STAYS,
    UNSEEN,
    ZERO,
    Seen,
    cleared,
    confirmed,
    contradicts,
    is_far,
    is_rare,
    jump_of_force,
    jumps,
    likely,
    middle,
    over_gap,
    put_right,
    shorter,
    since_jump,
    square,
    variance_doubted,
    way_back,
)
from .stamps import steps

NEAR_UNIT = 1e-6  # of the square of a length: one step of Newton is then as good as the root
BELIEVED = 0.5  # trust of a field one standard deviation off
DISTURBED = 0.05  # trust of a field three standard deviations off


# What happened since the slow room last looked back: the time (s), the corrections (rad, earth
# frame), the rows of the log, the time since the last row, and since the last with a magnetic field
# (s), the last step (s), the variance of turns that no rate told (rad²), for how long a rate is
# being held (s; while a sample after a gap waits, -1 less a part of that variance), and how
# long before all that the last gap was (s). Without names, because one is made for each sample.
Past = tuple[float, Vector, int, float, float, float, float, float, float]
NO_PAST: Past = (0.0, ZERO, 0, 0.0, 1.0, 0.0, 0.0, 0.0, OFTEN)


class State(NamedTuple):
    """All that the filter carries from sample to sample."""

    rotor: Rotor = IDENTITY  # sensor → earth (NWU); of unit length only if normalised
    senses: Senses = Senses()
    elapsed: float = 0.0  # s since the start; less after a gap, see `gaps`
    predicted: Rotor = IDENTITY  # before the last correction
    pace: Pace = NO_PACE
    learned: Learned = Learned()
    past: Past = NO_PAST
    row: float = 0.0  # s since the last row of the log, if this sample is one
    due: bool = False  # the slow room should look back before the next sample
    seen: Seen = UNSEEN
    earth: Earth = NO_EARTH


predict = product  # the gyroscope path (eq. 14), the turn on the right: in the sensor frame


def predict_as_printed(rotor: Rotor, turn: Rotor) -> Rotor:
    """Eq. 14 as printed, the turn on the left, as if rates were measured in the earth frame."""
    return product(turn, rotor)


def true_rate(learned: Learned, rate: Vector) -> Vector:
    """The rate (rad/s) less bias and misalignment."""
    x, y, z = rate
    bx, by, bz = learned.bias
    x, y, z = x - bx, y - by, z - bz
    xx, xy, xz = learned.row_x
    yx, yy, yz = learned.row_y
    zx, zy, zz = learned.row_z
    return (
        xx * x + xy * y + xz * z,
        yx * x + yy * y + yz * z,
        zx * x + zy * y + zz * z,
    )


def true_field(learned: Learned, mag: Vector, rate: Vector) -> Vector:
    """The magnetic field less hard iron and delay; as it is if it can be none."""
    square = mag[0] * mag[0] + mag[1] * mag[1] + mag[2] * mag[2]
    if not 1e-24 < square < 1e24:
        return mag
    hx, hy, hz = learned.hard_iron
    x, y, z = mag[0] - hx, mag[1] - hy, mag[2] - hz
    late, (wx, wy, wz) = learned.delay, rate
    return (
        x - late * (wy * z - wz * y),
        y - late * (wz * x - wx * z),
        z - late * (wx * y - wy * x),
    )


def guessed(
    last: Senses,
    learned: Learned,
    past: Past,
    rate: Vector,
    turn_rate: Vector,
    gyro_rejected: int,
    dt: float,
) -> tuple[Vector, float, float, float]:
    """What a step turned by (rad/s) if its rate is held or it is a gap.

    Also returns the variance (rad²) of what it turned, for how long a rate is being held (s), and
    the step for `Seen`.
    """
    if gyro_rejected > last.gyro_rejected and dt > 0.0:
        held_for = past[7] + dt
        lost = variance_lost(turn_rate, turn_rate, held_for)
        return turn_rate, lost - variance_lost(turn_rate, turn_rate, past[7]), held_for, dt
    if is_gap(dt, past[5]):
        before = true_rate(learned, last.rate)
        may_be_none = is_far(rate, last.rate, JUMP_OF_RATE)
        lost = variance_lost(before, before if may_be_none else turn_rate, dt)
        return middle(before, turn_rate), lost, 0.0, -dt
    return turn_rate, 0.0, 0.0, dt


def step(state: State, gains: Gains, gyro: Vector, accel: Vector, mag: Vector, dt: float) -> State:
    """Take one sample of all sensors, ``dt`` s after the last; 0 starts anew (eq. 16).

    The second one is the start if it contradicts the first.
    """
    rotor, last, elapsed, _, pace, learned, past, _, _, seen, earth = state
    (
        sources, alpha, _, _, _, stateful, normalise, average_start, despike, low_pass, corrects,
        learns, turns, _,
    ) = gains  # fmt: skip
    rate, gyro_rejected = held(last, gyro)
    turn_rate = rate
    if corrects:
        turn_rate = true_rate(learned, rate)
        if mag[0] == mag[0]:
            mag = true_field(learned, mag, turn_rate)
    lost, held_for, span = 0.0, 0.0, dt
    if learns and (dt > GAP or gyro_rejected > last.gyro_rejected):
        turn_rate, lost, held_for, span = guessed(
            last, learned, past, rate, turn_rate, gyro_rejected, dt
        )
    turn = from_rate(turn_rate, dt)
    undone = 0.0
    if despike:
        jumped = seen[5] + dt
        if 0.0 < dt < STAYS:
            second = elapsed == 0.0 == earth[1] and last.started
            if second and contradicts(predict(rotor, turn), seen, accel):
                # No field is carried by a turn that may be none.
                last, span = amended(last, False, 0, math.inf, last.accel_rejected + 1), 0.0
            far = span > 0.0 and jumps(rate, last.rate, accel, seen[2], elapsed)
            if far and seen[2] != ZERO:  # else there was none to jump from
                jumped = since_jump(seen, dt)
            if far and is_rare(seen):
                time = earth[1] if low_pass else 0.0
                turn, taken_back, doubt, mean, undone = cleared(
                    rotor, turn, rate, last.rate, seen, accel, mag, earth[0], time, elapsed, dt
                )
                earth = (mean, earth[1], earth[2])
                if undone > 0.0 and elapsed < START_LOW_PASSED and average_start:
                    # The last force turned it, too.
                    rotor, earth, past = at_once(rotor, earth, past)
                gyro_rejected += taken_back
                accel_rejected = last.accel_rejected + int(undone > 0.0)
                last = amended(last, last.started, last.heading_known, last.mag_age, accel_rejected)
                if learns:
                    lost += doubt
        # What a start takes is in no low-pass, and nothing has turned by it.
        seen = (
            (last.rate, span, accel, seen[2], earth[2], jumped)
            if dt > 0.0
            else (last.rate, 0.0, ZERO, ZERO, ZERO, SELDOM)
        )
    if lost > 0.0 and alpha < 1.0 and gains.alpha_heading < 1.0:
        mean, time, field = earth
        if lost > MUCH_LOST:
            field = ZERO  # the next may be anywhere
        earth = (mean, left_of(min(time, LOW_PASS), lost), field)
        elapsed = left_of(min(elapsed, AVERAGED), lost)
    if span < 0.0:
        since, applied, rows, row_time, mag_row_time, last_step, doubt, waited, _ = past
        past = (since, applied, rows, row_time, mag_row_time, last_step, doubt, waited, -since)
    predicted = predict(rotor, turn)
    if dt != pace[0]:
        pace = paced(gains, pace, dt)
    weight = pace[1]
    starts = dt <= 0.0 or not last.started
    if average_start and elapsed < AVERAGED + undone and not starts:
        weight = at_start(gains, weight, elapsed - undone, dt)
    elapsed += dt
    begins = False
    if turns and not starts:
        if not normalise:
            predicted = unit(predicted)
        nudge = ZERO
        if learns and past[0] < WINDOW and alpha < 1.0:
            x, y, z = learned.drift  # what the slow room found out of the past
            half = 0.5 * dt
            nudge = (half * x, half * y, half * z)
        if (last.heading_known > 1 or earth[2] == ZERO) and heard(mag):
            follows = despike and sources.use_mag
            follows = follows and alpha < 1.0 and gains.alpha_heading < 1.0
            last, field, mag = confirmed(last, earth[2], mag, predicted, dt, follows)
            earth = (earth[0], earth[1], field)
        senses, earth, begins, change = corrected(
            last, earth, gains, learned, rate, gyro_rejected, accel, mag, predicted, nudge,
            pace, weight, elapsed, dt,
        )  # fmt: skip
        rotor = product(change, predicted)
    else:
        change = IDENTITY
        felt = (turn, rate, gyro_rejected)
        senses, found, _, begins, rotor = look(last, sources, felt, accel, mag, predicted, dt)
        if begins:
            if starts:
                elapsed = 0.0
                earth = (rotate(rotor, accel), 0.0, rotate(rotor, senses.mag))
        elif found:
            if senses.turned and not stateful:
                rotor = negative(rotor)
            rotor = blend(predicted, rotor, weight)  # eq. 16
        else:
            rotor = predicted
    w, x, y, z = rotor
    square = w * w + x * x + y * y + z * z
    if not square > 1e-12:  # only a stateless blend of opposite signs can vanish
        rotor = predicted
    elif normalise and stateful:
        if abs(square - 1.0) < NEAR_UNIT:  # a root would take longer
            scale = 1.5 - 0.5 * square
            rotor = (scale * w, scale * x, scale * y, scale * z)
        else:
            rotor = unit(rotor)
    row, due = 0.0, False
    if learns:
        fresh = sources.use_mag and senses.mag_age == 0.0
        past, row, due = passed(past, fresh, change, elapsed, dt, lost, held_for, begins, starts)
    return State(rotor, senses, elapsed, predicted, pace, learned, past, row, due, seen, earth)


def take(
    state: State, gains: Gains, gyro: Vector, accel: Vector, mag: Vector, dt: float
) -> tuple[State, Vector, Vector]:
    """A `step`, but after a gap, where a single bad sample would stand for all of it.

    There the first sample waits for the second, and of the two no single bad one has a say. Units
    are those of `step`. Also returns force and field for the log, as the step took them.
    """
    if (dt > GAP or state.past[7] < 0.0) and gains.learns and gains.despike:
        since, _, _, _, _, last_step, _, waiting, gap_before = state.past
        if waiting == 0.0 and dt > GAP and is_gap(dt, last_step):
            rate, gyro_rejected = held(state.senses, gyro)
            if gyro_rejected == state.senses.gyro_rejected:
                return wait(state, gains, rate, accel, mag, dt), accel, mag
        if waiting < 0.0 < dt:
            if gap_before + since < OFTEN:
                state, mag = replay(state, gains, gyro, accel, mag, dt)
                return step(state, gains, gyro, accel, mag, dt), accel, mag
            state, accel, mag, lost = resume(state, gains, gyro, accel, mag, dt)
            state = step(state, gains, gyro, accel, mag, dt)
            return (forgotten(state) if lost else state), accel, mag
    return step(state, gains, gyro, accel, mag, dt), accel, mag


def wait(state: State, gains: Gains, rate: Vector, accel: Vector, mag: Vector, dt: float) -> State:
    """Turn over a gap by the rates (rad/s) at its ends, and keep force and field for what comes."""
    rotor, last, elapsed, _, pace, learned, past, _, _, seen, earth = state
    earlier = seen[0]
    before = likely(earlier, last.rate, rate) if is_rare(seen) else last.rate
    turn = from_rate(true_rate(learned, over_gap(before, rate, dt)), dt)
    gyro_rejected, accel_rejected = last.gyro_rejected, last.accel_rejected
    if is_far(before, last.rate, JUMP_OF_RATE):
        gyro_rejected += 1
        turn = product(way_back(last.rate, seen, minus(before, last.rate)), turn)
    jump = jump_of_force(elapsed)
    far = gains.low_pass and earth[1] > 0.0 and is_far(accel, seen[2], jump)
    if far and is_rare(seen):
        mean, undone = put_right(earth[0], earth[1], rotor, turn, seen, accel, jump)
        earth = (mean, earth[1], earth[2])
        if undone > 0.0:
            accel_rejected += 1
        if undone > 0.0 and elapsed < START_LOW_PASSED and gains.average_start:
            rotor, earth, past = at_once(rotor, earth, past)
    fresh = heard(mag)
    senses = Senses(
        rate,
        last.mag,
        last.mag_age + dt,
        last.started,
        last.heading_known,
        last.turned,
        last.sign_corrections,
        gyro_rejected,
        accel_rejected + int(not usable(accel)),
        last.mag_rejected + int(came(mag) and not fresh),
    )
    seen = (before, -dt, accel, carried(turn, seen[2]), mag if fresh else ZERO, seen[5])
    variance = variance_over_gap(before, rate, dt)
    more = max(0.0, variance_over_gap(earlier, rate, dt) - variance)
    time, applied, rows, row_time, mag_row_time, step, doubt, _, gap_before = past
    past = (time, applied, rows, row_time, mag_row_time, step, doubt, -1.0 - more, gap_before)
    learned = less_sure(learned, variance + more)
    rotor = unit(product(rotor, turn))
    return State(rotor, senses, elapsed, rotor, pace, learned, past, 0.0, False, seen, earth)


def resume(
    state: State, gains: Gains, gyro: Vector, accel: Vector, mag: Vector, dt: float
) -> tuple[State, Vector, Vector, bool]:
    """Tell a gap anew, now that the second sample after it is there, ``dt`` s after the first.

    Returns the state as if the first sample had been the `likely` one of its neighbours and itself,
    and for `step` the likely force (m/s²) of both, the field `of_both`, and whether nothing is left
    known of the attitude.
    """
    rotor, last, elapsed, predicted, pace, learned, past, _, _, seen, earth = state
    before, span, first, force_before, first_mag, jumped = seen
    since, applied, rows, row_time, mag_row_time, _, doubt, waiting, _ = past
    span = -span
    rate, _ = held(last, gyro)
    turn = from_rate(true_rate(learned, rate), dt)
    mag, mag_rejected = of_both(first_mag, mag, turn, learned.hard_iron)
    accel_rejected = last.accel_rejected
    jump = jump_of_force(elapsed)
    rare = is_rare(seen)
    if rare and usable(first) and usable(force_before) and usable(accel):
        second = rotate(turn, accel)
        force = likely(force_before, first, second)
        if is_far(force, first, jump) or is_far(force, second, jump):
            accel_rejected += 1
        accel = carried(turn, force)
    elif usable(first) and not usable(accel):
        accel_rejected += 1
        accel = carried(turn, first)

    meant = likely(before, last.rate, rate) if rare else last.rate
    gap = from_rate(true_rate(learned, over_gap(before, last.rate, span)), span)
    anew = from_rate(true_rate(learned, middle(before, meant)), span)
    rotor = product(rotor, product(conjugate(gap), anew))
    lost = variance_doubted(seen, shorter(minus(rate, meant), minus(meant, before)))
    one = variance_over_gap(before, last.rate, span)
    lost += max(one, variance_over_gap(before, rate, span)) - (1.0 + waiting)

    mean, time, field = earth
    heading_known = last.heading_known
    since, row_time, mag_row_time = since + span, row_time + span, mag_row_time + span
    follows = gains.alpha < 1.0 and gains.alpha_heading < 1.0
    all_lost = follows and lost > ALL_LOST
    if all_lost:
        time = elapsed = 0.0
    elif follows:
        time = left_of(min(time, LOW_PASS), lost)
        elapsed = left_of(min(elapsed, AVERAGED), lost)
    if follows and lost > MUCH_LOST:
        field = ZERO  # the next may be anywhere
        hears = last.mag_age <= span + gains.sources.mag_timeout
        if hears and learned.trust > BELIEVED and heading_known == 1:
            heading_known = ASKED  # the next field is to confirm it
        since, rows, row_time, mag_row_time = 0.0, 0, 0.0, 0.0  # they would outvote the next
    if usable(accel):
        counts = min(span, COUNTS)
        time += counts
        mean = toward(mean, rotate(product(rotor, turn), accel), counts / time)
        elapsed += counts
    earth = (mean, time, field)
    if all_lost:  # up, as north will be told by it
        rotor, earth, _ = at_once(rotor, earth, past)
    senses = Senses(
        meant,
        last.mag,
        last.mag_age,
        last.started,
        heading_known,
        last.turned,
        last.sign_corrections,
        last.gyro_rejected + int(is_far(meant, last.rate, JUMP_OF_RATE)),
        accel_rejected,
        last.mag_rejected + mag_rejected,
    )
    seen = (before, 0.0, first, force_before, field, jumped + span)
    past = (since, applied, rows, row_time, mag_row_time, span, doubt + lost, 0.0, -since)
    state = State(
        rotor, senses, elapsed, predicted, pace, learned, past, 0.0, False, seen, earth,
    )  # fmt: skip
    return state, accel, mag, all_lost


def replay(
    state: State, gains: Gains, gyro: Vector, accel: Vector, mag: Vector, dt: float
) -> tuple[State, Vector]:
    """Take the sample that waited where gaps are usual, now that the next is there, ``dt`` s after.

    It is taken as any other, but its rate and force are the `likely` ones, and its field waits for
    the next sample's. Also returns the field `of_both`, for `step`.
    """
    rotor, last, elapsed, _, pace, learned, past, _, _, seen, earth = state
    before, span, first, force_before, first_mag, jumped = seen
    time, applied, rows, row_time, mag_row_time, last_step, doubt, waiting, gap_before = past
    span = -span
    rate, _ = held(last, gyro)
    turn = from_rate(true_rate(learned, rate), dt)
    mag, mag_rejected = of_both(first_mag, mag, turn, learned.hard_iron)
    rare = is_rare(seen)
    force = first
    if rare and usable(first) and usable(force_before) and usable(accel):
        force = likely(force_before, first, rotate(turn, accel))
    off = is_far(force, first, jump_of_force(elapsed))

    # As it was before the gap.
    meant = likely(before, last.rate, rate) if rare else last.rate
    senses = Senses(
        before,
        last.mag,
        last.mag_age - span,
        last.started,
        last.heading_known,
        last.turned,
        last.sign_corrections,
        last.gyro_rejected + int(is_far(meant, last.rate, JUMP_OF_RATE)),
        last.accel_rejected + int(off) - int(not usable(first)),
        last.mag_rejected + mag_rejected,
    )
    gap = from_rate(true_rate(learned, over_gap(before, last.rate, span)), span)
    learned = less_sure(learned, 1.0 + waiting - variance_over_gap(before, last.rate, span))
    past = (time, applied, rows, row_time, mag_row_time, last_step, doubt, 0.0, gap_before)
    rotor = product(rotor, conjugate(gap))
    seen = (before, 0.0, force_before, force_before, earth[2], jumped)
    state = State(rotor, senses, elapsed, rotor, pace, learned, past, 0.0, False, seen, earth)

    rotor, senses, elapsed, predicted, pace, learned, past, row, _, seen, earth = step(
        state, gains, meant, force, NO_MAG, span
    )
    if row > 0.0:  # the next is one, and for the time of both
        time, applied, rows, _, mag_row_time, last_step, doubt, waiting, gap_before = past
        past = (time, applied, rows - 1, row, mag_row_time, last_step, doubt, waiting, gap_before)
    return State(
        rotor, senses, elapsed, predicted, pace, learned, past, 0.0, False, seen, earth,
    ), mag  # fmt: skip


def of_both(first: Vector, second: Vector, turn: Rotor, iron: Vector) -> tuple[Vector, int]:
    """The field of two samples, in the frame of the second, ``turn`` after the first.

    It is the second one's, the first one's if that is none, and none if they contradict each other.
    Also returns how many are rejected. Only a field less hard ``iron`` turns with the sensor.
    """
    if not heard(first):
        return second, 0
    carried_on = total(carried(turn, minus(first, iron)), iron)
    if not heard(second):
        return carried_on, int(came(second))
    if square(minus(second, carried_on)) > min(square(second), square(carried_on)):
        return NO_MAG, 2
    return second, 0


def at_once(rotor: Rotor, earth: Earth, past: Past) -> tuple[Rotor, Earth, Past]:
    """Turn the rotor so that the mean of forces is up."""
    mean, time, field = earth
    since, (x, y, z), rows, row_time, mag_row_time, last_step, doubt, waiting, gap_before = past
    change = uprighted(mean, 1.0)
    _, i, j, k = change
    applied = (x + 2.0 * i, y + 2.0 * j, z + 2.0 * k)
    past = (since, applied, rows, row_time, mag_row_time, last_step, doubt, waiting, gap_before)
    earth = (slightly(change, mean), time, slightly(change, field))
    return product(change, rotor), earth, past


def forgotten(state: State) -> State:
    """The same, for the slow room to forget the attitude."""
    step = state.past[5]
    past = (-1.0, ZERO, 0, 0.0, 1.0, step, 0.0, 0.0, state.past[8] + state.past[0])
    return State(
        state.rotor, state.senses, state.elapsed, state.predicted, state.pace, state.learned, past,
        0.0, True, state.seen, state.earth,
    )  # fmt: skip


def passed(
    past: Past,
    fresh: bool,
    change: Rotor,
    elapsed: float,
    dt: float,
    lost: float,
    held_for: float,
    begins: bool,
    starts: bool,
) -> tuple[Past, float, bool]:
    """What the slow room should know of a step that turned the predicted rotor by ``change``.

    Also returns ``row`` and ``due`` of the `State`.
    """
    time, applied, rows, row_time, mag_row_time, _, doubt, _, gap_before = past
    if begins:
        gap_before = OFTEN if starts else gap_before + time + dt
        return (0.0, applied, 0, 0.0, 1.0, dt, 0.0, 0.0, gap_before), 0.0, True
    if starts:
        return NO_PAST, 0.0, False
    time, row_time, mag_row_time = time + dt, row_time + dt, mag_row_time + dt
    row = 0.0
    if row_time >= ROW_TIME or (fresh and mag_row_time >= ROW_TIME):
        rows += 1
        row, row_time = row_time, 0.0
        if fresh:
            mag_row_time = 0.0
    doubt += lost
    x, y, z = applied
    _, i, j, k = change
    window = WINDOW if elapsed > WINDOW else 0.25 * WINDOW
    return (
        (
            time,
            (x + 2.0 * i, y + 2.0 * j, z + 2.0 * k),
            rows,
            row_time,
            mag_row_time,
            dt,
            doubt,
            held_for,
            gap_before,
        ),
        row,
        rows > 0 and (time >= window - 0.5 * dt or rows == ROWS or doubt > MUCH_LOST),
    )


def note(memory: Floats, state: State, accel: Vector, mag: Vector) -> None:
    """Write the sample that made ``state`` into the log, as its last row, if it is to be one.

    After a gap the row says the rate at its end, not the mean that it turned by; the slow room,
    told of the gap, gives little on it.
    """
    if state.row == 0.0:
        return
    senses = state.senses
    _, _, rows, _, mag_row_time, _, _, _, _ = state.past
    at = LOG + COLUMNS * (rows - 1)
    memory[at], memory[at + 1], memory[at + 2], memory[at + 3] = state.predicted
    memory[at + 4], memory[at + 5], memory[at + 6] = senses.rate
    memory[at + 7], memory[at + 8], memory[at + 9] = accel
    memory[at + 10], memory[at + 11], memory[at + 12] = mag
    memory[at + 13] = state.row
    if not usable(accel):
        memory[at + 7] = math.nan
    if mag_row_time > 0.0:
        memory[at + 10] = math.nan


def look_back(state: State, room: Room, memory: Floats, gains: Gains) -> tuple[State, Room]:
    """The slow room's turn: after a window, a new start, or the first heading."""
    learned = state.learned
    time, applied, rows, row_time, mag_row_time, step, doubt, held_for, gap_before = state.past
    if rows > 0:
        _, kept = paced(gains, state.pace, step)
        tilt_rate = (1.0 - kept) / step
        heading_rate = -1.0
        if gains.alpha_heading >= 0.0:
            heading_kept = weight_of_gyro(gains.alpha_heading, gains.alpha_rate, step)
            heading_rate = (1.0 - heading_kept) / step
        elif not gains.chosen.weigh:
            heading_rate = tilt_rate
        starting = gains.average_start and state.elapsed < START_LOW_PASSED
        window = Window(
            rows,
            state.earth[0],
            applied,
            tilt_rate,
            heading_rate,
            starting,
            doubt,
        )
        room, learned = learn(memory, room, learned, window, gains.chosen)
    elif state.past[0] < 0.0:
        room, learned = attitude_lost(memory, room, learned)
    elif state.elapsed > 0.0:
        first_heading(memory, applied)
    else:
        room, learned = start_anew(memory, room, learned)
    gap_before += max(time, 0.0)
    past = (0.0, ZERO, 0, row_time, mag_row_time, step, 0.0, held_for, gap_before)
    state = State(
        state.rotor, state.senses, state.elapsed, state.predicted, state.pace, learned, past, 0.0,
        False, state.seen, state.earth,
    )  # fmt: skip
    return state, room


def is_usual(state: State, gyro: Vector, accel: Vector, dt: float) -> bool:
    """Whether the next sample, of these rates and forces, asks for no more than `USUAL` does.

    That is what `step` does but for starts, gaps and glitches, where the gains have ``turns``.
    """
    return (
        0.0 < dt <= GAP
        and state.senses.started
        and state.elapsed > 0.0
        and state.past[7] >= 0.0
        and abs(gyro[0]) + abs(gyro[1]) + abs(gyro[2]) < FASTEST
        and not jumps(gyro, state.senses.rate, accel, state.seen[2], state.elapsed)
    )


def put(rotors: Array, i: int, rotor: Rotor, normalised: bool) -> None:
    """Write one row of ``rotors`` (n, 4): a unit rotor."""
    if not normalised:
        rotor = unit(rotor)
    rotors[i, 0], rotors[i, 1], rotors[i, 2], rotors[i, 3] = rotor


def run(
    state: State,
    room: Room,
    memory: Floats,
    gains: Gains,
    gyro: Array,
    accel: Array,
    mag: Array,
    dts: Array,
    rotors: Array,
) -> tuple[State, Room]:
    """Fill ``rotors`` (n, 4) with unit rotors; a step of NaN repeats the last (skipped)."""
    normalised = gains.normalise and gains.stateful
    i = 0
    while i < len(dts):
        if state.due:
            state, room = look_back(state, room, memory, gains)
        while i < len(dts) and not state.due:  # above 33 Hz this takes nearly all of the time
            g = (gyro[i, 0], gyro[i, 1], gyro[i, 2])
            a = (accel[i, 0], accel[i, 1], accel[i, 2])
            m = (mag[i, 0], mag[i, 1], mag[i, 2])
            if not is_usual(state, g, a, dts[i]):
                break
            state = step(state, gains, g, a, m, dts[i])
            note(memory, state, a, m)
            put(rotors, i, state.rotor, normalised)
            i += 1
        if i < len(dts) and not state.due:
            if dts[i] == dts[i]:
                g = (gyro[i, 0], gyro[i, 1], gyro[i, 2])
                a = (accel[i, 0], accel[i, 1], accel[i, 2])
                m = (mag[i, 0], mag[i, 1], mag[i, 2])
                state, a, m = take(state, gains, g, a, m, dts[i])
                note(memory, state, a, m)
            put(rotors, i, state.rotor, normalised)
            i += 1
    return state, room


@cache
def runner() -> Callable[..., Any]:
    """`run`, compiled into one function but for what is long and seldom called.

    So `take` does with any sample what is to be done, and `USUAL` in the same function with most.
    """
    window, memory = Window(0, ZERO, ZERO, 0.0, 0.0, False, 0.0), np.zeros(SIZE)
    once = packed(measure, memory, 1.0, 1.0)  # in one place: else the code would fill the cache
    slow = bind(learn, measure=once, hear=bind(hear, measure=once))
    slow = packed(slow, memory, Room(), Learned(), window, gains(DEFAULTS).chosen)
    sample = State(), gains(DEFAULTS), ZERO, ZERO, ZERO, 1.0
    whole = packed(step, *sample)
    any_sample = bind(take, step=whole, replay=bind(replay, step=whole))
    often = bind(
        run,
        step=bind(USUAL, confirmed=packed(confirmed, Senses(), ZERO, ZERO, IDENTITY, 1.0, True)),
        take=packed(any_sample, *sample),
        look_back=bind(
            look_back, learn=slow, attitude_lost=packed(attitude_lost, memory, Room(), Learned())
        ),
    )
    return compiled(often, inline=True, fused=True)


def uncorrected(senses: Senses, earth: Earth, *_: object) -> tuple[Senses, Earth, bool, Rotor]:
    """Stands for `corrected` where it is not called: with it compiled in, all else is slower."""
    return senses, earth, False, IDENTITY


def unguessed(
    last: Senses, learned: Learned, past: Past, rate: Vector, turn_rate: Vector, *_: object
) -> tuple[Vector, float, float, float]:
    """Likewise for `guessed`."""
    return turn_rate, 0.0, 0.0, 0.0


def uncleared(
    rotor: Rotor,
    turn: Rotor,
    rate: Vector,
    last: Vector,
    seen: Seen,
    accel: Vector,
    mag: Vector,
    mean: Vector,
    *_: object,
) -> tuple[Rotor, int, float, Vector, float]:
    """Likewise for `cleared`."""
    return turn, 0, 0.0, mean, 0.0


def unlooked(
    senses: Senses, sources: Sources, *_: object
) -> tuple[Senses, bool, bool, bool, Rotor]:
    """Likewise for `look`."""
    return senses, False, False, False, IDENTITY


def uncontradicted(*_: object) -> bool:
    """Likewise for `contradicts`."""
    return False


# As `step` for a sample that `is_usual`, if the gains have ``turns``.
USUAL = bind(step, guessed=unguessed, cleared=uncleared, look=unlooked, contradicts=uncontradicted)
# As `step` if the gains have no ``turns``, and so no ``despike`` and no ``learns``.
PLAIN = bind(step, corrected=uncorrected, guessed=unguessed, cleared=uncleared)
STATEFUL = Kernel(step, State(), gains)
PRINTED = Kernel(bind(PLAIN, predict=predict_as_printed), State(), plain_gains)


def over(snapshot: Callable[..., Any]) -> Kernel:
    """The filter over another snapshot than the direct one (eq. 5–10)."""
    return Kernel(bind(PLAIN, look=bind(look, snapshot=snapshot)), State(), plain_gains)


@dataclass(frozen=True)
class LearnedReport(Report):
    """What was learned as well; vectors in the sensor frame.

    The standard deviations are those that hold on BROAD (see docs/accuracy.md).
    """

    learned_bias_rad_s: Vector
    misalignment: tuple[Vector, Vector, Vector]  # E: the true rate is (1 + E)(measured − bias)
    mag_delay_s: float  # after the gyroscope
    hard_iron: Vector  # left over, in the magnetometer's unit
    mag_trust: float  # 0 to 1
    field_changes: int  # how often another field took the place of the one first met
    resting: bool
    heading_stddev_rad: float  # inf before a magnetometer told north
    tilt_stddev_rad: float  # on each axis


class StatefulFilter(KernelFilter):
    """The filter of this module; see `KernelFilter`.

    A restart (a ``dt`` of 0) keeps what was learned of the sensors, `reset` does not.
    """

    def __init__(self, settings: Settings = DEFAULTS, **fixed: Any) -> None:
        self._memory, self._room = memory(), Room()
        self._was = STATEFUL.gains(settings)
        super().__init__(STATEFUL, settings, **fixed)

    def reset(self) -> None:
        """Forget everything but the counts and what the settings know of the sensors."""
        super().reset()
        self._was = self._gains = STATEFUL.gains(self._settings)
        self._memory = memory()
        self._room, learned = begin(self._memory, self.settings.known)
        self._state = self._before = self._state._replace(learned=learned)

    def _take(self, gyro: Vector, accel: Vector, mag: Vector, dt: float) -> None:
        before = self._before
        if before.due:
            before, self._room = look_back(before, self._room, self._memory, self._gains)
            self._before = before
        self._state, accel, mag = take(before, self._gains, gyro, accel, mag, dt)
        note(self._memory, self._state, accel, mag)

    def _changed(self) -> None:
        super()._changed()
        gains, was = self._gains, self._was
        if was.corrects and not gains.corrects:  # who learns no more keeps what was learned
            gains = gains._replace(corrects=True)
        self._was = self._gains = gains
        if gains.despike != was.despike or gains.learns != was.learns:
            seen = (self._state.senses.rate, 0.0, ZERO, ZERO, ZERO, SELDOM)
            self._put(seen=seen, past=(*self._state.past[:7], 0.0, self._state.past[8]))
        if gains.turns and not was.turns:  # of a rotor of length one, with a fresh mean of up
            self._state = self._state._replace(rotor=unit(self._state.rotor))
            self._before = self._before._replace(rotor=unit(self._before.rotor))
            self._put(earth=NO_EARTH)
        if gains.learns and not was.learns:  # nobody has watched the attitude: as after a start
            self._room, learned = start_anew(self._memory, self._room, self._state.learned)
            senses = self._state.senses._replace(heading_known=0)
            self._put(learned=learned, past=NO_PAST, row=0.0, due=False)
            self._put(senses=senses, elapsed=0.0)
        self._unit = self._gains.normalise and self._gains.stateful

    def _put(self, **parts: Any) -> None:
        """Other parts of the state, also for a sample that is taken again."""
        self._state = self._state._replace(**parts)
        self._before = self._before._replace(**parts)

    @property
    def rotor(self) -> Rotor:
        """See `KernelFilter`."""
        return self._state.rotor if self._unit else unit(self._state.rotor)

    def run(self, samples: Samples) -> Array:
        """Rotors (n, 4) for a whole recording, from a fresh start; compiled where numba is."""
        rotors = np.empty((len(samples), 4))
        self._state = STATEFUL.start
        self.reset()
        sensors = samples.gyro, samples.accel, samples.mag, steps(samples.stamps)
        if not self._gains.turns:
            self._state = run_steps(PLAIN, fused=True)(self._state, self._gains, *sensors, rotors)
            return rotors
        memory: Any = np.array(self._memory)
        self._state, self._room = runner()(
            self._state, self._room, memory, self._gains, *sensors, rotors
        )
        self._memory = memory.tolist()
        return rotors

    @property
    def stddev(self) -> tuple[float, float] | None:
        """Standard deviations of tilt, on each level axis, and of heading (rad); None if unknown.

        Heading's is inf before a magnetometer told north. They are those that hold on BROAD (see
        docs/accuracy.md).
        """
        if not self._gains.learns:
            return None
        learned = self._state.learned
        known = self._state.senses.heading_known > 0
        return learned.tilt_stddev, learned.heading_stddev if known else math.inf

    @property
    def bias(self) -> Vector:
        """See `KernelFilter`."""
        return self._state.learned.bias if self._gains.corrects else (0.0, 0.0, 0.0)

    @property
    def known(self) -> Known | None:
        """See `KernelFilter`; of news on misalignment and hard iron only what is the sensor's."""
        if not self._gains.learns:
            return None
        learned, before = self._state.learned, self._settings.known
        rows = tuple(map(minus, self._misalignment, before.misalignment))
        share = lasting(sum(map(square, rows)), MISALIGNMENT_SEEN)
        x, y, z = (
            total(was, (share * a, share * b, share * c))
            for was, (a, b, c) in zip(before.misalignment, rows, strict=True)
        )
        iron = minus(learned.hard_iron, before.hard_iron)
        share = lasting(square(iron) / (self._room.unit**2 + 1e-30), IRON_SEEN)
        a, b, c = iron
        iron = total(before.hard_iron, (share * a, share * b, share * c))
        return Known(learned.bias, (x, y, z), learned.delay, iron)

    @property
    def _misalignment(self) -> tuple[Vector, Vector, Vector]:
        (a, b, c), (d, e, f), (g, h, i) = self._state.learned[1:4]
        return (a - 1.0, b, c), (d, e - 1.0, f), (g, h, i - 1.0)

    @property
    def report(self) -> Report:
        """What the filter has to say of itself and of its sensors."""
        report = super().report
        if self._gains.alpha >= 1.0 and not self._gains.learns:
            report = replace(report, heading_from_mag=False)
        if not self._gains.learns:
            return report
        learned = self._state.learned
        assert self.stddev is not None
        tilt, heading = self.stddev
        values = {each.name: getattr(report, each.name) for each in fields(report)}
        values["heading_from_mag"] = report.heading_from_mag and learned.trust > DISTURBED
        return LearnedReport(
            **values,
            learned_bias_rad_s=learned.bias,
            misalignment=self._misalignment,
            mag_delay_s=learned.delay,
            hard_iron=learned.hard_iron,
            mag_trust=learned.trust,
            field_changes=self._room.swaps,
            resting=learned.resting,
            heading_stddev_rad=heading,
            tilt_stddev_rad=tilt,
        )
