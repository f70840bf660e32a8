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
    conjugate,
    dot,
    from_rate,
    negative,
    rotate,
    unit,
)
from ..snapshot.dcm import dcm
from .settings import NORTH, Settings

UP: Vector = (0.0, 0.0, 1.0)
FASTEST = 1e3  # rad/s; no gyroscope measures more
WEAKEST, STRONGEST = 0.05, 1e4  # m/s²; below is free fall, where noise alone has a direction


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


class Sources(NamedTuple):
    """What the user chose of the sensors."""

    use_mag: bool
    mag_timeout: float
    north_at_start: Vector


Felt = tuple[Rotor, Vector, int]  # the turn since the last step, its rate, rates rejected so far


def sources(settings: Settings) -> Sources:
    """The settings as `look` takes them."""
    return Sources(settings.use_mag, float(settings.mag_timeout), settings.north_at_start)


def feel(senses: Senses, gyro: Vector, dt: float) -> Felt:
    """Take rates (rad/s), ``dt`` s after the last; those that are none are held (eq. 12)."""
    if abs(gyro[0]) + abs(gyro[1]) + abs(gyro[2]) < FASTEST:
        return from_rate(gyro, dt), gyro, senses.gyro_rejected
    return from_rate(senses.rate, dt), senses.rate, senses.gyro_rejected + 1


def usable(accel: Vector) -> bool:
    """Whether specific force (m/s²) can be gravity's."""
    square = accel[0] * accel[0] + accel[1] * accel[1] + accel[2] * accel[2]
    return WEAKEST * WEAKEST < square < STRONGEST * STRONGEST


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
    starts = dt <= 0.0 or not senses.started
    heading_known = senses.heading_known and dt > 0.0

    carried = rotate(conjugate(turn), senses.mag)
    mag_age = senses.mag_age + dt if dt > 0.0 else math.inf  # it told another time's heading
    fresh = False
    mag_rejected = senses.mag_rejected
    if mag[0] == mag[0] or mag[1] == mag[1] or mag[2] == mag[2]:
        field = mag[0] * mag[0] + mag[1] * mag[1] + mag[2] * mag[2]
        fresh = 1e-24 < field < 1e24
        if not fresh:
            mag_rejected += 1

    has_up = usable(accel)
    from_mag, rotor = False, IDENTITY
    if has_up and sources.use_mag and (fresh or mag_age <= sources.mag_timeout):
        up = accel
        if not (starts or heading_known):  # the first heading leaves the tilt alone
            up = rotate(conjugate(unit(predicted)), UP)
        from_mag, rotor = snapshot(up, mag if fresh else carried)
        if fresh and not from_mag:  # along gravity
            fresh = False
            mag_rejected += 1
    begins = starts or (from_mag and not heading_known)
    if fresh:
        carried = mag
        mag_age = 0.0
    found = from_mag
    if has_up and not found:
        north = sources.north_at_start
        if senses.started:
            north = rotate(conjugate(unit(predicted)), NORTH)
        found, rotor = dcm(accel, north)
        if starts and not found:
            found, rotor = dcm(accel, UP)

    turned = senses.turned
    sign_corrections = senses.sign_corrections
    if found:
        turned = dot(rotor, predicted) < 0.0
        if turned:
            rotor = negative(rotor)
        if turned != senses.turned:
            sign_corrections += 1
    accel_rejected = senses.accel_rejected
    if not has_up:
        accel_rejected += 1
    now = Senses(
        rate,
        carried,
        mag_age,
        senses.started or found,
        heading_known or from_mag,
        turned,
        sign_corrections,
        gyro_rejected,
        accel_rejected,
        mag_rejected,
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
    )
