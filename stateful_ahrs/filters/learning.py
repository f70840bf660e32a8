"""The slow room beside the stateful filter: what is wrong with the sensors, learned on the way.

Twice a second an error-state Kalman filter looks back on the window and hands the fast path
better inputs. Its state is the attitude error of the fast path δ (earth frame), the gyroscope's
bias b and its misalignment and scale E: the true rate is (1 + E)(g − b). It never moves the
attitude by itself: the fast path says how far it has corrected (``applied``), and that is taken
from the known error. So what is learned does not depend on how the fast path is tuned.

The magnetometer's delay, a hard iron left over and how far the field can be trusted are learned
beside it. Everything is in SI units and in time (or in turn of the field), never in samples.

What it keeps lies flat in one memory that is changed in place: a list of floats live, where that is
faster than an array, and an array where compiled. Matrices lie in it row by row, and their columns
are summed four at a time, which compiled is one operation.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

from ..rotor import Rotor, Vector
from .field import UNSEEN, Field, compared
from .settings import Known, Settings

WINDOW = 0.5  # s
ROWS = 64  # of the log; it takes one row in ROW_TIME
ROW_TIME = 0.037  # s
COLUMNS = 14  # rotor 4, gyro 3, accel 3, mag 3, time since the last row
REGAINED = 0.25  # of the heading that a sudden magnet took before anyone looked back
STATES = 15  # δ, and for each axis of the gyroscope b and a row of E
LEARNED = 12  # b and E
PER_AXIS = 4  # of them: b and a row of E
WIDTH = 16  # of the covariance: four times four
DIAGONAL = WIDTH + 1  # from one variance to the next

DEGREE = math.pi / 180.0
GRAVITY = 9.81  # m/s²: only scales the disturbance of the accelerometer

# Before anything is known (standard deviations).
TILT_AT_START = 30.0 * DEGREE
HEADING_AT_START = 90.0 * DEGREE
BIAS_AT_START = 0.5 * DEGREE  # rad/s
MISALIGNMENT_AT_START = 0.005
MISALIGNMENT_SEEN = 0.01  # less than this may be of the motion in which it was learned
DELAY_IF_KNOWN = 10.0  # rad²/s s: the turning that it took
# What it tells of its errors.
HEADING_SHARE, TILT_SHARE = 0.5, 0.7  # of what it takes for them
HEADING_FLOOR = 2.0 * DEGREE  # what the field of a room is off and no filter can know
TILT_FLOOR = 0.14 * DEGREE
# What the sensors do meanwhile.
ATTITUDE_WALK = (0.2 * DEGREE) ** 2  # rad²/s
BIAS_WALK = (0.015 * DEGREE) ** 2  # (rad/s)²/s
# Rest.
REST_RATE = 2.0 * DEGREE  # rad/s: largest mean on an axis
REST_SIGMA, REST_SLACK = 4.0, 0.1 * DEGREE  # how far the mean may be from a bias as well known
REST_RATE_NOISE = 1.0 * DEGREE  # rad/s rms about the mean
REST_ACCEL_NOISE = 0.25  # m/s² rms about the mean
REST_WINDOWS = 4
REST_VARIANCE = (0.015 * DEGREE) ** 2  # (rad/s)² s
# Tilt from the low-passed acceleration.
LOW_PASS = 2.0  # s
TILT_VARIANCE = 0.02**2  # rad² of one window
TILT_PER_MOTION = 0.01  # share of the variance of horizontal acceleration, in g²
# Heading from the magnetometer.
LEVEL = 1e-3  # of the field: a smaller level part has no north
HEADING_VARIANCE = (12.0 * DEGREE) ** 2  # rad² s
SETTLING = 4.0  # s in which a start is trusted less
UNTRIED_HEADING = 6.0 * DEGREE  # before the field has turned in the sensor frame
SWAP_DEVIATION = 5.0 * DEGREE
# Delay.
DELAY_BLOCK = 2.0  # s
DELAY_RANGE = (-0.005, 0.030)  # s
DELAY_UNKNOWN = 0.012  # s: rms delay of a magnetometer whose delay is not learned
# Hard iron left over, from the norm while the field turns in the sensor frame.
IRON_AT_START = 0.1  # of the norm
IRON_NOISE = 0.04  # of the norm, for each radian of turn
IRON_FORGET = 200.0  # rad
IRON_FORGET_DISTURBED = 10.0  # rad: another field tells little of the same iron
IRON_SEEN = 0.05  # of the norm: less than this the room does to the field as well
IRON_RANGE = 10.0  # of the norm: a stronger field is another's
# Another field has another norm: how far its square is off, in that of the reference.
ANOTHER = 0.03  # less can be the same field
FREED = 1e6  # variance of a constant of which nothing is known
LEAP, LEAP_PER_TURN = 0.05, 0.7  # between windows, and for each rad: no hard iron does that
LEAP_OF_ONE = 0.3  # likewise between two samples
UNIT_OFF = 0.5  # how far the unit of the equations may be from the norm of the reference


class Floats(Protocol):
    """A list of floats, or an array where compiled."""

    def __getitem__(self, index: int, /) -> float: ...

    def __setitem__(self, index: int, value: float, /) -> None: ...


# What the slow room keeps, flat and changed in place, and where its parts begin.
COVARIANCE = 0  # (16, 16) of the states; the last row and column stay zero
ERROR = COVARIANCE + WIDTH * WIDTH  # (3,) δ that is known and not yet corrected
LAG = ERROR + 3  # (2, 12) how far the low-passed up lags what b and E did
IRON = LAG + 2 * LEARNED  # (4, 5) normal equations of the sphere about the hard iron
# For the time of a look back:
EFFECT = IRON + 20  # (3, 12) what b and E did to δ in the window
SHIFT = EFFECT + 3 * LEARNED  # (3, 12)
STATE = SHIFT + 3 * LEARNED  # (16,)
ROW = STATE + WIDTH  # (16,) of the matrix of a measurement
CROSS = ROW + WIDTH  # (16,)
FREE = CROSS + WIDTH  # (16,) 0: considered, but not corrected
SOLVED = FREE + WIDTH  # (4, 5)
LOG = SOLVED + 20  # (ROWS, COLUMNS) what the fast path took since the last look back
SIZE = LOG + ROWS * COLUMNS


class Learned(NamedTuple):
    """What the slow room hands to the fast path."""

    bias: Vector = (0.0, 0.0, 0.0)  # rad/s
    row_x: Vector = (1.0, 0.0, 0.0)  # of 1 + E
    row_y: Vector = (0.0, 1.0, 0.0)
    row_z: Vector = (0.0, 0.0, 1.0)
    delay: float = 0.0  # s, of the magnetometer after the gyroscope
    hard_iron: Vector = (0.0, 0.0, 0.0)  # in the magnetometer's unit
    trust: float = 1.0  # of the magnetometer, 0 to 1
    heading_rate: float = 0.0  # 1/s: how fast heading should go to the measured north
    drift: Vector = (0.0, 0.0, 0.0)  # rad/s, earth frame: repairs what a wrong calibration did
    heading_stddev: float = HEADING_SHARE * HEADING_AT_START  # rad
    tilt_stddev: float = TILT_SHARE * TILT_AT_START  # rad, for each axis
    resting: bool = False


class Delay(NamedTuple):
    """Sums of a block, and the quotient of all blocks."""

    field: Vector = (0.0, 0.0, 0.0)
    rate: Vector = (0.0, 0.0, 0.0)
    square: float = 0.0
    rows: float = 0.0
    time: float = 0.0
    moment: float = 0.0  # over weight, it is the delay
    weight: float = 1.0


class Room(NamedTuple):
    """What the slow room remembers beside its memory."""

    elapsed: float = 0.0  # s
    rest_windows: int = 0
    unit: float = 0.0  # about the norm of the field: that of the first, or of the reference
    iron_known: Vector = (0.0, 0.0, 0.0)  # from which hard iron is sought
    swaps: int = 0  # how often a candidate took the place of the reference
    field: Field = UNSEEN
    delay: Delay = Delay()
    missed: float = 0.0  # rad²: variance of tilt by turns not measured, that up does not show yet


class Chosen(NamedTuple):
    """The settings as the slow room takes them."""

    bias: bool
    misalignment: bool
    mag: bool
    weigh: bool


class Window(NamedTuple):
    """What the fast path did since the last look back."""

    rows: int  # of the log
    up: Vector  # low-passed specific force, earth frame
    applied: Vector  # corrections, rad, earth frame
    tilt_rate: float  # 1/s: how fast it corrects
    heading_rate: float  # 1/s: likewise, of a field wholly trusted; negative: as it is told
    starting: bool
    doubt: float  # rad²: variance, on each axis, of turns in gaps between samples


def memory() -> Floats:
    """Nothing known yet."""
    return [0.0] * SIZE


def chosen(settings: Settings) -> Chosen:
    """The settings as the slow room takes them."""
    return Chosen(
        settings.learn_bias, settings.learn_misalignment, settings.learn_mag, settings.weigh_mag
    )


def begin(memory: Floats, known: Known) -> tuple[Room, Learned]:
    """What an earlier run learned, in a memory that knows nothing yet.

    Of the gyroscope it is where to begin, and no surer than nothing: a bias changes with the day.
    """
    forget_attitude(memory)
    for at in range(3, STATES):
        spread = BIAS_AT_START if at % PER_AXIS == 3 else MISALIGNMENT_AT_START
        memory[COVARIANCE + DIAGONAL * at] = spread**2
    (a, b, c), (d, e, f), (g, h, i) = known.misalignment
    delay = Delay()
    if known.mag_delay != 0.0:
        delay = Delay(moment=known.mag_delay * DELAY_IF_KNOWN, weight=DELAY_IF_KNOWN)
    learned = Learned(
        known.bias, (1.0 + a, b, c), (d, 1.0 + e, f), (g, h, 1.0 + i), known.mag_delay,
        known.hard_iron,
    )  # fmt: skip
    return Room(iron_known=known.hard_iron, delay=delay), learned


def forget_attitude(memory: Floats) -> None:
    """Tilt and heading are unknown, and nothing correlates with them."""
    for i in range(3):
        for j in range(STATES):
            memory[COVARIANCE + WIDTH * i + j] = memory[COVARIANCE + WIDTH * j + i] = 0.0
        memory[ERROR + i] = 0.0
    memory[COVARIANCE] = memory[COVARIANCE + DIAGONAL] = TILT_AT_START**2
    memory[COVARIANCE + 2 * DIAGONAL] = HEADING_AT_START**2
    for i in range(24):
        memory[LAG + i] = 0.0


def start_anew(memory: Floats, room: Room, learned: Learned) -> tuple[Room, Learned]:
    """A new start with the same sensor: attitude and field unknown, calibration kept."""
    forget_attitude(memory)
    free_norm(memory, FREED)
    _, _, unit, iron_known, swaps, _, delay, _ = room
    zero = (0.0, 0.0, 0.0)
    delay = Delay(zero, zero, 0.0, 0.0, 0.0, delay.moment, delay.weight)
    room = Room(0.0, 0, unit, iron_known, swaps, UNSEEN, delay, 0.0)
    learned = Learned(
        learned.bias, learned.row_x, learned.row_y, learned.row_z, learned.delay,
        learned.hard_iron, 1.0, 0.0, zero, HEADING_SHARE * HEADING_AT_START,
        TILT_SHARE * TILT_AT_START, False,
    )  # fmt: skip
    return room, learned


def attitude_lost(memory: Floats, room: Room, learned: Learned) -> tuple[Room, Learned]:
    """After a gap in which the attitude was lost; sensors and field are as they were."""
    forget_attitude(memory)
    _, _, unit, iron_known, swaps, field, delay, _ = room
    room = Room(0.0, 0, unit, iron_known, swaps, field, delay, 0.0)
    learned = Learned(
        learned.bias, learned.row_x, learned.row_y, learned.row_z, learned.delay,
        learned.hard_iron, learned.trust, 0.0, (0.0, 0.0, 0.0), HEADING_SHARE * HEADING_AT_START,
        TILT_SHARE * TILT_AT_START, False,
    )  # fmt: skip
    return room, learned


def first_heading(memory: Floats, applied: Vector) -> None:
    """The fast path took its first heading whole: what was known of another one is void."""
    forget_heading(memory, HEADING_AT_START**2)
    memory[ERROR] -= applied[0]
    memory[ERROR + 1] -= applied[1]
    memory[ERROR + 2] = 0.0


def forget_heading(memory: Floats, variance: float) -> None:
    """Heading has this variance (rad²), and nothing correlates with it."""
    for j in range(STATES):
        memory[COVARIANCE + WIDTH * 2 + j] = memory[COVARIANCE + WIDTH * j + 2] = 0.0
    memory[COVARIANCE + 2 * DIAGONAL] = variance


def measure(memory: Floats, variance: float, value: float) -> float:
    """One scalar Kalman update with ``ROW``; returns 1 / (variance of the innovation)."""
    for j in range(0, WIDTH, PER_AXIS):
        x = y = z = w = 0.0
        for i in range(STATES):
            r = memory[ROW + i]
            if r != 0.0:
                at = COVARIANCE + WIDTH * i + j
                x += r * memory[at]
                y += r * memory[at + 1]
                z += r * memory[at + 2]
                w += r * memory[at + 3]
        at = CROSS + j
        memory[at], memory[at + 1], memory[at + 2], memory[at + 3] = x, y, z, w
    for j in range(STATES):
        variance += memory[ROW + j] * memory[CROSS + j]
        value -= memory[ROW + j] * memory[STATE + j]
    scale = 1.0 / variance
    root = math.sqrt(scale)
    value *= root
    for i in range(STATES):
        memory[CROSS + i] *= root
        memory[STATE + i] += value * memory[FREE + i] * memory[CROSS + i]
    for j in range(0, WIDTH, PER_AXIS):
        at, free = CROSS + j, FREE + j
        x, fx = memory[at], memory[at] * memory[free]
        y, fy = memory[at + 1], memory[at + 1] * memory[free + 1]
        z, fz = memory[at + 2], memory[at + 2] * memory[free + 2]
        w, fw = memory[at + 3], memory[at + 3] * memory[free + 3]
        x, y, z, w = x - fx, y - fy, z - fz, w - fw
        for i in range(STATES):
            c = memory[CROSS + i]
            f = c * memory[FREE + i]
            at = COVARIANCE + WIDTH * i + j
            memory[at] -= c * fx + f * x
            memory[at + 1] -= c * fy + f * y
            memory[at + 2] -= c * fz + f * z
            memory[at + 3] -= c * fw + f * w
    return scale


class Sums(NamedTuple):
    """What a window was like."""

    time: float  # s
    rate: Vector  # mean, rad/s, as measured
    rate_noise: float  # mean square about it
    felt: int  # rows with a force
    accel_noise: float  # likewise, (m/s²)²
    motion: float  # mean square of the level acceleration about the low-passed, (m/s²)²
    heard: int  # rows with a magnetometer sample
    field: Vector  # mean, earth frame
    field_rate: Vector  # of ω × m, likewise
    field_rate_square: float  # mean |ω × m|²
    unit: float  # of the sphere
    largest: float  # |m|² in that unit
    sphere: tuple[
        float,
        float,
        float,
        float,
        float,
        float,
        float,
        float,
        float,
        float,
        float,
        float,
        float,
    ]  # sums in that unit: m mᵀ 6, m 3, |m|² m 3, |m|²


def gather(memory: Floats, rows: int, up: Vector, learned: Learned, room: Room) -> Sums:
    """Read the log, and use it up: what the window was like, and in ``EFFECT`` what b and E did."""
    bx, by, bz = learned.bias
    rx, ry, rz = learned.row_x, learned.row_y, learned.row_z
    hx, hy, hz = learned.hard_iron
    kx, ky, kz = room.iron_known
    unit = room.unit
    per_unit = 1.0 / unit if unit > 0.0 else 0.0
    time = 0.0
    rate_x = rate_y = rate_z = rate_square = 0.0
    accel_x = accel_y = accel_z = accel_square = motion = 0.0
    count = felt = 0
    fx = fy = fz = dx = dy = dz = square = largest = last = since = 0.0
    sxx = sxy = sxz = syy = syz = szz = sx = sy = sz = qx = qy = qz = qq = 0.0
    for k in range(rows):
        at = LOG + COLUMNS * k
        turn = matrix((memory[at], memory[at + 1], memory[at + 2], memory[at + 3]))
        gx, gy, gz = memory[at + 4], memory[at + 5], memory[at + 6]
        ax, ay, az = memory[at + 7], memory[at + 8], memory[at + 9]
        mx, my, mz = memory[at + 10], memory[at + 11], memory[at + 12]
        span = memory[at + 13]
        time += span
        since += span
        ux, uy, uz = gx - bx, gy - by, gz - bz
        for i in range(3 * 3):  # for `effects`
            memory[at + i] = turn[i]
        memory[at + 9] = -span
        memory[at + 10], memory[at + 11], memory[at + 12] = ux * span, uy * span, uz * span
        rate_x, rate_y, rate_z = rate_x + gx, rate_y + gy, rate_z + gz
        rate_square += gx * gx + gy * gy + gz * gz
        if ax == ax:
            felt += 1
            accel_x, accel_y, accel_z = accel_x + ax, accel_y + ay, accel_z + az
            accel_square += ax * ax + ay * ay + az * az
            level_x = turn[0] * ax + turn[1] * ay + turn[2] * az - up[0]
            level_y = turn[3] * ax + turn[4] * ay + turn[5] * az - up[1]
            motion += level_x * level_x + level_y * level_y
        if mx == mx:
            count += 1
            wx = rx[0] * ux + rx[1] * uy + rx[2] * uz
            wy = ry[0] * ux + ry[1] * uy + ry[2] * uz
            wz = rz[0] * ux + rz[1] * uy + rz[2] * uz
            ix, iy, iz = mx - hx, my - hy, mz - hz
            cx, cy, cz = wy * iz - wz * iy, wz * ix - wx * iz, wx * iy - wy * ix
            across = cx * cx + cy * cy + cz * cz
            fx += turn[0] * ix + turn[1] * iy + turn[2] * iz
            fy += turn[3] * ix + turn[4] * iy + turn[5] * iz
            fz += turn[6] * ix + turn[7] * iy + turn[8] * iz
            dx += turn[0] * cx + turn[1] * cy + turn[2] * cz
            dy += turn[3] * cx + turn[4] * cy + turn[5] * cz
            dz += turn[6] * cx + turn[7] * cy + turn[8] * cz
            square += across
            mx, my, mz = mx - kx, my - ky, mz - kz
            if unit == 0.0:
                unit = math.sqrt(mx * mx + my * my + mz * mz) + 1e-30
                per_unit = 1.0 / unit
            mx, my, mz = mx * per_unit, my * per_unit, mz * per_unit
            mm = mx * mx + my * my + mz * mz
            largest = max(largest, mm)
            if last > 0.0 and abs(mm - last) > LEAP_OF_ONE * 0.5 * (mm + last):
                turned = since * math.sqrt(across / (ix * ix + iy * iy + iz * iz + 1e-30))
                if abs(mm - last) > (LEAP_OF_ONE + LEAP_PER_TURN * turned) * 0.5 * (mm + last):
                    largest = math.inf
            last, since = mm, 0.0
            sxx, sxy, sxz = sxx + mx * mx, sxy + mx * my, sxz + mx * mz
            syy, syz, szz = syy + my * my, syz + my * mz, szz + mz * mz
            sx, sy, sz, qq = sx + mx, sy + my, sz + mz, qq + mm
            qx, qy, qz = qx + mm * mx, qy + mm * my, qz + mm * mz
    effects(memory, rows)
    each = 1.0 / rows
    rate_x, rate_y, rate_z = rate_x * each, rate_y * each, rate_z * each
    heard, of_force = 1.0 / max(count, 1), 1.0 / max(felt, 1)
    accel_x, accel_y, accel_z = accel_x * of_force, accel_y * of_force, accel_z * of_force
    return Sums(
        time,
        (rate_x, rate_y, rate_z),
        rate_square * each - (rate_x * rate_x + rate_y * rate_y + rate_z * rate_z),
        felt,
        accel_square * of_force - (accel_x * accel_x + accel_y * accel_y + accel_z * accel_z),
        motion * of_force,
        count,
        (fx * heard, fy * heard, fz * heard),
        (dx * heard, dy * heard, dz * heard),
        square * heard,
        unit,
        largest,
        (sxx, sxy, sxz, syy, syz, szz, sx, sy, sz, qx, qy, qz, qq),
    )


def effects(memory: Floats, rows: int) -> None:
    """Sum what b and E did, from the rows that `gather` leaves in the log: the matrix sensor →
    earth (9), less the time (s), and the turn (3, rad, less bias).
    """
    for i in range(3 * 3):
        b = x = y = z = 0.0
        for k in range(rows):
            at = LOG + COLUMNS * k
            r = memory[at + i]
            b += r * memory[at + 9]
            x += r * memory[at + 10]
            y += r * memory[at + 11]
            z += r * memory[at + 12]
        at = EFFECT + PER_AXIS * i
        memory[at], memory[at + 1], memory[at + 2], memory[at + 3] = b, x, y, z


def matrix(
    q: Rotor,
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Sensor → earth, row by row, of a unit rotor."""
    w, x, y, z = q
    return (
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )


