"""The stateful complementary filter with a slow room beside it that learns its sensors.

Per sample it stays Kusaka and Tanaka's: the gyroscope's rotor (eq. 12), one snapshot rotor (eq.
5–10), the sign that continues (eq. 3–4), one blend by α (eq. 16). Only multiplications, additions
and square roots. What goes in is better:

- rates less the bias, and through the misalignment matrix;
- up is the acceleration low-passed in the earth frame, where gravity stands still;
- north is ``trust · measured + (1 − trust) · predicted``, so that one snapshot serves nine axes,
  six axes (trust 0) and every disturbance between; the measured one is freed of hard iron and of
  the magnetometer's delay.

What makes it better is learned twice a second in `learning`.

Deviations
- The snapshot is taken of vectors in the predicted earth frame. It is then the rotor Δ from the
  predicted to the true earth, and ``α p + (1 − α) Δ p = (α + (1 − α) Δ) p``.
- α is that of a step: ``1 − Δt / (τ + Δt)``, the same to first order. It leaves heading with the
  time constant that the slow room finds right, but never a shorter one than tilt.
- For the first two seconds, until the low-pass is full, its up is taken whole, and north as a mean
  of all samples in which newer ones count for more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..rotor import (
    IDENTITY,
    Rotor,
    Vector,
    blend,
    conjugate,
    dot,
    follow,
    from_rate,
    product,
    rotate,
    unit,
)
from ..snapshot.dcm import dcm
from .compiled import compiled
from .learning import (
    COLUMNS,
    LOW_PASS,
    ROW_TIME,
    ROWS,
    WINDOW,
    Learned,
    Room,
    first_heading,
    fresh_room,
    learn,
    start_anew,
)
from .samples import Array, Samples
from .stamps import steps
from .stateful import FASTEST, NO_MAG, STRONGEST, UP, WEAKEST, Report, Settings

START = LOW_PASS  # s: until the low-pass is full, its up is taken whole
AVERAGED = 2.0 * START  # s: until then a slow α is that of a mean
NEWER = 3.0  # at the start: the mean north of all samples, the newer the more
FOREVER = 1e9  # s: the time constant of α = 1
LEVEL = 1e-3  # of the field: a smaller level part has no north
DISTURBED = 0.1  # trust of a field three standard deviations off
HEADING_FLOOR = math.radians(2.0)  # what the field of a room is off and no filter can know
TILT_FLOOR = math.radians(0.1)


class Gains(NamedTuple):
    """The settings as the kernel takes them."""

    tilt_time: float  # s: time constant of α
    tilt_steps: float  # steps: the same where α is for each sample
    use_mag: bool
    mag_timeout: float  # s
    north_at_start: Vector
    learn_misalignment: bool
    learn_mag: bool


class State(NamedTuple):
    """All that the fast path carries from sample to sample."""

    rotor: Rotor = IDENTITY
    predicted: Rotor = IDENTITY  # before the last correction
    rate: Vector = (0.0, 0.0, 0.0)  # rad/s, as measured: the last good one
    up: Vector = (0.0, 0.0, 0.0)  # low-passed specific force, predicted earth frame, m/s²
    north: tuple[float, float] = (1.0, 0.0)  # the last measured: level, unit, predicted earth frame
    mag_age: float = math.inf  # s
    started: bool = False
    heading_known: bool = False
    elapsed: float = 0.0  # s since the start
    tilt_rate: float = 0.0  # 1/s: how fast α corrects
    # Since the window of the slow room began:
    window_time: float = 0.0  # s
    applied: Vector = (0.0, 0.0, 0.0)  # corrections, rad, earth frame
    rows: int = 0  # of the log
    row_time: float = 0.0  # s since the last row; 0: this sample is one
    mag_row_time: float = 1.0  # s since the last row with a magnetometer sample
    due: bool = False  # the slow room should look back now
    gyro_rejected: int = 0
    accel_rejected: int = 0
    mag_rejected: int = 0


def step(
    state: State,
    learned: Learned,
    gains: Gains,
    gyro: Vector,
    accel: Vector,
    mag: Vector,
    dt: float,
) -> State:
    """Take one sample of all sensors, ``dt`` s after the last; 0 starts anew (eq. 16).

    ``mag`` is NaN where no new one came. Anything that is not finite or not physical is left
    out: rates are held, tilt and heading follow the gyroscope for the time being.
    """
    started = state.started and dt > 0.0
    heading_known = state.heading_known and dt > 0.0

    rate = gyro
    gyro_rejected = state.gyro_rejected
    if not abs(gyro[0]) + abs(gyro[1]) + abs(gyro[2]) < FASTEST:
        rate = state.rate
        gyro_rejected += 1
    bx, by, bz = learned.bias
    ux, uy, uz = rate[0] - bx, rate[1] - by, rate[2] - bz
    rx, ry, rz = learned.row_x, learned.row_y, learned.row_z
    wx = rx[0] * ux + rx[1] * uy + rx[2] * uz
    wy = ry[0] * ux + ry[1] * uy + ry[2] * uz
    wz = rz[0] * ux + rz[1] * uy + rz[2] * uz
    predicted = product(state.rotor, from_rate((wx, wy, wz), dt))

    square = accel[0] * accel[0] + accel[1] * accel[1] + accel[2] * accel[2]
    has_up = WEAKEST * WEAKEST < square < STRONGEST * STRONGEST
    accel_rejected = state.accel_rejected
    if not has_up:
        accel_rejected += 1
    hx, hy, hz = learned.hard_iron
    mx, my, mz = mag[0] - hx, mag[1] - hy, mag[2] - hz
    fresh = False
    mag_rejected = state.mag_rejected
    if mag[0] == mag[0] or mag[1] == mag[1] or mag[2] == mag[2]:
        square = mag[0] * mag[0] + mag[1] * mag[1] + mag[2] * mag[2]
        fresh = gains.use_mag and 1e-24 < square < 1e24
        if not 1e-24 < square < 1e24:
            mag_rejected += 1

    if not started:
        found = False
        rotor = unit(predicted)
        if has_up:
            if fresh:
                found, snapshot = dcm(accel, (mx, my, mz))
                heading_known = found
                if not found:  # along gravity
                    mag_rejected += 1
            if not found:
                found, snapshot = dcm(accel, gains.north_at_start)
            if not found:
                found, snapshot = dcm(accel, UP)
            if found:
                rotor = follow(snapshot, rotor)
        up = rotate(rotor, accel) if found else UP
        return State(
            rotor, rotor, rate, up, (1.0, 0.0), 0.0 if heading_known else math.inf, found,
            heading_known, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0), 0, 0.0, 1.0, found,
            gyro_rejected, accel_rejected, mag_rejected,
        )  # fmt: skip

    elapsed = state.elapsed + dt
    lx, ly, lz = state.up
    if has_up:
        ax, ay, az = rotate(predicted, accel)
        share = dt / min(elapsed, LOW_PASS + dt)
        lx, ly, lz = lx + share * (ax - lx), ly + share * (ay - ly), lz + share * (az - lz)

    nx, ny = state.north
    mag_age = state.mag_age + dt
    if fresh:
        late = learned.delay
        mx, my, mz = (
            mx - late * (wy * mz - wz * my),
            my - late * (wz * mx - wx * mz),
            mz - late * (wx * my - wy * mx),
        )
        fx, fy, fz = rotate(predicted, (mx, my, mz))
        level = fx * fx + fy * fy
        fresh = level > LEVEL * LEVEL * (level + fz * fz)
        if fresh:
            scale = 1.0 / math.sqrt(level)
            nx, ny = fx * scale, fy * scale
            mag_age = 0.0
        else:
            mag_rejected += 1

    # The snapshot (eq. 5–10) and the blend (eq. 16), from the predicted earth to the true one.
    first = fresh and not heading_known
    starting = elapsed < START
    tilt_time = gains.tilt_time + gains.tilt_steps * dt
    tilt_rate = 1.0 / (tilt_time + dt)
    weight = dt * tilt_rate
    if elapsed < AVERAGED:
        weight = max(weight, dt / elapsed)
    trust = 0.0
    if heading_known and mag_age <= gains.mag_timeout and gains.use_mag:
        trust = min(1.0, learned.heading_rate * (tilt_time + dt))
        if starting:
            trust = min(1.0, NEWER * dt / elapsed)
    if starting:
        weight = 1.0
    if first:
        weight, trust, heading_known = 1.0, 1.0, True
        if not starting:  # the first heading leaves the tilt alone
            lx, ly, lz = UP
    _, snapshot = dcm((lx, ly, lz), (1.0 + trust * (nx - 1.0), trust * ny, 0.0))
    cw, cx, cy, cz = blend(IDENTITY, follow(snapshot, IDENTITY), 1.0 - weight)
    # What the slow room found out of the past.
    dx, dy, dz = learned.drift
    half = 0.5 * dt if state.window_time < WINDOW and gains.tilt_time < FOREVER else 0.0
    correction = unit((cw, cx + half * dx, cy + half * dy, cz + half * dz))
    rotor = product(correction, predicted)
    square = dot(rotor, rotor)
    scale = 1.5 - 0.5 * square  # a root would be wasted on a length so near to one
    rotor = (scale * rotor[0], scale * rotor[1], scale * rotor[2], scale * rotor[3])
    cx, cy, cz = 2.0 * correction[1], 2.0 * correction[2], 2.0 * correction[3]
    # What stands still in the earth turns with the correction of the earth.
    lx, ly, lz = lx + cy * lz - cz * ly, ly + cz * lx - cx * lz, lz + cx * ly - cy * lx
    nx, ny = nx - cz * ny, ny + cz * nx
    applied = (state.applied[0] + cx, state.applied[1] + cy, state.applied[2] + cz)
    if first:
        if not starting:
            lx, ly, lz = rotate(correction, state.up)
        return State(
            rotor, predicted, rate, (lx, ly, lz), (1.0, 0.0), 0.0, True,
            True, elapsed, tilt_rate, 0.0, state.applied, 0, 0.0, 1.0, True,
            gyro_rejected, accel_rejected, mag_rejected,
        )  # fmt: skip

    rows = state.rows
    row_time = state.row_time + dt
    mag_row_time = state.mag_row_time + dt
    if row_time >= ROW_TIME or (fresh and mag_row_time >= ROW_TIME):
        rows += 1
        row_time = 0.0
        if fresh:
            mag_row_time = 0.0
    window_time = state.window_time + dt
    window = WINDOW if elapsed > WINDOW else 0.25 * WINDOW
    return State(
        rotor, predicted, rate, (lx, ly, lz), (nx, ny), mag_age, True, heading_known, elapsed,
        tilt_rate, window_time, applied, rows, row_time, mag_row_time,
        rows > 0 and (window_time >= window - 0.5 * dt or rows == ROWS),
        gyro_rejected, accel_rejected, mag_rejected,
    )  # fmt: skip


def note(log: Array, state: State, accel: Vector, mag: Vector, row_time: float) -> None:
    """Write the sample that made ``state`` into the log, as its last row."""
    row = state.rows - 1
    log[row, 0], log[row, 1], log[row, 2], log[row, 3] = state.predicted
    log[row, 4], log[row, 5], log[row, 6] = state.rate
    log[row, 7], log[row, 8], log[row, 9] = accel
    log[row, 10], log[row, 11], log[row, 12] = mag
    log[row, 13] = row_time
    if state.mag_row_time > 0.0:
        log[row, 10] = math.nan
    square = accel[0] * accel[0] + accel[1] * accel[1] + accel[2] * accel[2]
    if not WEAKEST * WEAKEST < square < STRONGEST * STRONGEST:
        log[row, 7], log[row, 8], log[row, 9] = rotate(conjugate(state.predicted), state.up)


def look_back(
    state: State, learned: Learned, room: Room, log: Array, gains: Gains
) -> tuple[State, Learned, Room]:
    """The slow room's turn: at the end of a window, at a new start, or at the first heading."""
    if state.rows > 0:
        room, learned = learn(
            room, learned, log, state.rows, state.up, state.applied, state.tilt_rate,
            state.elapsed < START, gains.learn_misalignment, gains.learn_mag,
        )  # fmt: skip
    elif state.elapsed > 0.0:
        room = first_heading(room, state.applied)
    else:
        room, learned = start_anew(room, learned)
    (
        rotor, predicted, rate, up, north, mag_age, started, heading_known, elapsed, tilt_rate,
        _, _, _, row_time, mag_row_time, _, gyro_rejected, accel_rejected, mag_rejected,
    ) = state  # fmt: skip
    state = State(
        rotor, predicted, rate, up, north, mag_age, started, heading_known, elapsed, tilt_rate,
        0.0, (0.0, 0.0, 0.0), 0, row_time, mag_row_time, False,
        gyro_rejected, accel_rejected, mag_rejected,
    )  # fmt: skip
    return state, learned, room


