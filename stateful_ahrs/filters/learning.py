"""The slow room beside the stateful filter: what is wrong with the sensors, learned on the way.

Twice a second an error-state Kalman filter looks back on the window and hands the fast path
better inputs. Its state is the attitude error of the fast path δ (earth frame), the gyroscope's
bias b and its misalignment and scale E: the true rate is (1 + E)(g − b). It never moves the
attitude by itself: the fast path says how far it has corrected (``applied``), and that is taken
from the known error. So what is learned does not depend on how the fast path is tuned.

The magnetometer's delay, a hard iron left over and how far the field can be trusted are learned
beside it. Everything is in SI units and in time (or in turn of the field), never in samples.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..rotor import Vector
from .samples import Array

WINDOW = 0.5  # s
ROWS = 128  # of the log; it takes one row in ROW_TIME
ROW_TIME = 0.018  # s
COLUMNS = 14  # rotor 4, gyro 3, accel 3, mag 3, time since the last row

DEGREE = math.pi / 180.0
GRAVITY = 9.81  # m/s²: only scales the disturbance of the accelerometer

# Before anything is known (standard deviations).
TILT_AT_START = 30.0 * DEGREE
HEADING_AT_START = 90.0 * DEGREE
BIAS_AT_START = 0.5 * DEGREE  # rad/s
MISALIGNMENT_AT_START = 0.005
# What the sensors do meanwhile.
ATTITUDE_WALK = (0.2 * DEGREE) ** 2  # rad²/s
BIAS_WALK = (0.015 * DEGREE) ** 2  # (rad/s)²/s
# Rest.
REST_RATE = 2.0 * DEGREE  # rad/s: largest mean on an axis
REST_RATE_NOISE = 1.0 * DEGREE  # rad/s rms about the mean
REST_ACCEL_NOISE = 0.25  # m/s² rms about the mean
REST_WINDOWS = 4
REST_VARIANCE = (0.015 * DEGREE) ** 2  # (rad/s)² s
# Tilt from the low-passed acceleration.
LOW_PASS = 2.0  # s
TILT_VARIANCE = 0.02**2  # rad² of one window
TILT_PER_MOTION = 0.01  # share of the variance of horizontal acceleration, in g²
# Heading from the magnetometer.
HEADING_VARIANCE = (12.0 * DEGREE) ** 2  # rad² s
SETTLING = 4.0  # s in which a start is trusted less
# Delay.
DELAY_BLOCK = 2.0  # s
DELAY_RANGE = (-0.005, 0.030)  # s
DELAY_UNKNOWN = 0.012  # s: rms delay of a magnetometer whose delay is not learned
# The field: norm and sine of the dip, smoothed, against a reference.
FIELD_SMOOTH = 1.5  # s
NORM_SPREAD = 0.025  # of the norm
DIP_SPREAD = 0.05  # of the sine
REFERENCE = 40.0  # s in which the reference follows an undisturbed field
REFERENCE_DISTURBED = 400.0  # s in which it follows any
YOUNG = 20.0  # s
LARGEST_DISTURBANCE = 50.0
# Another field that stays while the sensor turns takes the place of the reference.
UNTRIED = 2.0  # s of motion in which a reference is hardly binding
UNTRIED_HEADING = 4.0 * DEGREE  # before the field has turned in the sensor frame
CANDIDATE_SPREAD = 9.0  # (3 σ)²
CANDIDATE_FAR = 16.0  # (4 σ)²
CANDIDATE_AGE = 1.0  # s of motion, at least
OLDEST = 40.0  # s of motion
REST_COUNTS = 0.05  # of a second in motion
SWAP_DEVIATION = 5.0 * DEGREE
STEEPEST = 1e-3  # level part of the field, below which it has no north
# Hard iron left over, from the norm while the field turns in the sensor frame.
IRON_AT_START = 0.1  # of the norm
IRON_NOISE = 0.04  # of the norm, for each radian of turn
IRON_FORGET = 200.0  # rad
IRON_FORGET_DISTURBED = 5.0  # rad: another field tells little of the same iron
IRON_SEEN = 0.05  # of the norm: less than this the room does to the field as well
IRON_RANGE = 10.0  # of the first norm: a stronger field is another's


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
    heading_variance: float = HEADING_AT_START**2  # rad²
    tilt_variance: float = TILT_AT_START**2  # rad², for each axis
    resting: bool = False


class Field(NamedTuple):
    """What the slow room remembers of the magnetometer. Arrays are never changed in place."""

    time: float  # s with a magnetometer
    unit: float  # the first norm
    norm: float  # smoothed
    dip: float  # its sine, smoothed
    norm_reference: float
    dip_reference: float
    reference_age: float  # s of motion
    norm_candidate: float
    dip_candidate: float
    candidate_age: float  # s of motion
    looks: float  # rad that the trusted field turned in the sensor frame
    swaps: int  # how often the candidate took the place of the reference
    delay_sums: Array  # (9,) field 3, its rate 3, rate², samples, time
    delay_moment: float  # their quotient is the delay
    delay_weight: float
    iron: Array  # (4, 5) normal equations of the sphere about the hard iron


class Room(NamedTuple):
    """What the slow room free for itself. Arrays are never changed in place."""

    elapsed: float  # s
    covariance: Array  # (15, 15) of δ, b, E (row-major)
    error: Array  # (3,) δ that is known and not yet corrected
    lag: Array  # (2, 12) how far the low-passed up lags what b and E did
    rest_windows: int
    field: Field


def unknown_field() -> Field:
    """No magnetometer sample seen."""
    return Field(
        0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0,
        np.zeros(9), 0.0, 1.0, np.zeros((4, 5)),
    )  # fmt: skip


def fresh_room() -> Room:
    """Nothing known."""
    variances = np.empty(15)
    variances[0:2] = TILT_AT_START**2
    variances[2] = HEADING_AT_START**2
    variances[3:6] = BIAS_AT_START**2
    variances[6:15] = MISALIGNMENT_AT_START**2
    return Room(0.0, np.diag(variances), np.zeros(3), np.zeros((2, 12)), 0, unknown_field())


def start_anew(room: Room, learned: Learned) -> tuple[Room, Learned]:
    """A new start with the same sensor: attitude and field unknown, calibration kept."""
    covariance = room.covariance.copy()
    covariance[:3, :] = 0.0
    covariance[:, :3] = 0.0
    covariance[0, 0] = covariance[1, 1] = TILT_AT_START**2
    covariance[2, 2] = HEADING_AT_START**2
    old = room.field
    field = Field(
        0.0, old.unit, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, old.swaps,
        np.zeros(9), old.delay_moment, old.delay_weight, old.iron,
    )  # fmt: skip
    room = Room(0.0, covariance, np.zeros(3), np.zeros((2, 12)), 0, field)
    learned = Learned(
        learned.bias, learned.row_x, learned.row_y, learned.row_z,
        learned.delay, learned.hard_iron, 1.0, 0.0, (0.0, 0.0, 0.0),
        HEADING_AT_START**2, TILT_AT_START**2, False,
    )  # fmt: skip
    return room, learned


def first_heading(room: Room, applied: Vector) -> Room:
    """The fast path took its first heading whole: what was known of another one is void."""
    covariance = room.covariance.copy()
    covariance[2, :] = 0.0
    covariance[:, 2] = 0.0
    covariance[2, 2] = HEADING_AT_START**2
    error = room.error.copy()
    error[0] -= applied[0]
    error[1] -= applied[1]
    error[2] = 0.0
    return Room(room.elapsed, covariance, error, room.lag, room.rest_windows, room.field)


def measure(
    state: Array, covariance: Array, row: Array, variance: float, value: float, free: Array
) -> tuple[Array, Array, float]:
    """One scalar Kalman update; where ``free`` is 0 a state is considered, but not corrected.

    Returns the state, the covariance and 1 / (variance of the innovation).
    """
    cross = covariance @ row
    scale = 1.0 / float(row @ cross + variance)
    kept = (1.0 - free) * cross
    state = state + (scale * (value - row @ state)) * (free * cross)
    covariance = covariance - scale * (cross.reshape(15, 1) * cross - kept.reshape(15, 1) * kept)
    return state, covariance, scale


def learn(
    room: Room,
    learned: Learned,
    log: Array,
    rows: int,
    up: Vector,
    applied: Vector,
    tilt_rate: float,
    starting: bool,
    learns_gyro: bool,
    learns_mag: bool,
) -> tuple[Room, Learned]:
    """Look back on a window of ``rows`` rows of the log.

    ``up`` is the low-passed acceleration in the earth frame, ``applied`` what the fast path
    corrected in the window (rad, earth frame), ``tilt_rate`` (1/s) the fastest that it corrects.
    """
    turn = np.empty((rows, 9))  # sensor → earth, row by row
    moved = np.empty((rows, 3))  # rad: the gyroscope's, less the bias
    bx, by, bz = learned.bias
    rate_x = rate_y = rate_z = rate_square = 0.0
    accel_x = accel_y = accel_z = accel_square = 0.0
    motion = 0.0
    for k in range(rows):
        w, x, y, z = log[k, 0], log[k, 1], log[k, 2], log[k, 3]
        gx, gy, gz = log[k, 4], log[k, 5], log[k, 6]
        ax, ay, az = log[k, 7], log[k, 8], log[k, 9]
        xx, xy, xz = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
        yx, yy, yz = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
        turn[k, 0], turn[k, 1], turn[k, 2] = xx, xy, xz
        turn[k, 3], turn[k, 4], turn[k, 5] = yx, yy, yz
        turn[k, 6], turn[k, 7] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x)
        turn[k, 8] = 1.0 - 2.0 * (x * x + y * y)
        span = log[k, 13]
        moved[k, 0], moved[k, 1], moved[k, 2] = (gx - bx) * span, (gy - by) * span, (gz - bz) * span
        rate_x, rate_y, rate_z = rate_x + gx, rate_y + gy, rate_z + gz
        rate_square += gx * gx + gy * gy + gz * gz
        accel_x, accel_y, accel_z = accel_x + ax, accel_y + ay, accel_z + az
        accel_square += ax * ax + ay * ay + az * az
        east_x = xx * ax + xy * ay + xz * az - up[0]
        east_y = yx * ax + yy * ay + yz * az - up[1]
        motion += east_x * east_x + east_y * east_y
    spans = log[:rows, 13].copy()
    time = float(spans.sum())
    elapsed = room.elapsed + time
    settling = 1.0 + (SETTLING / elapsed) ** 2

    # What b and E did to δ in the window.
    effect = np.empty((3, 12))
    effect[:, :3] = -(spans @ turn).reshape(3, 3)
    effect[:, 3:] = (turn.T @ moved).reshape(3, 9)
    covariance = room.covariance.copy()
    parameters = covariance[3:, 3:].copy()
    shift = effect @ parameters
    through = effect @ covariance[3:, :3].copy()
    covariance[:3, :3] += through + through.T + shift @ effect.T
    covariance[:3, 3:] += shift
    covariance[3:, :3] = covariance[:3, 3:].T
    for i in range(3):
        covariance[i, i] += ATTITUDE_WALK * time
        covariance[i + 3, i + 3] += BIAS_WALK * time
    state = np.zeros(15)
    for i in range(3):
        state[i] = room.error[i] - applied[i]
    before = state[:3].copy()
    free = np.ones(15)
    if not learns_gyro:
        free[6:] = 0.0
    row = np.zeros(15)

    # Rest: the gyroscope reads its bias.
    means = (rate_x / rows, rate_y / rows, rate_z / rows)
    rate_noise = rate_square / rows - (means[0] ** 2 + means[1] ** 2 + means[2] ** 2)
    shake = (accel_square - (accel_x**2 + accel_y**2 + accel_z**2) / rows) / rows
    rest_windows = 0
    if (
        rate_noise < REST_RATE_NOISE**2
        and shake < REST_ACCEL_NOISE**2
        and max(abs(means[0]), abs(means[1]), abs(means[2])) < REST_RATE
    ):
        rest_windows = room.rest_windows + 1
    resting = rest_windows >= REST_WINDOWS
    if resting:
        for i in range(3):
            row[:] = 0.0
            row[3 + i] = 1.0
            state, covariance, _ = measure(
                state, covariance, row, REST_VARIANCE / time, means[i] - learned.bias[i], free
            )

    # Tilt: the low-passed up should be vertical.
    fade = math.exp(-time / LOW_PASS)
    lag = fade * room.lag + (LOW_PASS / time) * (1.0 - fade) * effect[:2]
    length = math.sqrt(up[0] ** 2 + up[1] ** 2 + up[2] ** 2) + 1e-12
    motion *= 0.5 / (rows * GRAVITY**2)
    variance = (TILT_VARIANCE + TILT_PER_MOTION * motion) * settling
    own = np.zeros(3)
    leaning = (up[1] / length, -up[0] / length)
    for i in range(2):
        row[:] = 0.0
        row[i] = 1.0
        row[3:] = -lag[i]
        was = state[i]
        state, covariance, _ = measure(state, covariance, row, variance, leaning[i], free)
        own[i] = state[i] - was

    (field, trust, delay, hard_iron, heading_rate, state, covariance, heading_own) = hear(
        room.field,
        learned,
        log,
        turn,
        time,
        effect,
        settling,
        tilt_rate,
        starting,
        state,
        covariance,
        free,
        learns_mag,
    )
    own[2] = heading_own

    drift = (state[:3] - before - own) / WINDOW
    rx, ry, rz = learned.row_x, learned.row_y, learned.row_z
    room = Room(elapsed, covariance, state[:3].copy(), lag, rest_windows, field)
    learned = Learned(
        (
            float(learned.bias[0] + state[3]),
            float(learned.bias[1] + state[4]),
            float(learned.bias[2] + state[5]),
        ),
        (float(rx[0] + state[6]), float(rx[1] + state[7]), float(rx[2] + state[8])),
        (float(ry[0] + state[9]), float(ry[1] + state[10]), float(ry[2] + state[11])),
        (float(rz[0] + state[12]), float(rz[1] + state[13]), float(rz[2] + state[14])),
        float(delay),
        (float(hard_iron[0]), float(hard_iron[1]), float(hard_iron[2])),
        float(trust),
        float(heading_rate),
        (float(drift[0]), float(drift[1]), float(drift[2])),
        float(covariance[2, 2] + state[2] ** 2),
        float(0.5 * (covariance[0, 0] + covariance[1, 1] + state[0] ** 2 + state[1] ** 2)),
        bool(resting),
    )
    return room, learned


def hear(
    field: Field,
    learned: Learned,
    log: Array,
    turn: Array,
    time: float,
    effect: Array,
    settling: float,
    tilt_rate: float,
    starting: bool,
    state: Array,
    covariance: Array,
    free: Array,
    learns_mag: bool,
) -> tuple[Field, float, float, Vector, float, Array, Array, float]:
    """The magnetometer's part: delay, hard iron, trust and heading.

    Returns the field, trust, delay, hard iron, the rate for the fast path (1/s), state,
    covariance, and what of the heading error the fast path will correct by itself.
    """
    bx, by, bz = learned.bias
    rx, ry, rz = learned.row_x, learned.row_y, learned.row_z
    iron = learned.hard_iron
    mean = np.zeros(3)  # earth frame
    rate = np.zeros(3)
    square = 0.0
    count = 0
    for k in range(len(turn)):
        if log[k, 10] == log[k, 10]:
            count += 1
            ux, uy, uz = log[k, 4] - bx, log[k, 5] - by, log[k, 6] - bz
            wx = rx[0] * ux + rx[1] * uy + rx[2] * uz
            wy = ry[0] * ux + ry[1] * uy + ry[2] * uz
            wz = rz[0] * ux + rz[1] * uy + rz[2] * uz
            mx, my, mz = log[k, 10] - iron[0], log[k, 11] - iron[1], log[k, 12] - iron[2]
            cx, cy, cz = wy * mz - wz * my, wz * mx - wx * mz, wx * my - wy * mx
            for i in range(3):
                r0, r1, r2 = turn[k, 3 * i], turn[k, 3 * i + 1], turn[k, 3 * i + 2]
                mean[i] += r0 * mx + r1 * my + r2 * mz
                rate[i] += r0 * cx + r1 * cy + r2 * cz
            square += cx * cx + cy * cy + cz * cz
    if count == 0:
        return field, learned.trust, learned.delay, iron, 0.0, state, covariance, 0.0
    mean /= count
    rate /= count
    square /= count

    # Delay: the field stands still in the earth frame, so what moves with R(ω×m) is delay.
    sums = field.delay_sums.copy()
    sums[0:3] += mean * count
    sums[3:6] += rate * count
    sums[6] += square * count
    sums[7] += count
    sums[8] += time
    moment, weight_of_delay = field.delay_moment, field.delay_weight
    if sums[8] >= DELAY_BLOCK - 0.01:
        n = sums[7]
        square_sum = sums[0] ** 2 + sums[1] ** 2 + sums[2] ** 2
        scale = sums[8] * learned.trust * n / (square_sum + 1e-30)
        moment -= scale * (sums[0] * sums[3] + sums[1] * sums[4] + sums[2] * sums[5]) / n
        weight_of_delay += scale * (sums[6] - (sums[3] ** 2 + sums[4] ** 2 + sums[5] ** 2) / n)
        sums = np.zeros(9)
    delay = learned.delay
    if learns_mag:
        delay = min(max(moment / weight_of_delay, DELAY_RANGE[0]), DELAY_RANGE[1])
    mean = mean - delay * rate

    level = math.sqrt(mean[0] ** 2 + mean[1] ** 2) + 1e-30
    norm = math.sqrt(level**2 + mean[2] ** 2)
    dip = mean[2] / norm
    turned = math.sqrt(square) / norm * time  # rad that the field turned in the sensor frame
    mag_time = field.time + time
    share = min(1.0, max(1.0 - math.exp(-time / FIELD_SMOOTH), time / mag_time))
    first = field.norm_reference == 0.0
    smooth_norm = field.norm + share * (norm - field.norm)
    smooth_dip = field.dip + share * (dip - field.dip)
    norm_reference = smooth_norm if first else field.norm_reference
    dip_reference = smooth_dip if first else field.dip_reference
    norm_candidate = smooth_norm if first else field.norm_candidate
    dip_candidate = smooth_dip if first else field.dip_candidate
    norm_unit = norm if field.unit == 0.0 else field.unit

    # Hard iron: |m|² = 2 m·h + const on a sphere about h.
    normal = field.iron
    hard_iron = iron
    sphere = np.ones((count, 5))
    row_of_sphere = 0
    for k in range(len(turn)):
        if log[k, 10] == log[k, 10]:
            mx, my, mz = log[k, 10] / norm_unit, log[k, 11] / norm_unit, log[k, 12] / norm_unit
            sphere[row_of_sphere, 0] = 2.0 * mx
            sphere[row_of_sphere, 1] = 2.0 * my
            sphere[row_of_sphere, 2] = 2.0 * mz
            sphere[row_of_sphere, 4] = mx * mx + my * my + mz * mz
            row_of_sphere += 1
    if learns_mag and sphere[:, 4].max() < IRON_RANGE**2:
        weight = min(1.0, turned) / (count * (2.0 * IRON_NOISE) ** 2)
        forget = learned.trust / IRON_FORGET
        forget += (1.0 - learned.trust) / IRON_FORGET_DISTURBED
        normal = math.exp(-turned * forget) * normal + weight * (
            np.ascontiguousarray(sphere[:, :4].T) @ sphere
        )
        matrix = normal[:, :4].copy()
        for i in range(3):
            matrix[i, i] += 1.0 / IRON_AT_START**2
        matrix[3, 3] += 1e-6
        found = np.linalg.solve(matrix, normal[:, 4].copy())
        size = found[0] ** 2 + found[1] ** 2 + found[2] ** 2
        kept = norm_unit * max(0.0, 1.0 - IRON_SEEN**2 / (size + 1e-12))
        hard_iron = (kept * found[0], kept * found[1], kept * found[2])

    # Trust: the norm and dip of the field are as they were. Ages count time in motion.
    motion = min(turned, time) + REST_COUNTS * time
    apart = ((norm - norm_candidate) / (NORM_SPREAD * norm_candidate)) ** 2
    apart += ((dip - dip_candidate) / DIP_SPREAD) ** 2
    candidate_age = field.candidate_age
    if apart > CANDIDATE_SPREAD:
        norm_candidate, dip_candidate, candidate_age = norm, dip, 0.0
    candidate_age += motion
    share = motion / min(candidate_age, OLDEST)
    norm_candidate += share * (norm - norm_candidate)
    dip_candidate += share * (dip - dip_candidate)
    off = ((smooth_norm - norm_reference) / (NORM_SPREAD * norm_reference)) ** 2
    off += ((smooth_dip - dip_reference) / DIP_SPREAD) ** 2
    tried = 1.0 + (UNTRIED / max(field.reference_age, 1e-3)) ** 2
    trust = 1.0 / (1.0 + min(off / tried, LARGEST_DISTURBANCE))
    reference_age = min(field.reference_age + motion * trust, OLDEST)
    innovation = math.atan2(mean[1], mean[0])
    looks = field.looks
    swaps = field.swaps
    if off > CANDIDATE_FAR and candidate_age >= max(CANDIDATE_AGE, reference_age):
        norm_reference = smooth_norm = norm_candidate
        dip_reference = smooth_dip = dip_candidate
        reference_age = candidate_age
        trust = 1.0
        swaps += 1
        looks = 0.0
        covariance[2, :] = 0.0
        covariance[:, 2] = 0.0
        covariance[2, 2] = SWAP_DEVIATION**2 + (innovation + state[2]) ** 2
    else:
        share = trust * max(time / REFERENCE, time / mag_time)
        if mag_time < YOUNG:
            share = time / mag_time
        share = min(1.0, share + time / REFERENCE_DISTURBED)
        norm_reference += share * (smooth_norm - norm_reference)
        dip_reference += share * (smooth_dip - dip_reference)

    # Heading. The magnetometer never moves tilt.
    looks += trust * turned
    covariance[2, 2] = max(covariance[2, 2], (UNTRIED_HEADING / (1.0 + looks)) ** 2)
    heading_rate, own = 0.0, 0.0
    if level > STEEPEST * norm:
        steep = mean[2] / level
        row = np.zeros(15)
        row[0] = steep
        row[2] = -1.0
        row[3:] = 0.5 * (effect[2] - steep * effect[0])
        variance = HEADING_VARIANCE / (trust * time) * settling
        if not learns_mag:
            variance += square * (DELAY_UNKNOWN / level) ** 2
        free = free.copy()
        free[0:2] = 0.0
        was = state[2]
        toward = -(covariance[2] @ row)
        state, covariance, scale = measure(state, covariance, row, variance, innovation, free)
        gain_here = min(max(toward * scale, 0.0), 0.999)
        heading_rate = -math.log(1.0 - gain_here) / time
        own = state[2] - was
        if heading_rate > tilt_rate and not starting:
            own *= (1.0 - math.exp(-time * tilt_rate)) / gain_here
    field = Field(
        mag_time,
        norm_unit,
        smooth_norm,
        smooth_dip,
        norm_reference,
        dip_reference,
        reference_age,
        norm_candidate,
        dip_candidate,
        candidate_age,
        looks,
        swaps,
        sums,
        moment,
        weight_of_delay,
        normal,
    )
    return field, trust, delay, hard_iron, heading_rate, state, covariance, own
