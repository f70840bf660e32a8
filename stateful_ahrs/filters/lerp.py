"""The complementary filter without correction of the EE615 report, by linear interpolation.

P. J. Rathour and T. S. Pagare, "Sensor Fusion Using Complementary Filter", EE615, 2023, eq. 8–11.
The report's α is the weight of the accelerometer; here it is that of the gyroscope (0.98 for its
0.02), as in every other filter.

Deviations from the report, none of them in `AS_PRINTED`
- Its ψ = 0 drags yaw to zero. Here ψ is the magnetometer's, or else the predicted one.
- It tracks no sign and normalises nothing. Here the snapshot continues the gyroscope path, and
  the blend is normalised (its eq. 6); that makes it the filter of `stateful` over another snapshot.
- It starts at the identity. Here it starts with the first snapshot.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..rotor import IDENTITY, Rotor, Vector, blend, dot, product, rotate, unit
from ..snapshot.directions import directions
from .gains import weight_of_gyro
from .kernel import Kernel
from .senses import Senses, feel, usable, without_mag
from .settings import Settings
from .stateful import over


def tilt(accel: Vector) -> Rotor:
    """Roll and pitch from specific force (eq. 9), as a rotor with ψ = 0 (eq. 10)."""
    ax, ay, az = accel
    roll = 0.5 * math.atan2(ay, az)
    pitch = 0.5 * math.atan2(-ax, math.sqrt(ay * ay + az * az))
    c, s, d, t = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    return (c * d, s * d, c * t, -s * t)


def roll_pitch_yaw(accel: Vector, mag: Vector) -> tuple[bool, Rotor]:
    """A snapshot as in `stateful_ahrs.snapshot`, by the three angles of eq. 9–10."""
    found, up, field, _, _ = directions(accel, mag)
    if not found:
        return False, (1.0, 0.0, 0.0, 0.0)
    level = tilt(up)
    hx, hy, _ = rotate(level, field)
    yaw = 0.5 * math.atan2(-hy, hx)
    return True, product((math.cos(yaw), 0.0, 0.0, math.sin(yaw)), level)


LERP = over(roll_pitch_yaw)


class Gains(NamedTuple):
    """The settings as the kernel takes them."""

    alpha: float
    alpha_rate: float


class State(NamedTuple):
    """All that the filter carries from sample to sample."""

    rotor: Rotor = IDENTITY
    senses: Senses = Senses()


def step_as_printed(
    state: State, gains: Gains, gyro: Vector, accel: Vector, mag: Vector, dt: float
) -> State:
    """Eq. 8–11 as printed; a ``dt`` of 0 starts anew at the identity."""
    felt = feel(state.senses, gyro, dt)
    last = IDENTITY if dt <= 0.0 else state.rotor
    _, x, y, z = felt[0]
    rotor = product(last, (1.0, x, y, z))
    if usable(accel):
        rotor = blend(rotor, tilt(accel), weight_of_gyro(gains.alpha, gains.alpha_rate, dt))
    square = dot(rotor, rotor)
    if not square > 1e-12:
        rotor = last
    elif square > 1e12:
        rotor = unit(rotor)
    return State(rotor, without_mag(state.senses, felt, accel))


def _gains(settings: Settings) -> Gains:
    return Gains(float(settings.alpha), float(settings.alpha_rate))


AS_PRINTED = Kernel(step_as_printed, State(), _gains)
