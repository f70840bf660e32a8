"""The algebraic quaternion filter (AQUA) of Valenti et al., as in the EE615 report.

R. G. Valenti, I. Dryanovski, J. Xiao, "Keeping a Good Attitude: A Quaternion-Based Orientation
Filter for IMUs and MARGs", Sensors 15 (2015) 19302; P. J. Rathour and T. S. Pagare, "Sensor Fusion
Using Complementary Filter", EE615, 2023, section 4. Accelerometer and then magnetometer each turn
the predicted rotor by a part of the way that would bring up to up and north to north. The part is
1 − α, as in every other filter here; for the accelerometer it falls with the force's excess over
gravity.

Deviations from the report, none of them in `AS_PRINTED`
- Rotors are sensor → earth and corrections stand on the left; the report's are the conjugates.
- Its listing never multiplies the correction into the attitude, so that it is the gyroscope alone,
  less the bias at rest. Its SLERP has a bracket and a gain misplaced.
- Its gain falls by ``(t2 − e)/t1``, which is continuous only for t2 = 2 t1.
- It has no magnetometer; that part is Valenti's.
- The bias takes 0.01 of the difference in each sample; here at 100 Hz, and as much per second
  at any rate.
- It starts at the identity. Here it starts with the first snapshot.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..rotor import IDENTITY, Rotor, Vector, from_rate, minus, negative, product, rotate, unit
from .gains import weight_of_gyro
from .kernel import Kernel
from .senses import Senses, Sources, feel, look, sources, without_mag
from .settings import Settings

GRAVITY = 9.81  # m/s²
FULL, NO_GAIN = 0.1, 0.2  # of gravity: t1 and t2 of eq. 23
NEAR = 0.9  # cosine of half the correction above which LERP will do
BIAS_GAIN = 1.0  # 1/s
STEADY_ACCEL = 0.1  # m/s², from gravity
STEADY_CHANGE = 0.01  # rad/s, from sample to sample
STEADY_RATE = 0.1  # rad/s, from the bias


class Gains(NamedTuple):
    """The settings as the kernel takes them."""

    sources: Sources
    alpha: float
    alpha_rate: float


class State(NamedTuple):
    """All that the filter carries from sample to sample."""

    rotor: Rotor = IDENTITY
    senses: Senses = Senses()
    bias: Vector = (0.0, 0.0, 0.0)  # rad/s


def step(state: State, gains: Gains, gyro: Vector, accel: Vector, mag: Vector, dt: float) -> State:
    """Take one sample of all sensors, ``dt`` s after the last; 0 starts anew."""
    felt = feel(state.senses, gyro, dt)
    bias = state.bias
    if felt[2] == state.senses.gyro_rejected:  # a rate that is held is no rest
        bias = learned(bias, state.senses.rate, felt[1], accel, dt)
    predicted = product(state.rotor, from_rate(minus(felt[1], bias), dt))
    senses, found, from_mag, begins, snapshot = look(
        state.senses, gains.sources, felt, accel, mag, predicted, dt
    )
    rotor = predicted
    if begins:
        rotor = snapshot
    elif found:
        gain = 1.0 - weight_of_gyro(gains.alpha, gains.alpha_rate, dt)
        g = length(accel)
        part = gain * gain_factor(abs(g - GRAVITY) / GRAVITY)
        up = rotate(rotor, (accel[0] / g, accel[1] / g, accel[2] / g))
        rotor = product(part_of(levelling(up), part), rotor)
        if from_mag:
            rotor = product(part_of(northing(rotate(rotor, senses.mag)), gain), rotor)
    return State(unit(rotor), senses, bias)


def gain_factor(excess: float) -> float:
    """What is left of the gain (eq. 23), given the force's excess over gravity, in gravities."""
    return min(1.0, max(0.0, (NO_GAIN - excess) / (NO_GAIN - FULL)))


def learned(bias: Vector, last: Vector, rate: Vector, accel: Vector, dt: float) -> Vector:
    """The gyroscope's bias (rad/s), brought nearer to the rate if the sensor rests."""
    change, motion = minus(rate, last), minus(rate, bias)
    if not (
        abs(length(accel) - GRAVITY) <= STEADY_ACCEL
        and max(abs(change[0]), abs(change[1]), abs(change[2])) <= STEADY_CHANGE
        and max(abs(motion[0]), abs(motion[1]), abs(motion[2])) <= STEADY_RATE
    ):
        return bias
    k = min(1.0, BIAS_GAIN * dt)
    return (bias[0] + k * motion[0], bias[1] + k * motion[1], bias[2] + k * motion[2])


def levelling(up: Vector) -> Rotor:
    """The shortest turn that brings a unit vector to the vertical (eq. 18, without its 0/0)."""
    x, y, z = up
    if z >= 0.0:
        w = math.sqrt(0.5 + 0.5 * z)
        return (w, 0.5 * y / w, -0.5 * x / w, 0.0)
    across = math.sqrt(x * x + y * y)
    if not across > 0.0:
        return (0.0, 1.0, 0.0, 0.0)
    k = math.sqrt(0.5 - 0.5 * z)
    return (0.5 * across / k, k * y / across, -k * x / across, 0.0)


def northing(field: Vector) -> Rotor:
    """The turn about the vertical that brings a field to north, without the printed 0/0."""
    x, y, _ = field
    across = math.sqrt(x * x + y * y)
    if not across > 0.0:
        return IDENTITY
    x, y = x / across, y / across
    if x >= 0.0:
        w = math.sqrt(0.5 + 0.5 * x)
        return (w, 0.0, 0.0, -0.5 * y / w)
    z = math.copysign(math.sqrt(0.5 - 0.5 * x), -y)
    return (-0.5 * y / z, 0.0, 0.0, z)


def part_of(turn: Rotor, part: float) -> Rotor:
    """The part from 0 to 1 of a turn with w ≥ 0, by LERP or SLERP, normalised (eq. 5–7, 19)."""
    w, x, y, z = turn
    rest = 1.0 - part
    if w < NEAR:
        whole = math.acos(w)
        s = 1.0 / math.sin(whole)
        rest, part = s * math.sin(rest * whole), s * math.sin(part * whole)
    return unit((rest + part * w, part * x, part * y, part * z))


def length(v: Vector) -> float:
    """Euclidean length."""
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


def gains(settings: Settings) -> Gains:
    """The settings as the kernel takes them."""
    return Gains(sources(settings), float(settings.alpha), float(settings.alpha_rate))


AQUA = Kernel(step, State(), gains)


def step_as_printed(
    state: State, gains: Gains, gyro: Vector, accel: Vector, mag: Vector, dt: float
) -> State:
    """The report's listing; a ``dt`` of 0 starts anew at the identity."""
    felt = feel(state.senses, gyro, dt)
    bias = learned(state.bias, state.senses.rate, felt[1], accel, dt)
    rotor = IDENTITY
    if dt > 0.0:
        rotor = unit(product(state.rotor, from_rate(minus(felt[1], bias), dt)))
    if rotor[0] < 0.0:
        rotor = negative(rotor)
    return State(rotor, without_mag(state.senses, felt, accel), bias)


AS_PRINTED = Kernel(step_as_printed, State(), gains)
