"""What every filter does with its samples before it filters: keep the good, replace the rest.

`feel` takes the rates of one step, then a filter predicts, and `look` makes a snapshot of
accelerometer and magnetometer. Nothing that comes in, and nothing that fails to come, stops a
filter: a rate that is none is held, and where the magnetometer has nothing to say the snapshot
takes the north that the filter predicts.

Two things make a snapshot better than the samples of one instant, both off in the paper. Up may
be low-passed, in axes that the gyroscope carries along: there gravity stands still and motion
averages out. And north may lie anywhere between the predicted one and the measured one.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..rotor import (
    IDENTITY,
    Rotor,
    Vector,
    carried,
    dot,
    from_rate,
    negative,
    unit,
)
from ..snapshot.dcm import dcm
from .settings import NORTH, Settings

UP: Vector = (0.0, 0.0, 1.0)
FASTEST = 1e3  # rad/s; no gyroscope measures more
WEAKEST, STRONGEST = 0.05, 400.0  # m/s²: free fall has no up, and 40 g are no acceleration
LOW_PASS = 2.0  # s
LEVEL = 1e-3  # of the field: a smaller level part has no north


class Senses(NamedTuple):
    """What a filter remembers of its samples."""

    rate: Vector = (0.0, 0.0, 0.0)  # the last good one, rad/s
    mag: Vector = NORTH  # the last good one, carried along by the gyroscope
    mag_age: float = math.inf  # s
    started: bool = False  # tilt is known
    heading_known: bool = False  # a magnetometer has told north since the start
    turned: bool = False  # the snapshot's own sign is the opposite of the filter's
    sign_corrections: int = 0  # how often that changed: the jumps of a stateless rotor
    gyro_rejected: int = 0
    accel_rejected: int = 0
    mag_rejected: int = 0
    up: Vector = UP  # low-passed specific force, carried along by the gyroscope, m/s²
    up_time: float = 0.0  # s that went into it, at most LOW_PASS


class Sources(NamedTuple):
    """What the user chose of the sensors."""

    use_mag: bool
    mag_timeout: float
    north_at_start: Vector
    low_pass: bool  # up is the low-passed one
    keeps_up: bool  # it is at least kept


Felt = tuple[Rotor, Vector, int]  # the turn since the last step, its rate, rates rejected so far


def sources(settings: Settings, low_pass: bool = False, keeps_up: bool = False) -> Sources:
    """The settings as `look` takes them."""
    return Sources(
        settings.use_mag,
        float(settings.mag_timeout),
        settings.north_at_start,
        low_pass,
        keeps_up or low_pass,
    )


def held(senses: Senses, gyro: Vector) -> tuple[Vector, int]:
    """Rates (rad/s), the last good ones where these are none; and how many were none so far."""
    if abs(gyro[0]) + abs(gyro[1]) + abs(gyro[2]) < FASTEST:
        return gyro, senses.gyro_rejected
    return senses.rate, senses.gyro_rejected + 1


def feel(senses: Senses, gyro: Vector, dt: float) -> Felt:
    """Take rates (rad/s), ``dt`` s after the last; those that are none are held (eq. 12)."""
    rate, rejected = held(senses, gyro)
    return from_rate(rate, dt), rate, rejected


def usable(accel: Vector) -> bool:
    """Whether specific force (m/s²) can be gravity's."""
    x, y, z = accel
    square = x * x + y * y + z * z
    return WEAKEST * WEAKEST < square < STRONGEST * STRONGEST


def low_passed(
    up: Vector, time: float, turn: Rotor, accel: Vector, good: bool, dt: float
) -> tuple[Vector, float]:
    """The mean of specific force, at first of all samples, in axes that the gyroscope carries."""
    x, y, z = carried(turn, up)
    if good:
        time += dt
        s = dt / time
        ax, ay, az = accel
        x, y, z = x + s * (ax - x), y + s * (ay - y), z + s * (az - z)
        if time > LOW_PASS:
            time = LOW_PASS
    return (x, y, z), time


snapshot = dcm  # `bind` puts another in its place