def propagate(memory: Floats, time: float, walks: bool) -> None:
    """Let the covariance of δ grow by what b and E did in ``time`` s, and by what b may do."""
    for i in range(3):
        effect, shift = EFFECT + LEARNED * i, SHIFT + LEARNED * i
        for j in range(LEARNED):
            memory[shift + j] = 0.0
        for k in range(LEARNED):
            e = memory[effect + k]
            at = COVARIANCE + WIDTH * (3 + k) + 3
            for j in range(LEARNED):
                memory[shift + j] += e * memory[at + j]
    for i in range(3):
        for j in range(i, 3):
            total = memory[COVARIANCE + WIDTH * i + j]
            for k in range(LEARNED):
                one, other = WIDTH * i + 3 + k, WIDTH * j + 3 + k
                shifted = memory[COVARIANCE + one] + memory[SHIFT + LEARNED * i + k]
                total += memory[EFFECT + LEARNED * i + k] * memory[COVARIANCE + other]
                total += memory[EFFECT + LEARNED * j + k] * shifted
            memory[COVARIANCE + WIDTH * i + j] = memory[COVARIANCE + WIDTH * j + i] = total
    for i in range(3):
        for k in range(LEARNED):
            at = COVARIANCE + WIDTH * i + 3 + k
            memory[at] += memory[SHIFT + LEARNED * i + k]
            memory[COVARIANCE + WIDTH * (3 + k) + i] = memory[at]
        memory[COVARIANCE + DIAGONAL * i] += ATTITUDE_WALK * time
        if walks:
            memory[COVARIANCE + DIAGONAL * (3 + PER_AXIS * i)] += BIAS_WALK * time


