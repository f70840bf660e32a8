"""What the simulated chip's sensors feel: the motion, the earth's fields, and their own errors."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

from ..rotor import Vector, conjugate, rotate
from .motion import Motion

Matrix = tuple[Vector, Vector, Vector]

MILLI_G = 9.80665e-3  # m/s²
GYRO_NOISE_BANDWIDTH = 92.0  # Hz, at which the data sheet states the noise
ACCEL_NOISE_BANDWIDTH = 94.0  # Hz


@dataclass(frozen=True)
class Earth:
    """The fields of the place."""

    gravity: float = 9.81  # m/s²
    magnetic: float = 50e-6  # tesla
    dip: float = math.radians(60.0)  # rad below the horizon


@dataclass(frozen=True)
class Errors:
    """How the sensors differ from ideal ones, in the sensor frame.

    Noise as in the data sheet. The offsets are those of a chip after calibration; one fresh from
    the factory may have 5 °/s, 60 mg and 300 µT.
    """

    gyro_noise: float = math.radians(0.1)  # rad/s rms at 92 Hz
    gyro_bias: Vector = (8e-4, -1.2e-3, 1e-3)  # rad/s: 0.05 to 0.07 °/s
    accel_noise: float = 8.0 * MILLI_G  # m/s² rms at 94 Hz
    accel_offset: Vector = (2.0 * MILLI_G, -2.0 * MILLI_G, 4.0 * MILLI_G)  # m/s²
    accel_scale: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))  # and misalignment
    mag_noise: float = 0.6e-6  # tesla rms
    hard_iron: Vector = (0.15e-6, -0.1e-6, 0.2e-6)  # tesla
    soft_iron: Matrix = ((1.003, 0.001, 0.0), (0.001, 0.998, -0.001), (0.0, -0.001, 1.0))
    temperature: float = 25.0  # °C


IDEAL = Errors(
    gyro_noise=0.0,
    gyro_bias=(0.0, 0.0, 0.0),
    accel_noise=0.0,
    accel_offset=(0.0, 0.0, 0.0),
    mag_noise=0.0,
    hard_iron=(0.0, 0.0, 0.0),
    soft_iron=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
)


class World:
    """The quantities at a time ``t`` (s) of the motion; the same calls give the same noise."""

    def __init__(self, motion: Motion, earth: Earth, errors: Errors, seed: int) -> None:
        self.motion = motion
        self.errors = errors
        self._gauss = random.Random(seed).gauss
        self._up: Vector = (0.0, 0.0, earth.gravity)
        self._north: Vector = (
            earth.magnetic * math.cos(earth.dip),
            0.0,
            -earth.magnetic * math.sin(earth.dip),
        )

    def gyro(self, t: float, bandwidth: float) -> Vector:
        """Angular rate, rad/s, through a low-pass of ``bandwidth`` Hz."""
        sigma = self.errors.gyro_noise * math.sqrt(bandwidth / GYRO_NOISE_BANDWIDTH)
        return self._off(self.motion.rate(t), self.errors.gyro_bias, sigma)

    def accel(self, t: float, bandwidth: float) -> Vector:
        """Specific force, m/s², through a low-pass of ``bandwidth`` Hz."""
        force = rotate(conjugate(self.motion.rotor(t)), self._up)
        sigma = self.errors.accel_noise * math.sqrt(bandwidth / ACCEL_NOISE_BANDWIDTH)
        return self._off(_bent(self.errors.accel_scale, force), self.errors.accel_offset, sigma)

    def mag(self, t: float) -> Vector:
        """Magnetic field, tesla, bent by soft iron and shifted by hard iron."""
        field = rotate(conjugate(self.motion.rotor(t)), self._north)
        return self._off(
            _bent(self.errors.soft_iron, field), self.errors.hard_iron, self.errors.mag_noise
        )

    def _off(self, value: Vector, offset: Vector, sigma: float) -> Vector:
        gauss = self._gauss
        return (
            value[0] + offset[0] + gauss(0.0, sigma),
            value[1] + offset[1] + gauss(0.0, sigma),
            value[2] + offset[2] + gauss(0.0, sigma),
        )


def _bent(matrix: Matrix, v: Vector) -> Vector:
    x, y, z = v
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = matrix
    return (xx * x + xy * y + xz * z, yx * x + yy * y + yz * z, zx * x + zy * y + zz * z)