def between(predicted: Rotor, up: Vector, field: Vector, share: float) -> Vector:
    """North in the sensor frame: ``share`` of the measured one, the rest of the predicted one.

    It is level where the prediction is, so that it moves heading alone, and zero where the field
    has no north. How long the level part of the field is ``up`` tells: it is known before the
    prediction is, and a processor that need not wait for that root is faster by a tenth.
    """
    ux, uy, uz = up
    fx, fy, fz = field
    square = ux * ux + uy * uy + uz * uz
    along = ux * fx + uy * fy + uz * fz
    whole = square * (fx * fx + fy * fy + fz * fz)
    across = whole - along * along
    if not across > LEVEL * LEVEL * whole:
        return (0.0, 0.0, 0.0)
    s = share * math.sqrt(square / across)
    w, x, y, z = predicted
    a, b, xy, wz = w * w - z * z, x * x - y * y, x * y, w * z
    nx, ny, nz = a + b, 2.0 * (xy - wz), 2.0 * (x * z + w * y)
    wx, wy, wz = 2.0 * (xy + wz), a - b, 2.0 * (y * z - w * x)
    north = 1.0 - share + s * (nx * fx + ny * fy + nz * fz)
    west = s * (wx * fx + wy * fy + wz * fz)
    return (north * nx + west * wx, north * ny + west * wy, north * nz + west * wz)


def look(
    senses: Senses,
    sources: Sources,
    felt: Felt,
    accel: Vector,
    mag: Vector,
    predicted: Rotor,
    dt: float,
    share: float = 1.0,
) -> tuple[Senses, bool, bool, bool, Rotor]:
    """The attitude that specific force and magnetic field show; a ``dt`` of 0 starts anew.

    ``mag`` is NaN where no new sample came; the last one is carried along by the gyroscope until
    it is stale. ``share`` is how far north is the measured one: 1 in the paper, where it is
    north wholly; below or above, it is `between`. Returns

    - what is remembered from now on;
    - whether there is a snapshot; if not, tilt and heading follow the gyroscope;
    - whether its heading is the magnetometer's, and not that of ``predicted``;
    - whether the filter begins here, or learns its heading here, and takes it as it is;
    - the snapshot, sensor → earth (NWU), in the sign of ``predicted`` (eq. 4).
    """
    turn, rate, gyro_rejected = felt
    (
        _, last_mag, mag_age, started, heading_known, turned, sign_corrections, _, accel_rejected,
        mag_rejected, up_kept, up_time,
    ) = senses  # fmt: skip
    starts = dt <= 0.0 or not started
    heading_known = heading_known and dt > 0.0

    mag_age = mag_age + dt if dt > 0.0 else math.inf  # it told another time's heading
    fresh = False
    if mag[0] == mag[0] or mag[1] == mag[1] or mag[2] == mag[2]:
        square = mag[0] * mag[0] + mag[1] * mag[1] + mag[2] * mag[2]
        fresh = 1e-24 < square < 1e24
        if not fresh:
            mag_rejected += 1
    field = mag if fresh else carried(turn, last_mag)

    has_up = usable(accel)
    if not has_up:
        accel_rejected += 1
    up = accel
    if sources.keeps_up and not starts:
        up_kept, up_time = low_passed(up_kept, up_time, turn, accel, has_up, dt)
        if sources.low_pass:
            up = up_kept
            has_up = usable(up)
    else:
        up_kept, up_time = accel if has_up else up_kept, 0.0

    from_mag, rotor = False, IDENTITY
    if has_up and sources.use_mag and (fresh or mag_age <= sources.mag_timeout):
        if starts or (heading_known and share == 1.0):
            from_mag, rotor = snapshot(up, field)
        elif heading_known:
            from_mag, rotor = snapshot(up, between(predicted, up, field, share))
        else:  # the first heading leaves the tilt alone
            from_mag, rotor = snapshot(carried(unit(predicted), UP), field)
        if fresh and not from_mag:  # along gravity
            fresh = False
            mag_rejected += 1
            field = carried(turn, last_mag)
    begins = starts or (from_mag and not heading_known)
    if fresh:
        mag_age = 0.0
    found = from_mag
    if has_up and not found:
        north = sources.north_at_start
        if started:
            north = carried(unit(predicted), NORTH)
        found, rotor = dcm(up, north)
        if starts and not found:
            found, rotor = dcm(up, UP)

    if found:
        was_turned = turned
        turned = dot(rotor, predicted) < 0.0
        if turned:
            rotor = negative(rotor)
        if turned != was_turned:
            sign_corrections += 1
    now = Senses(
        rate,
        field,
        mag_age,
        found or (started and dt > 0.0),
        heading_known or from_mag,
        turned,
        sign_corrections,
        gyro_rejected,
        accel_rejected,
        mag_rejected,
        up_kept,
        up_time,
    )
    return now, found, from_mag, begins and found, rotor


def without_mag(senses: Senses, felt: Felt, accel: Vector) -> Senses:
    """What is remembered where there is no magnetometer and nothing to start from."""
    has_up = usable(accel)
    return Senses(
        felt[1],
        senses.mag,
        math.inf,
        senses.started or has_up,
        False,
        False,
        0,
        felt[2],
        senses.accel_rejected + (not has_up),
        senses.mag_rejected,
        senses.up,
        senses.up_time,
    )
