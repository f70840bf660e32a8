"""The stateful complementary filter of Kusaka and Tanaka (eq. 12 and 16).

The gyroscope path ``q ⊗ q_ω`` and the snapshot of accelerometer and magnetometer are blended
element by element, which is allowed because the snapshot takes the sign that continues the
gyroscope path.

Deviations from the paper
- The rotor of eq. 12 is exact (eq. 11) where one step turns by more than 0.2 rad.
- Eq. 14 multiplies the gyroscope's rotor on the left, as if rates were measured in the earth
  frame. A strapped-down gyroscope measures in the sensor frame: the rotor goes on the right.
- The sign of the snapshot is compared with the predicted rotor; eq. 3 has the last one.
- Not in the paper, and off where the filter is called the paper's: the rotor is normalised after
  each blend, and for the first second the blend is the mean of all snapshots so far.
- The paper leaves the start open: the first snapshot is taken as it is, after a restart with the
  sign that continues, and so is the first heading that a magnetometer gives.
- The paper blends once for each sample of all three sensors. Here α may be given for a fixed
  span of time, and a magnetometer sample that is missing, stale or useless costs only its
  heading: the snapshot is then taken with the north that the gyroscope predicts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ..errors import UsageError
from ..rotor import (
    IDENTITY,
    Rotor,
    Vector,
    blend,
    conjugate,
    dot,
    from_rate,
    negative,
    product,
    rotate,
    unit,
)
from ..snapshot.dcm import dcm
from .compiled import run_steps
from .samples import Array, Samples
from .stamps import steps

NORTH: Vector = (1.0, 0.0, 0.0)
UP: Vector = (0.0, 0.0, 1.0)
NO_MAG: Vector = (math.nan, math.nan, math.nan)
START = 1.0  # s
FASTEST = 1e3  # rad/s; no gyroscope measures more
WEAKEST, STRONGEST = 0.05, 1e4  # m/s²; below is free fall, where noise alone has a direction


@dataclass(frozen=True)
class Settings:
    """What a user chooses. Times in seconds."""

    alpha: float = 0.9967  # weight of the gyroscope path over 1 / alpha_rate
    alpha_rate: float = 100.0  # Hz; 0: alpha applies to each sample, as in the paper
    stateful: bool = True  # False: the snapshot keeps its own sign, the paper's baseline
    normalise: bool = True  # after each blend, if stateful; the paper does not
    average_start: bool = True  # in the first second the mean of all snapshots; not in the paper
    use_mag: bool = True
    mag_timeout: float = 0.5  # older than this a magnetometer sample is stale
    north_at_start: Vector = NORTH  # sensor axis taken for north until a magnetometer tells
    # Of `learning` alone, which learns the gyroscope's bias in any case; False keeps what is known:
    learn_misalignment: bool = True  # of the gyroscope's axes, and their scale
    learn_mag: bool = True  # the magnetometer's delay and the hard iron left over

    def __post_init__(self) -> None:
        """Refuse what makes no filter."""
        if not 0.0 <= self.alpha <= 1.0:
            raise UsageError(f"alpha must be between 0 and 1, got {self.alpha}.")
        if not 0.0 <= self.alpha_rate <= 1e6:
            raise UsageError(
                f"alpha_rate must be between 0 (alpha applies to each sample) and 1e6 Hz, "
                f"got {self.alpha_rate}."
            )
        if not self.mag_timeout >= 0.0:
            raise UsageError(f"mag_timeout must be 0 or more s, got {self.mag_timeout}.")
        if not any(self.north_at_start):
            raise UsageError("north_at_start must be a direction, got zero.")

    @property
    def time_constant(self) -> float:
        """Seconds in which the snapshot's weight grows to 1 − 1/e; nan if α is per sample."""
        if self.alpha_rate <= 0.0:
            return math.nan
        if self.alpha <= 0.0:
            return 0.0
        if self.alpha >= 1.0:
            return math.inf
        return -1.0 / (self.alpha_rate * math.log(self.alpha))