def is_bias(memory: Floats, rate: Vector, bias: Vector) -> bool:
    """Whether a mean rate (rad/s) is as near to the known bias as that is sure: else it turns."""
    for i in range(3):
        sigma = math.sqrt(memory[COVARIANCE + DIAGONAL * (3 + PER_AXIS * i)])
        if not abs(rate[i] - bias[i]) < REST_SIGMA * sigma + REST_SLACK:
            return False
    return True


def learn(
    memory: Floats, room: Room, learned: Learned, window: Window, chosen: Chosen
) -> tuple[Room, Learned]:
    """Look back on a window."""
    up, applied = window.up, window.applied
    sums = gather(memory, window.rows, up, learned, room)
    time = sums.time
    elapsed = room.elapsed + time
    settling = 1.0 + (SETTLING / elapsed) ** 2

    propagate(memory, time, chosen.bias)
    for i in range(3):
        memory[COVARIANCE + DIAGONAL * i] += window.doubt / HEADING_SHARE**2  # to be told whole
    for i in range(STATES):
        memory[STATE + i] = memory[ROW + i] = 0.0
        memory[FREE + i] = 1.0
    for i in range(3):
        memory[STATE + i] = memory[ERROR + i] - applied[i]
        at = 3 + PER_AXIS * i
        if not chosen.bias:
            memory[FREE + at] = 0.0
        if not chosen.misalignment:
            memory[FREE + at + 1] = memory[FREE + at + 2] = memory[FREE + at + 3] = 0.0
    x0, y0, z0 = memory[STATE], memory[STATE + 1], memory[STATE + 2]

    # Rest: the gyroscope reads its bias.
    rate = sums.rate
    rest_windows = 0
    if (
        sums.rate_noise < REST_RATE_NOISE**2
        and sums.felt > 0
        and sums.accel_noise < REST_ACCEL_NOISE**2
        and max(abs(rate[0]), abs(rate[1]), abs(rate[2])) < REST_RATE
        and is_bias(memory, rate, learned.bias)
    ):
        rest_windows = room.rest_windows + 1
    resting = rest_windows >= REST_WINDOWS
    if resting and chosen.bias:
        for i in range(3):
            memory[ROW + 3 + PER_AXIS * i] = 1.0
            measure(memory, REST_VARIANCE / time, rate[i] - learned.bias[i])
            memory[ROW + 3 + PER_AXIS * i] = 0.0

    # Tilt: the low-passed up should be vertical.
    fade = math.exp(-time / LOW_PASS)
    fill = (LOW_PASS / time) * (1.0 - fade)
    for i in range(2 * LEARNED):
        memory[LAG + i] = fade * memory[LAG + i] + fill * memory[EFFECT + i]
    length = math.sqrt(up[0] * up[0] + up[1] * up[1] + up[2] * up[2]) + 1e-12
    motion = 0.5 * sums.motion / GRAVITY**2
    variance = (TILT_VARIANCE + TILT_PER_MOTION * motion) * settling
    missed = min(fade * room.missed + window.doubt, (TILT_SHARE * TILT_AT_START) ** 2)
    own_x = own_y = own_z = 0.0
    if sums.felt > 0:
        variance *= window.rows / sums.felt
        x1 = memory[STATE]
        memory[ROW] = 1.0
        for k in range(LEARNED):
            memory[ROW + 3 + k] = -memory[LAG + k]
        measure(memory, variance, up[1] / length)
        x2, y2 = memory[STATE], memory[STATE + 1]
        memory[ROW], memory[ROW + 1] = 0.0, 1.0
        for k in range(LEARNED):
            memory[ROW + 3 + k] = -memory[LAG + LEARNED + k]
        measure(memory, variance, -up[0] / length)
        own_x, own_y = x2 - x1, memory[STATE + 1] - y2

    if sums.heard > 0:
        room, learned, own_z = hear(memory, room, learned, sums, window, settling, chosen)
    else:
        learned = told(learned, learned.delay, learned.hard_iron, learned.trust, 0.0)
    for i in range(3):
        memory[ERROR + i] = memory[STATE + i]
    x, y, z = memory[STATE], memory[STATE + 1], memory[STATE + 2]
    drift = (
        (x - x0 - own_x) / WINDOW,
        (y - y0 - own_y) / WINDOW,
        0.0 if window.heading_rate == 0.0 else (z - z0 - own_z + REGAINED * z0) / WINDOW,
    )
    room = Room(
        elapsed,
        rest_windows,
        room.unit,
        room.iron_known,
        room.swaps,
        room.field,
        room.delay,
        missed,
    )
    tilt = 0.5 * (memory[COVARIANCE] + memory[COVARIANCE + DIAGONAL] + x * x + y * y)
    heading = memory[COVARIANCE + 2 * DIAGONAL] + z * z
    bias, rx, ry, rz = learned.bias, learned.row_x, learned.row_y, learned.row_z
    learned = Learned(
        (bias[0] + memory[STATE + 3], bias[1] + memory[STATE + 7], bias[2] + memory[STATE + 11]),
        (rx[0] + memory[STATE + 4], rx[1] + memory[STATE + 5], rx[2] + memory[STATE + 6]),
        (ry[0] + memory[STATE + 8], ry[1] + memory[STATE + 9], ry[2] + memory[STATE + 10]),
        (rz[0] + memory[STATE + 12], rz[1] + memory[STATE + 13], rz[2] + memory[STATE + 14]),
        learned.delay,
        learned.hard_iron,
        learned.trust,
        learned.heading_rate,
        drift,
        math.sqrt(HEADING_SHARE**2 * heading + HEADING_FLOOR**2 + room.field.rival),
        math.sqrt(TILT_SHARE**2 * tilt + TILT_FLOOR**2 + missed),
        resting,
    )
    return room, learned


