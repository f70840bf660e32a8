"""A sensor fresh from the factory, near iron, and what it shows of the earth's fields."""

from __future__ import annotations

import math

import numpy as np

from stateful_ahrs.filters.samples import Array
from stateful_ahrs.mpu9250.world import MILLI_G, Errors
from stateful_ahrs.rotor import Rotor, Vector, conjugate, from_axis_angle, product, rotate

GRAVITY = 9.80665  # m/s²
FIELD = 50e-6  # tesla
UP: Vector = (0.0, 0.0, GRAVITY)
NORTH: Vector = (0.5 * FIELD, 0.0, -math.sqrt(0.75) * FIELD)  # dip 60°

# Hard iron 200 µT, soft iron 10 %; the data sheet's offsets, its 3 % of scale, its noise
SOFT = ((1.1, 0.03, -0.02), (0.03, 0.93, 0.04), (-0.02, 0.04, 0.98))
HARD = (150e-6, -110e-6, 75e-6)
RAW = Errors(
    gyro_bias=(0.05, -0.08, 0.03),
    accel_offset=(60 * MILLI_G, -60 * MILLI_G, 80 * MILLI_G),
    accel_scale=((1.03, 0.01, -0.005), (0.01, 0.97, 0.008), (-0.005, 0.008, 1.02)),
    hard_iron=HARD,
    soft_iron=SOFT,
)


def attitudes() -> list[Rotor]:
    """Each 30° of yaw, pitch and roll."""
    steps = [math.radians(30.0 * n) for n in range(12)]
    return [
        product(
            from_axis_angle((0.0, 0.0, 1.0), yaw),
            product(
                from_axis_angle((0.0, 1.0, 0.0), pitch), from_axis_angle((1.0, 0.0, 0.0), roll)
            ),
        )
        for yaw in steps
        for pitch in steps[:4] + steps[9:]
        for roll in steps
    ]


def shown(q: Rotor, errors: Errors = RAW) -> tuple[Vector, Vector]:
    """What accelerometer and magnetometer show in an attitude, without noise."""
    up, north = rotate(conjugate(q), UP), rotate(conjugate(q), NORTH)
    accel = np.array(errors.accel_scale) @ up + errors.accel_offset
    mag = np.array(errors.soft_iron) @ north + errors.hard_iron
    return tuple(accel.tolist()), tuple(mag.tolist())


def heading_error(found: Rotor, truth: Rotor) -> float:
    """Degrees about the vertical between two attitudes, as BROAD counts it."""
    w, _, _, z = product(found, conjugate(truth))
    return abs((math.degrees(2.0 * math.atan2(z, w)) + 180.0) % 360.0 - 180.0)


def sphere(count: int, seed: int = 0, lowest: float = -1.0) -> Array:
    """Random directions (count, 3), evenly over the part of the sphere above z = ``lowest``."""
    random = np.random.default_rng(seed)
    z, angle = random.uniform(lowest, 1.0, count), random.uniform(0.0, 2.0 * np.pi, count)
    r = np.sqrt(1.0 - z * z)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), z])


def fields(directions: Array, seed: int = 0, noise: float = 0.6e-6) -> Array:
    """What the magnetometer shows of a field in these directions, tesla."""
    random = np.random.default_rng(seed)
    clean = FIELD * directions @ np.array(SOFT).T + HARD
    return clean + random.normal(0.0, noise, clean.shape)