class Gains(NamedTuple):
    """The settings as the kernel takes them."""

    alpha: float
    alpha_rate: float
    stateful: bool
    normalise: bool
    average_start: bool
    use_mag: bool
    mag_timeout: float
    north_at_start: Vector


class State(NamedTuple):
    """All that the filter carries from sample to sample."""

    rotor: Rotor = IDENTITY  # sensor → earth (NWU); of unit length only if normalised
    rate: Vector = (0.0, 0.0, 0.0)  # the last good one, rad/s
    mag: Vector = NORTH  # the last good one, carried along by the gyroscope
    mag_age: float = math.inf  # s
    started: bool = False  # tilt is known
    elapsed: float = 0.0  # s since the start, or since heading became known
    heading_known: bool = False  # a magnetometer has told north since the start
    turned: bool = False  # the snapshot's own sign is the opposite of the filter's
    sign_corrections: int = 0  # how often that changed: the jumps of a stateless rotor
    gyro_rejected: int = 0
    accel_rejected: int = 0
    mag_rejected: int = 0


COUNTS = ("sign_corrections", "gyro_rejected", "accel_rejected", "mag_rejected")


@dataclass(frozen=True)
class Report:
    """What /diagnostics shows of a filter."""

    started: bool
    heading_from_mag: bool
    mag_age: float  # s, inf before the first
    sign_corrections: int
    gyro_rejected: int
    accel_rejected: int
    mag_rejected: int


def step(state: State, gains: Gains, gyro: Vector, accel: Vector, mag: Vector, dt: float) -> State:
    """Take one sample of all sensors, ``dt`` s after the last; 0 starts anew (eq. 16).

    ``mag`` is NaN where no new one came. Anything that is not finite or not physical is left
    out: rates are held, tilt and heading follow the gyroscope for the time being.
    """
    rate = gyro
    gyro_rejected = state.gyro_rejected
    if not abs(gyro[0]) + abs(gyro[1]) + abs(gyro[2]) < FASTEST:
        rate = state.rate
        gyro_rejected += 1
    turn = from_rate(rate, dt)
    predicted = product(state.rotor, turn)

    starts = dt <= 0.0 or not state.started
    heading_known = state.heading_known and dt > 0.0

    carried = rotate(conjugate(turn), state.mag)
    mag_age = state.mag_age + dt if dt > 0.0 else math.inf  # it told another time's heading
    fresh = False
    mag_rejected = state.mag_rejected
    if mag[0] == mag[0] or mag[1] == mag[1] or mag[2] == mag[2]:
        field = mag[0] * mag[0] + mag[1] * mag[1] + mag[2] * mag[2]
        fresh = 1e-24 < field < 1e24
        if not fresh:
            mag_rejected += 1

    force = accel[0] * accel[0] + accel[1] * accel[1] + accel[2] * accel[2]
    has_up = WEAKEST * WEAKEST < force < STRONGEST * STRONGEST
    found, snapshot = False, IDENTITY
    first_heading = False
    if has_up and gains.use_mag and (fresh or mag_age <= gains.mag_timeout):
        up = accel
        if not (starts or heading_known):  # the first heading leaves the tilt alone
            up = rotate(conjugate(unit(predicted)), UP)
        found, snapshot = dcm(up, mag if fresh else carried)
        first_heading = found and not heading_known
        if fresh and not found:  # along gravity
            fresh = False
            mag_rejected += 1
    if fresh:
        carried = mag
        mag_age = 0.0
    heading_known = heading_known or found
    if has_up and not found:
        north = gains.north_at_start
        if state.started:
            north = rotate(conjugate(unit(predicted)), NORTH)
        found, snapshot = dcm(accel, north)
        if starts and not found:
            found, snapshot = dcm(accel, UP)

    accel_rejected = state.accel_rejected
    turned = state.turned
    sign_corrections = state.sign_corrections
    elapsed = state.elapsed + dt
    rotor = predicted
    if found:
        turned = dot(snapshot, predicted) < 0.0
        if turned != state.turned:
            sign_corrections += 1
        if turned and (gains.stateful or starts or first_heading):
            snapshot = negative(snapshot)  # eq. 4
        if starts or first_heading:
            rotor = snapshot
            elapsed = 0.0 if starts else elapsed
        else:
            weight = gains.alpha
            if gains.alpha_rate > 0.0:
                weight = gains.alpha ** (dt * gains.alpha_rate)
            if gains.average_start and elapsed < START:
                weight = min(weight, elapsed / (elapsed + dt))
            rotor = blend(predicted, snapshot, weight)  # eq. 16
    if not has_up:
        accel_rejected += 1
    square = dot(rotor, rotor)
    if not square > 1e-12:  # only a stateless blend of opposite signs can vanish
        rotor = predicted
    elif gains.normalise and gains.stateful:
        rotor = unit(rotor)
    return State(
        rotor,
        rate,
        carried,
        mag_age,
        state.started or found,
        elapsed,
        heading_known,
        turned,
        sign_corrections,
        gyro_rejected,
        accel_rejected,
        mag_rejected,
    )