def told(
    learned: Learned, delay: float, hard_iron: Vector, trust: float, heading_rate: float
) -> Learned:
    """What was learned, with the magnetometer's part anew."""
    return Learned(
        learned.bias, learned.row_x, learned.row_y, learned.row_z, delay, hard_iron, trust,
        heading_rate, learned.drift, learned.heading_stddev, learned.tilt_stddev,
        learned.resting,
    )  # fmt: skip


def less_sure(learned: Learned, variance: float) -> Learned:
    """The same, with that variance (rad²) more of tilt and heading, until the slow room says."""
    heading = math.sqrt(max(0.0, learned.heading_stddev**2 + variance))
    tilt = math.sqrt(max(0.0, learned.tilt_stddev**2 + variance))
    return Learned(
        learned.bias, learned.row_x, learned.row_y, learned.row_z, learned.delay,
        learned.hard_iron, learned.trust, learned.heading_rate, learned.drift, heading, tilt,
        learned.resting,
    )  # fmt: skip


def delay_of(delay: Delay, sums: Sums, trust: float) -> Delay:
    """The field stands still in the earth frame, so what moves with R(ω×m) is delay."""
    n, time = sums.heard, sums.time
    fx, fy, fz = sums.field
    rx, ry, rz = sums.field_rate
    fx, fy, fz = delay.field[0] + fx * n, delay.field[1] + fy * n, delay.field[2] + fz * n
    rx, ry, rz = delay.rate[0] + rx * n, delay.rate[1] + ry * n, delay.rate[2] + rz * n
    square = delay.square + sums.field_rate_square * n
    count, time = delay.rows + n, delay.time + time
    moment, weight = delay.moment, delay.weight
    if time < DELAY_BLOCK - 0.01:
        return Delay((fx, fy, fz), (rx, ry, rz), square, count, time, moment, weight)
    scale = time * trust * count / (fx * fx + fy * fy + fz * fz + 1e-30)
    moment -= scale * (fx * rx + fy * ry + fz * rz) / count
    weight += scale * (square - (rx * rx + ry * ry + rz * rz) / count)
    return Delay((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0, 0.0, moment, weight)


def hard_iron_of(
    memory: Floats,
    sums: Sums,
    turned: float,
    trust: float,
    other: float,
    leap: float,
    known: Vector,
    last: Vector,
) -> Vector:
    """Hard iron from the norm: |m|² = 2 m·h + const on a sphere about h.

    ``other`` is how far the square of the norm is off that of the reference, in such squares, and
    ``leap`` how far it is off that of the last window. The constant is free to walk where it is
    another field's; by the fourth power, because a hard iron that is new is off by less, and is
    to be learned. A window in which the field changes is on no sphere.
    """
    if not sums.largest < IRON_RANGE**2:
        return last
    if abs(leap) > LEAP + LEAP_PER_TURN * turned:
        free_norm(memory, FREED)
        return last
    if abs(other) > ANOTHER:
        free_norm(memory, other**4 * sums.time / WINDOW)
    weight = min(1.0, turned) / (sums.heard * (2.0 * IRON_NOISE) ** 2)
    fade = math.exp(-turned * (trust / IRON_FORGET + (1.0 - trust) / IRON_FORGET_DISTURBED))
    sxx, sxy, sxz, syy, syz, szz, sx, sy, sz, qx, qy, qz, qq = sums.sphere
    rows = (
        (4.0 * sxx, 4.0 * sxy, 4.0 * sxz, 2.0 * sx, 2.0 * qx),
        (4.0 * sxy, 4.0 * syy, 4.0 * syz, 2.0 * sy, 2.0 * qy),
        (4.0 * sxz, 4.0 * syz, 4.0 * szz, 2.0 * sz, 2.0 * qz),
        (2.0 * sx, 2.0 * sy, 2.0 * sz, float(sums.heard), qq),
    )
    for i in range(4):
        for j in range(5):
            memory[IRON + 5 * i + j] = fade * memory[IRON + 5 * i + j] + weight * rows[i][j]
            memory[SOLVED + 5 * i + j] = memory[IRON + 5 * i + j]
        memory[SOLVED + 6 * i] += 1.0 / IRON_AT_START**2 if i < 3 else 1e-6
    x, y, z = solve(memory)
    size = x * x + y * y + z * z
    kept = sums.unit * lasting(size, IRON_SEEN)
    return (known[0] + kept * x, known[1] + kept * y, known[2] + kept * z)


def lasting(square: float, seen: float) -> float:
    """The share of what was found that is the sensor's, if ``seen`` may be its surroundings'."""
    return max(0.0, 1.0 - seen**2 / (square + 1e-12))


def free_norm(memory: Floats, variance: float) -> None:
    """Let the constant of the sphere walk: another field has another norm, but the same iron."""
    part = variance / (1.0 + variance * memory[IRON + 18])
    for i in range(4):
        memory[SOLVED + i] = part * memory[IRON + 5 * i + 3]
    for j in range(5):
        last = memory[IRON + 15 + j]
        for i in range(4):
            memory[IRON + 5 * i + j] -= memory[SOLVED + i] * last


def give_unit(memory: Floats, times: float) -> None:
    """Write the equations of the sphere in a unit that is so many times theirs."""
    small = 1.0 / times
    for i in range(4):
        for j in range(5):
            scale = small if i < 3 else 1.0
            if j < 3:
                scale *= small
            elif j == 4:
                scale *= small * small
            memory[IRON + 5 * i + j] *= scale


def solve(memory: Floats) -> Vector:
    """The first three unknowns of four symmetric positive equations (4, 5), which it consumes."""
    for i in range(4):
        for j in range(i + 1, 4):
            part = memory[SOLVED + 5 * j + i] / memory[SOLVED + 6 * i]
            for k in range(i, 5):
                memory[SOLVED + 5 * j + k] -= part * memory[SOLVED + 5 * i + k]
    w = memory[SOLVED + 19] / memory[SOLVED + 18]
    z = (memory[SOLVED + 14] - memory[SOLVED + 13] * w) / memory[SOLVED + 12]
    y = memory[SOLVED + 9] - memory[SOLVED + 7] * z - memory[SOLVED + 8] * w
    y /= memory[SOLVED + 6]
    x = memory[SOLVED + 4] - memory[SOLVED + 2] * z - memory[SOLVED + 3] * w
    x = (x - memory[SOLVED + 1] * y) / memory[SOLVED]
    return x, y, z


def hear(
    memory: Floats,
    room: Room,
    learned: Learned,
    sums: Sums,
    window: Window,
    settling: float,
    chosen: Chosen,
) -> tuple[Room, Learned, float]:
    """The magnetometer's part: delay, hard iron, trust and heading.

    Also returns what of the heading error the fast path will correct by itself.
    """
    time, field = sums.time, room.field
    delays = delay_of(room.delay, sums, learned.trust)
    delay, hard_iron = learned.delay, learned.hard_iron
    if chosen.mag:
        delay = min(max(delays.moment / delays.weight, DELAY_RANGE[0]), DELAY_RANGE[1])
    fx, fy, fz = sums.field
    rx, ry, rz = sums.field_rate
    fx, fy, fz = fx - delay * rx, fy - delay * ry, fz - delay * rz
    level = math.sqrt(fx * fx + fy * fy) + 1e-30
    norm = math.sqrt(level * level + fz * fz)
    dip = fz / norm
    turned = math.sqrt(sums.field_rate_square) / norm * time  # rad, in the sensor frame
    if chosen.mag:
        other = leap = 0.0
        if field.norm_reference > 0.0:
            other = (norm / field.norm_reference) ** 2 - 1.0
            leap = other + 1.0 - (field.last / field.norm_reference) ** 2
        hard_iron = hard_iron_of(
            memory, sums, turned, learned.trust, other, leap, room.iron_known, learned.hard_iron
        )
    innovation = math.atan2(fy, fx)
    north = innovation + memory[STATE + 2]
    heading_variance = COVARIANCE + 2 * DIAGONAL
    held = HEADING_SHARE**2 * memory[heading_variance]
    field, trust, swapped = compared(field, norm, dip, north, held, turned, time, chosen.weigh)
    swaps = room.swaps
    if swapped:
        swaps += 1
        forget_heading(memory, SWAP_DEVIATION**2 + north**2)

    # Heading. The magnetometer never moves tilt.
    least = (UNTRIED_HEADING / (1.0 + field.looks)) ** 2
    memory[heading_variance] = max(memory[heading_variance], least)
    heading_rate, own = 0.0, 0.0
    if level > LEVEL * norm:
        steep = fz / level
        memory[ROW], memory[ROW + 1], memory[ROW + 2] = steep, 0.0, -1.0
        for k in range(LEARNED):
            memory[ROW + 3 + k] = 0.5 * (
                memory[EFFECT + 2 * LEARNED + k] - steep * memory[EFFECT + k]
            )
        memory[FREE] = memory[FREE + 1] = 0.0
        variance = HEADING_VARIANCE / (trust * time) * settling
        if not chosen.mag:
            variance += sums.field_rate_square * (DELAY_UNKNOWN / level) ** 2
        toward = memory[heading_variance]
        for j in range(STATES):
            if j != 2:
                toward -= memory[ROW + j] * memory[COVARIANCE + WIDTH * 2 + j]
        was = memory[STATE + 2]
        scale = measure(memory, variance, innovation)
        gain = min(max(toward * scale, 0.0), 0.999)
        heading_rate = -math.log(1.0 - gain) / time
        own = memory[STATE + 2] - was
        applied = heading_rate
        if window.heading_rate >= 0.0:
            applied = trust * window.heading_rate
        elif not window.starting:
            applied = min(applied, window.tilt_rate)
        if applied < heading_rate:
            own *= (1.0 - math.exp(-time * applied)) / gain
    unit = sums.unit
    if not UNIT_OFF * unit < field.norm_reference < unit / UNIT_OFF:  # the first was a bad one
        give_unit(memory, field.norm_reference / unit)
        unit = field.norm_reference
    room = Room(room.elapsed, room.rest_windows, unit, room.iron_known, swaps, field, delays, 0.0)
    return room, told(learned, delay, hard_iron, trust, heading_rate), own
