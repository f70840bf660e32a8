"""What a sensor measures wrongly, and how its readings are corrected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime, timezone

from ..errors import AhrsError
from ..filters.settings import NOTHING, Known
from ..rotor import Vector
from .burst import Reading

Matrix = tuple[Vector, Vector, Vector]

ZERO: Vector = (0.0, 0.0, 0.0)
UNIT: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def now() -> str:
    """The date of a correction made now."""
    return datetime.now(timezone.utc).isoformat(timespec="seconds")


class CalibrationError(AhrsError):
    """A calibration cannot be read or written, or the data do not support one."""


@dataclass(frozen=True)
class Correction:
    """``matrix (raw − offset)`` for one sensor, and where it comes from; by default no change.

    ``offset`` is in the sensor's unit: rad/s, m/s² or tesla.
    """

    offset: Vector = ZERO
    matrix: Matrix = UNIT
    date: str = ""  # ISO 8601
    temperature: float | None = None  # °C of the die
    quality: Mapping[str, float] = field(default_factory=dict)

    @property
    def changes(self) -> bool:
        """Whether it changes anything."""
        return self.offset != ZERO or self.matrix != UNIT

    def apply(self, raw: Vector) -> Vector:
        """The corrected vector."""
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = self.matrix
        x, y, z = raw[0] - self.offset[0], raw[1] - self.offset[1], raw[2] - self.offset[2]
        return (
            xx * x + xy * y + xz * z,
            yx * x + yy * y + yz * z,
            zx * x + zy * y + zz * z,
        )


@dataclass(frozen=True)
class Calibration:
    """The corrections of one device's sensors; by default none.

    The gyroscope's matrix is the identity: at rest its scale cannot be seen. ``learned`` is what
    is left over after the corrections, as a filter found it: a filter's to apply, not the driver's.
    """

    sensor: str = ""  # whose calibration it is
    gyro: Correction = Correction()
    accel: Correction = Correction()
    mag: Correction = Correction()
    learned: Known = NOTHING
    learned_date: str = ""  # ISO 8601

    def apply(self, reading: Reading) -> Reading:
        """The reading, corrected; what is not measured or has no correction stays as it is."""
        gyro, accel, mag = reading.gyro, reading.accel, reading.mag
        if self.gyro.changes:
            x, y, z = self.gyro.offset
            gyro = (gyro[0] - x, gyro[1] - y, gyro[2] - z)
        if self.accel.changes:
            accel = self.accel.apply(accel)
        if mag is not None and self.mag.changes:
            mag = self.mag.apply(mag)
        return reading._replace(gyro=gyro, accel=accel, mag=mag)