class StatefulFilter:
    """The filter with its settings and state; one instance for each sensor.

    ``fixed`` are settings that belong to the filter's name and that no user changes. Rotors
    returned are of unit length, sensor → earth (north-west-up), and continue in sign.
    """

    def __init__(self, settings: Settings = Settings(), **fixed: Any) -> None:
        self._fixed = fixed
        self.settings = settings
        self._state = State()
        self.reset()

    @property
    def settings(self) -> Settings:
        """May be replaced at any time; the next sample is taken with the new ones."""
        return self._settings

    @settings.setter
    def settings(self, settings: Settings) -> None:
        self._settings = settings = replace(settings, **self._fixed)
        self._gains = Gains(
            float(settings.alpha),
            float(settings.alpha_rate),
            settings.stateful,
            settings.normalise,
            settings.average_start,
            settings.use_mag,
            float(settings.mag_timeout),
            settings.north_at_start,
        )

    def reset(self) -> None:
        """Forget everything but the counts; the next sample starts anew."""
        counts = {name: getattr(self._state, name) for name in COUNTS}
        self._state = self._before = State(**counts)
        self._mag = NO_MAG
        self._inputs: tuple[Vector, Vector, float] | None = None

    def update_mag(self, mag: Vector) -> None:
        """Give the magnetometer sample (sensor frame, any unit) for the next `update_imu`."""
        self._mag = mag

    def update_imu(self, gyro: Vector, accel: Vector, dt: float) -> Rotor:
        """Take rates (rad/s) and specific force (m/s²), ``dt`` s after the last ones.

        A ``dt`` of 0 starts anew from this sample, continuing the sign of the last rotor.
        """
        self._before = self._state
        self._inputs = (gyro, accel, dt)
        self._state = step(self._state, self._gains, gyro, accel, self._mag, dt)
        self._mag = NO_MAG
        return self.rotor

    def amend_mag(self, mag: Vector) -> None:
        """Take the last step again with its magnetometer sample, which came after it."""
        if self._inputs is None:  # reset since
            return
        gyro, accel, dt = self._inputs
        self._state = step(self._before, self._gains, gyro, accel, mag, dt)

    def run(self, samples: Samples) -> Array:
        """Rotors (n, 4) for a whole recording, from a fresh start; compiled where numba is."""
        rotors = np.empty((len(samples), 4))
        self._state = State()
        self.reset()
        self._state = run_steps(step)(
            self._state,
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
        return unit(self._state.rotor)

    @property
    def started(self) -> bool:
        """Whether the attitude is known."""
        return self._state.started

    @property
    def heading_known(self) -> bool:
        """Whether a magnetometer has told north since the start."""
        return self._state.heading_known

    @property
    def report(self) -> Report:
        """What the filter has to say of itself."""
        state = self._state
        return Report(
            started=state.started,
            heading_from_mag=self._gains.use_mag
            and state.heading_known
            and state.mag_age <= self._gains.mag_timeout,
            mag_age=state.mag_age,
            sign_corrections=state.sign_corrections,
            gyro_rejected=state.gyro_rejected,
            accel_rejected=state.accel_rejected,
            mag_rejected=state.mag_rejected,
        )