def run_window(
    state: State,
    learned: Learned,
    gains: Gains,
    log: Array,
    gyro: Array,
    accel: Array,
    mag: Array,
    dts: Array,
    rotors: Array,
    start: int,
) -> tuple[State, int]:
    """Fill ``rotors`` from row ``start`` until the slow room is due; returns the row after.

    A step of NaN repeats the last rotor (skipped).
    """
    i = start
    while i < len(dts) and not state.due:
        if dts[i] == dts[i]:
            a = (accel[i, 0], accel[i, 1], accel[i, 2])
            m = (mag[i, 0], mag[i, 1], mag[i, 2])
            row_time = state.row_time + dts[i]
            state = step(state, learned, gains, (gyro[i, 0], gyro[i, 1], gyro[i, 2]), a, m, dts[i])
            if state.rows > 0 and state.row_time == 0.0:
                note(log, state, a, m, row_time)
        rotors[i, 0], rotors[i, 1], rotors[i, 2], rotors[i, 3] = state.rotor
        i += 1
    return state, i


def run_all(
    state: State,
    learned: Learned,
    room: Room,
    log: Array,
    gains: Gains,
    gyro: Array,
    accel: Array,
    mag: Array,
    dts: Array,
    rotors: Array,
) -> tuple[State, Learned, Room]:
    """Fill ``rotors`` (n, 4)."""
    i = 0
    while i < len(dts):
        state, i = run_window(state, learned, gains, log, gyro, accel, mag, dts, rotors, i)
        if state.due:
            state, learned, room = look_back(state, learned, room, log, gains)
    return state, learned, room


