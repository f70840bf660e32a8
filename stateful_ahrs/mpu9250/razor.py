"""The text stream of SparkFun's 9DoF Razor IMU M0 with the firmware it is sold with.

A line holds, each only while it is switched on at the board: the time in ms; acceleration, rate
and field; a quaternion; pitch, roll and yaw; heading. Only the first two are used here. Values
have two decimals (g, °/s, µT), or none: then they are raw counts in the ranges of the board,
taken for the firmware's ±2 g and ±2000 °/s. The magnetometer comes in its own axes.
"""

from __future__ import annotations

import math
import re

from ..rotor import Vector
from .burst import AXES, FULL_SCALE, HIGHEST, LOWEST, STANDARD_GRAVITY, Reading
from .protocols import Clock, LineParser, Magnetometer, Record, Steps, plausible

SEPARATOR = b", "
VALUES = 9
FEWEST = 3  # fields: one sensor without the time
MEASURED = re.compile(rb"-?\d{1,4}\.\d\d")
COUNT = re.compile(rb"-?\d{1,5}")
TIME = re.compile(rb"\d{1,10}")
FURTHER = re.compile(rb"-?\d{1,10}(\.\d{1,4})?|nan|inf|-inf")  # a quaternion, angles: not used
MAG_COUNTS = 6.665e6  # a tesla, in the firmware
GYRO_COUNTS = 16.4  # a °/s at ±2000 °/s
ACCEL_FULL = 2.0  # g
GYRO_FULL = 1997.9  # °/s
Layout = tuple[int, bool, bool]  # of a line: fields, whether it has the time, whether raw counts


class RazorParser(LineParser):
    """Lines that go on from the one before: same layout, and a time that is a little later.

    A line that does not is believed when the next one goes on from it: the layout was switched,
    or the board restarted.
    """

    def __init__(self) -> None:
        super().__init__()
        self._clock = Clock(1_000_000, 1 << 32)
        self._steps = Steps()
        self._magnetometer = Magnetometer()
        self._accepted: tuple[Layout, int] | None = None
        self._suspect: tuple[Layout, int] | None = None

    def _record(self, line: bytes) -> Record | None:
        fields = line.split(SEPARATOR)
        layout = self._layout(fields)
        if layout is None:
            return None
        _, timed, raw = layout
        ticks = int(fields[0]) if timed else 0
        x, y, z, u, v, w, *mag = map(float, fields[timed : timed + VALUES])
        accel, gyro, field = self._units(raw, (x, y, z), (u, v, w), (mag[0], mag[1], mag[2]))
        if not plausible(gyro, accel, field):
            self.complaint = f"no MPU-9250 measures {line.decode()!r}."
            return None
        before, self._suspect = self._suspect, (layout, ticks)
        if not (_goes_on(self._accepted, layout, ticks) or _goes_on(before, layout, ticks)):
            return None
        self._accepted, self._suspect = self._suspect, None
        new, overflow = self._magnetometer.update((field[1], field[0], -field[2]))
        a = STANDARD_GRAVITY
        reading = Reading(
            gyro=gyro,
            accel=(a * accel[0], a * accel[1], a * accel[2]),
            temperature=math.nan,
            mag=new,
            mag_overflow=overflow,
            saturated=self._saturated(raw, (x, y, z, u, v, w)),
        )
        if not timed:
            return Record(reading, None, 0)
        now = self._clock.update(ticks)
        return Record(reading, now, self._steps.missed(self._clock.step))

    def _layout(self, fields: list[bytes]) -> Layout | None:
        """What the fields are; None if they are no sample."""
        if not all(map(FURTHER.fullmatch, fields)):
            return None
        for timed in (True, False):
            values, further = fields[timed : timed + VALUES], fields[timed + VALUES :]
            if len(values) == VALUES and (not timed or TIME.fullmatch(fields[0])):
                if all(map(MEASURED.fullmatch, values)):
                    return len(fields), timed, False
                # of raw counts only a quaternion can follow, so that the time is not taken for one
                if all(map(COUNT.fullmatch, values)) and sum(b"." not in n for n in further) in (
                    0,
                    4,
                ):
                    return len(fields), timed, True
        if len(fields) < FEWEST:  # digits between two line ends, as binary data have them
            return None
        self.complaint = (
            f"its lines have {len(fields)} fields. Switch on the accelerometer, the gyroscope and "
            "the magnetometer at the board: keys a, g, m in a terminal."
        )
        return None

    @staticmethod
    def _units(
        raw: bool, accel: Vector, gyro: Vector, mag: Vector
    ) -> tuple[Vector, Vector, Vector]:
        """Acceleration in g, rate in rad/s and field in tesla, in the board's axes."""
        a, g, m = 1.0, math.radians(1.0), 1e-6
        if raw:
            a, g, m = ACCEL_FULL / FULL_SCALE, math.radians(1.0) / GYRO_COUNTS, 1.0 / MAG_COUNTS
        return (
            (a * accel[0], a * accel[1], a * accel[2]),
            (g * gyro[0], g * gyro[1], g * gyro[2]),
            (m * mag[0], m * mag[1], m * mag[2]),
        )

    @staticmethod
    def _saturated(raw: bool, values: tuple[float, ...]) -> tuple[str, ...]:
        """The axes at the end of their range, as far as two decimals show it."""
        if raw:
            full = [value in (LOWEST, HIGHEST) for value in values]
        else:
            full = [abs(value) == ACCEL_FULL for value in values[:3]]
            full += [abs(value) >= GYRO_FULL for value in values[3:]]
        return tuple(axis for axis, at_end in zip(AXES, full, strict=True) if at_end)


def _goes_on(line: tuple[Layout, int] | None, layout: Layout, ticks: int) -> bool:
    """Whether a line of this layout and time (ms) can be the next after ``line``."""
    return (
        line is not None
        and line[0] == layout
        and (not layout[1] or 0 < (ticks - line[1]) % (1 << 32) <= 10_000)
    )
