"""One burst of the chip's registers, and the reading that it holds."""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

from ..rotor import Vector
from . import registers as reg
from .bus import BusError

STANDARD_GRAVITY = 9.80665  # m/s², the accelerometer's g
FULL_SCALE = 32768  # counts
LOWEST, HIGHEST = -FULL_SCALE, FULL_SCALE - 1
TEMPERATURE_SCALE = 333.87  # counts per °C
TEMPERATURE_ORIGIN = 21.0  # °C at zero counts
MAG_SCALE = 0.15e-6  # tesla per count at 16 bit, before the factory's adjustment

INERTIAL = struct.Struct(">B7h")  # INT_STATUS, accelerometer, temperature, gyroscope
MAGNETIC = struct.Struct("<B3hB")  # ST1, magnetometer, ST2
NOBODY = 0xFF  # what each byte reads as when no chip pulls the data line down
STUCK = "every byte reads as 0xFF: nobody drives the bus. Check the wires and the supply."
AXES = ("accel x", "accel y", "accel z", "gyro x", "gyro y", "gyro z")


class Reading(NamedTuple):
    """One sample in SI units, all in the frame of accelerometer and gyroscope (right-handed)."""

    gyro: Vector  # rad/s
    accel: Vector  # m/s², specific force: +g up at rest
    temperature: float  # °C, of the die
    mag: Vector | None  # tesla; None where there is no new and valid measurement
    mag_overflow: bool  # the field was too strong for the magnetometer: no ``mag`` for this reason
    saturated: tuple[str, ...]  # the axes at the end of their range, such as "gyro x"


class Burst:
    """What the bytes from INT_STATUS on mean at given ranges.

    ``gyro_range`` in °/s, ``accel_range`` in g; ``adjustment`` is the factory's sensitivity
    adjustment of the AK8963's three axes, None without a magnetometer.
    """

    def __init__(self, gyro_range: float, accel_range: float, adjustment: Vector | None) -> None:
        self._gyro_scale = math.radians(gyro_range) / FULL_SCALE
        self._accel_scale = accel_range * STANDARD_GRAVITY / FULL_SCALE
        self._mag_scale: Vector | None = None
        self.size = INERTIAL.size  # of a burst from INT_STATUS on
        if adjustment is not None:
            x, y, z = adjustment
            self._mag_scale = (MAG_SCALE * x, MAG_SCALE * y, MAG_SCALE * z)
            self.size += MAGNETIC.size

    def reading(self, data: bytes) -> Reading | None:
        """The reading in ``data`` (``size`` bytes), or None if it holds nothing new.

        `BusError` if it is what a bus reads that nobody drives.
        """
        status, ax, ay, az, temperature, gx, gy, gz = INERTIAL.unpack_from(data)
        if not status & reg.RAW_DATA_RDY:
            return None
        if status == NOBODY and data.count(NOBODY) == len(data):
            raise BusError(STUCK)
        mag, overflow = None, False
        if self._mag_scale is not None:
            st1, mx, my, mz, st2 = MAGNETIC.unpack_from(data, INERTIAL.size)
            if st1 & reg.AK_DRDY:
                overflow = bool(st2 & reg.AK_HOFL)
                if not overflow:
                    sx, sy, sz = self._mag_scale
                    mag = (sy * my, sx * mx, -sz * mz)  # of the AK8963 x and y swap, z is down
        counts = (ax, ay, az, gx, gy, gz)
        saturated: tuple[str, ...] = ()
        if max(counts) == HIGHEST or min(counts) == LOWEST:
            saturated = tuple(
                axis for axis, n in zip(AXES, counts, strict=True) if n in (LOWEST, HIGHEST)
            )
        a, g = self._accel_scale, self._gyro_scale
        return Reading(
            gyro=(g * gx, g * gy, g * gz),
            accel=(a * ax, a * ay, a * az),
            temperature=temperature / TEMPERATURE_SCALE + TEMPERATURE_ORIGIN,
            mag=mag,
            mag_overflow=overflow,
            saturated=saturated,
        )
