"""What every filter does with its samples before it filters: keep the good, replace the rest.

`feel` takes the rates of one step, then a filter predicts, and `look` makes a snapshot of
accelerometer and magnetometer. Nothing that comes in, and nothing that fails to come, stops a
filter: a rate that is none is held, and where the magnetometer has nothing to say the snapshot
takes the north that the filter predicts.
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
FASTEST = 350.0  # rad/s, all axes together: the fastest gyroscope, with one axis, does 20 000 °/s
WEAKEST, STRONGEST = 0.05, 400.0  # m/s²: free fall has no up, and 40 g are no acceleration
FIRST_HEADING = 3  # that is how `heading_known` begins: it may be given up twice
ASKED = FIRST_HEADING + 1  # a heading that was known, after a gap: given up once more
DOUBTED = ASKED + 1  # it is known, but the last field was not taken: the next is believed


class Senses(NamedTuple):
    """What a filter remembers of its samples."""

    rate: Vector = (0.0, 0.0, 0.0)  # the last good one, rad/s
    mag: Vector = NORTH  # the last good one, carried along by the gyroscope (but in `correction`)
    mag_age: float = math.inf  # s
    started: bool = False  # tilt is known
    # Above 0 where a magnetometer has told north since the start: `FIRST_HEADING` by one field, 1
    # by two that agree; each that was given up makes it one less (see `spikes`). `ASKED` and
    # `DOUBTED` as well.
    heading_known: int = 0
    turned: bool = False  # the snapshot's own sign is the opposite of the filter's
    sign_corrections: int = 0  # how often that changed: the jumps of a stateless rotor
    gyro_rejected: int = 0
    accel_rejected: int = 0
    mag_rejected: int = 0


class Sources(NamedTuple):
    """What the user chose of the sensors."""

    use_mag: bool
    mag_timeout: float
    north_at_start: Vector


Felt = tuple[Rotor, Vector, int]  # the turn since the last step, its rate, rates rejected so far


def sources(settings: Settings) -> Sources:
    """The settings as `look` takes them."""
    return Sources(settings.use_mag, float(settings.mag_timeout), settings.north_at_start)


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


def heard(mag: Vector) -> bool:
    """Whether a sample can be a magnetic field."""
    x, y, z = mag
    return 1e-24 < x * x + y * y + z * z < 1e24


def came(mag: Vector) -> bool:
    """Whether there is a sample, good or not: where none came, it is NaN."""
    return mag[0] == mag[0] or mag[1] == mag[1] or mag[2] == mag[2]


snapshot = dcm  # `bind` puts another in its place


def look(
    senses: Senses,
    sources: Sources,
    felt: Felt,
    accel: Vector,
    mag: Vector,
    predicted: Rotor,
    dt: float,
) -> tuple[Senses, bool, bool, bool, Rotor]:
    """The attitude that specific force and magnetic field show; a ``dt`` of 0 starts anew.

    ``mag`` is NaN where no new sample came; the last one is carried along by the gyroscope until
    it is stale. Returns

    - what is remembered from now on;
    - whether there is a snapshot; if not, tilt and heading follow the gyroscope;
    - whether its heading is the magnetometer's, and not that of ``predicted``;
    - whether the filter begins here, or learns its heading here, and takes it as it is;
    - the snapshot, sensor → earth (NWU), in the sign of ``predicted`` (eq. 4).
    """
    turn, rate, gyro_rejected = felt
    (
        _, last_mag, mag_age, started, heading_known, turned, sign_corrections, _, accel_rejected,
        mag_rejected,
    ) = senses  # fmt: skip
    starts = dt <= 0.0 or not started
    if dt <= 0.0:
        heading_known = 0

    mag_age = mag_age + dt if dt > 0.0 else math.inf  # it told another time's heading
    fresh = heard(mag)
    if not fresh and came(mag):
        mag_rejected += 1
    field = mag if fresh else carried(turn, last_mag)
    has_up = usable(accel)
    if not has_up:
        accel_rejected += 1

    from_mag, rotor = False, IDENTITY
    if has_up and sources.use_mag and (fresh or mag_age <= sources.mag_timeout):
        if starts or heading_known > 0:
            from_mag, rotor = snapshot(accel, field)
        else:  # the first heading leaves the tilt alone
            from_mag, rotor = snapshot(carried(unit(predicted), UP), field)
        if fresh and not from_mag:  # along gravity
            fresh = False
            mag_rejected += 1
            field = carried(turn, last_mag)
    begins = starts or (from_mag and heading_known <= 0)
    if from_mag:
        heading_known = FIRST_HEADING if begins else 1
    if fresh:
        mag_age = 0.0
    found = from_mag
    if has_up and not found:
        north = sources.north_at_start
        if started:
            north = carried(unit(predicted), NORTH)
        found, rotor = dcm(accel, north)
        if starts and not found:
            found, rotor = dcm(accel, UP)

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
        heading_known,
        turned,
        sign_corrections,
        gyro_rejected,
        accel_rejected,
        mag_rejected,
    )
    return now, found, from_mag, begins and found, rotor


def amended(
    senses: Senses, started: bool, heading_known: int, mag_age: float, accel_rejected: int
) -> Senses:
    """The same, but for these."""
    rate, mag, _, _, _, turned, sign_corrections, gyro_rejected, _, mag_rejected = senses
    return Senses(
        rate, mag, mag_age, started, heading_known, turned, sign_corrections, gyro_rejected,
        accel_rejected, mag_rejected,
    )  # fmt: skip


def without_mag(senses: Senses, felt: Felt, accel: Vector) -> Senses:
    """What is remembered where there is no magnetometer and nothing to start from."""
    has_up = usable(accel)
    return Senses(
        felt[1],
        senses.mag,
        math.inf,
        senses.started or has_up,
        0,
        False,
        0,
        felt[2],
        senses.accel_rejected + (not has_up),
        senses.mag_rejected,
    )