@dataclass(frozen=True)
class LearningReport(Report):
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


class LearningFilter:
    """The filter with its settings, its state and what it learned; one for each sensor.

    Its snapshot is always stateful, its rotor always normalised and its start always averaged.
    Rotors returned are of unit length, sensor → earth (north-west-up), and continue in sign.
    """

    def __init__(self, settings: Settings = Settings()) -> None:
        self.settings = settings
        self.reset()

    @property
    def settings(self) -> Settings:
        """May be replaced at any time; the next sample is taken with the new ones."""
        return self._settings

    @settings.setter
    def settings(self, settings: Settings) -> None:
        self._settings = replace(settings, stateful=True, normalise=True, average_start=True)
        steps = 0.0
        seconds = min(settings.time_constant, FOREVER)
        if settings.alpha_rate <= 0.0:
            steps = settings.alpha / max(1.0 - settings.alpha, 1e-12)
            seconds = 0.0 if settings.alpha < 1.0 else FOREVER
        self._gains = Gains(
            float(seconds),
            float(steps),
            settings.use_mag,
            float(settings.mag_timeout),
            settings.north_at_start,
            settings.learn_misalignment,
            settings.learn_mag,
        )

    def reset(self) -> None:
        """Forget everything, also what was learned; the next sample starts anew."""
        self._log = np.zeros((ROWS, COLUMNS))
        self._now = self._before = (State(), Learned(), fresh_room())
        self._mag = NO_MAG
        self._inputs: tuple[Vector, Vector, float] | None = None

    def update_mag(self, mag: Vector) -> None:
        """Give the magnetometer sample (sensor frame, any unit) for the next `update_imu`."""
        self._mag = mag

    def update_imu(self, gyro: Vector, accel: Vector, dt: float) -> Rotor:
        """Take rates (rad/s) and specific force (m/s²), ``dt`` s after the last ones.

        A ``dt`` of 0 starts anew from this sample, continuing the sign of the last rotor and
        keeping what was learned of the sensors.
        """
        self._before = self._now
        self._inputs = (gyro, accel, dt)
        self._take(self._mag)
        self._mag = NO_MAG
        return self.rotor

    def amend_mag(self, mag: Vector) -> None:
        """Take the last step again with its magnetometer sample, which came after it."""
        if self._inputs is not None:  # none since the reset
            self._take(mag)

    def _take(self, mag: Vector) -> None:
        assert self._inputs is not None
        gyro, accel, dt = self._inputs
        state, learned, room = self._before
        row_time = state.row_time + dt
        state = step(state, learned, self._gains, gyro, accel, mag, dt)
        if state.rows > 0 and state.row_time == 0.0:
            note(self._log, state, accel, mag, row_time)
        if state.due:
            state, learned, room = look_back(state, learned, room, self._log, self._gains)
        self._now = state, learned, room

    def run(self, samples: Samples) -> Array:
        """Rotors (n, 4) for a whole recording, from a fresh start; compiled where numba is."""
        rotors = np.empty((len(samples), 4))
        self.reset()
        self._now = compiled(run_all)(
            *self._now,
            self._log,
            self._gains,
            samples.gyro,
            samples.accel,
            samples.mag,
            steps(samples.stamps),
            rotors,
        )
        return rotors

    @property
    def rotor(self) -> Rotor:
        """The present attitude; the identity before the first good accelerometer sample."""
        return self._now[0].rotor

    @property
    def started(self) -> bool:
        """Whether the attitude is known."""
        return self._now[0].started

    @property
    def heading_known(self) -> bool:
        """Whether a magnetometer has told north since the start."""
        return self._now[0].heading_known

    @property
    def report(self) -> LearningReport:
        """What the filter has to say of itself and of its sensors."""
        state, learned, room = self._now
        rows = (learned.row_x, learned.row_y, learned.row_z)
        x, y, z = (
            (row[0] - float(i == 0), row[1] - float(i == 1), row[2] - float(i == 2))
            for i, row in enumerate(rows)
        )
        heading_stddev = math.inf
        if state.heading_known:
            heading_stddev = math.hypot(0.5 * math.sqrt(learned.heading_variance), HEADING_FLOOR)
        return LearningReport(
            started=state.started,
            heading_from_mag=self._gains.use_mag
            and state.heading_known
            and state.mag_age <= self._gains.mag_timeout
            and learned.trust > DISTURBED,
            mag_age=state.mag_age,
            sign_corrections=0,
            gyro_rejected=state.gyro_rejected,
            accel_rejected=state.accel_rejected,
            mag_rejected=state.mag_rejected,
            learned_bias_rad_s=learned.bias,
            misalignment=(x, y, z),
            mag_delay_s=learned.delay,
            hard_iron=learned.hard_iron,
            mag_trust=learned.trust,
            field_changes=room.field.swaps,
            resting=learned.resting,
            heading_stddev_rad=heading_stddev,
            tilt_stddev_rad=math.hypot(0.5 * math.sqrt(learned.tilt_variance), TILT_FLOOR),
        )
