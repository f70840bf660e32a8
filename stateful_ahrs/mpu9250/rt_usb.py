"""The text and the binary stream of RT Corporation's USB 9-axis module with an MPU-9250.

The module turns the magnetometer's axes into those of the other two itself, and numbers its
samples from 0 to 255. Two formats, of which the module sends the one it is set to.
"""

from __future__ import annotations

import math
import re
import struct

from ..rotor import Vector
from . import registers as reg
from .burst import AXES, HIGHEST, LOWEST, MAG_SCALE, STANDARD_GRAVITY, Reading
from .protocols import Counter, LineParser, Magnetometer, Record, plausible

NUMBERS = 256

# --- text: number, gyroscope (rad/s), accelerometer (g), magnetometer (µT), temperature (°C) -----

NUMBER = re.compile(rb"\d{1,3}")
VALUE = re.compile(rb"-?\d{1,4}\.\d{1,8}")
FIELDS = 11

# --- binary: header, firmware, number, accelerometer, temperature, gyroscope, magnetometer -------

HEADER = b"\xff\xffRT\x39\x41"
OTHER_HEADER = b"\xff\xffRT"
UNDECIDED = 2  # bytes of a header that are no reason to wait
FRAME = struct.Struct("<6sBB3hh3h3h")
GYRO_SCALE = math.radians(1.0) / 16.4  # rad/s a count, ±2000 °/s
ACCEL_SCALE = 1.0 / 2048.0  # g a count, ±16 g
NEW_FIRMWARE = 6  # from here on the module has an MPU-9250, before it an MPU-9150
TEMPERATURES = {True: (333.87, 21.0), False: (340.0, 35.0)}  # counts per °C, °C at zero


class RtUsbTextParser(LineParser):
    """Lines of eleven fields; see `Parser`."""

    def __init__(self) -> None:
        super().__init__()
        self._counter = Counter(NUMBERS)
        self._magnetometer = Magnetometer()

    def _record(self, line: bytes) -> Record | None:
        number, *fields = line.split(b",")
        if (
            len(fields) != FIELDS - 1
            or not NUMBER.fullmatch(number)
            or not all(map(VALUE.fullmatch, fields))
        ):
            return None
        u, v, w, x, y, z, p, q, r, temperature = map(float, fields)
        mag = (p * 1e-6, q * 1e-6, r * 1e-6)
        if int(number) >= NUMBERS or not plausible((u, v, w), (x, y, z), mag):
            self.complaint = f"no MPU-9250 measures {line.decode()!r}."
            return None
        reading = _reading((u, v, w), (x, y, z), self._magnetometer.update(mag), temperature, ())
        return Record(reading, None, self._counter.missed(int(number)))


class RtUsbBinaryParser:
    """Frames of 28 bytes, which have a header and no checksum; see `Parser`.

    A frame counts if the next header begins where it ends, or nothing has come after it. One that
    ends as a header begins may have been cut and waits for the bytes that decide; but not for the
    sake of one or two, with which all frames end where the field points weakly downwards.
    """

    who_am_i = reg.MPU_9250

    def __init__(self) -> None:
        self.discarded = 0
        self.complaint = ""
        self._buffer = b""
        self._counter = Counter(NUMBERS)
        self._magnetometer = Magnetometer()

    def feed(self, data: bytes) -> list[Record]:
        """The records of the frames that ``data`` completes."""
        records = []
        self._buffer += data
        while len(self._buffer) >= FRAME.size:
            begin = _find(self._buffer, 0)
            if begin:
                self._complain(begin)
                self._discard(begin)
                continue
            end = _find(self._buffer, 1)
            short = end < FRAME.size  # by a header, or by what may become one
            if end > FRAME.size or (short and end + len(HEADER) <= len(self._buffer)):
                self._discard(end)
                continue
            alone = len(self._buffer) == FRAME.size
            if short and not (alone and end >= FRAME.size - UNDECIDED):
                break
            record = self._record(FRAME.unpack_from(self._buffer))
            if record is None:
                self._discard(FRAME.size)
                continue
            self._buffer = self._buffer[FRAME.size :]
            records.append(record)
        return records

    def _record(self, frame: tuple[int, ...]) -> Record | None:
        _, firmware, number, x, y, z, t, u, v, w, p, q, r = frame
        new = firmware >= NEW_FIRMWARE
        a, g, m = ACCEL_SCALE, GYRO_SCALE, MAG_SCALE if new else 2.0 * MAG_SCALE
        gyro, accel, mag = (g * u, g * v, g * w), (a * x, a * y, a * z), (m * p, m * q, m * r)
        if not plausible(gyro, accel, mag):
            return None
        counts_per_degree, origin = TEMPERATURES[new]
        full = [value in (LOWEST, HIGHEST) for value in (x, y, z, u, v, w)]
        saturated = tuple(axis for axis, at_end in zip(AXES, full, strict=True) if at_end)
        temperature = t / counts_per_degree + origin
        reading = _reading(gyro, accel, self._magnetometer.update(mag), temperature, saturated)
        return Record(reading, None, self._counter.missed(number))

    def _complain(self, count: int) -> None:
        if OTHER_HEADER in self._buffer[:count] and HEADER not in self._buffer:
            self.complaint = "its frames are those of a module without an MPU-9250."

    def _discard(self, count: int) -> None:
        self.discarded += count
        self._buffer = self._buffer[count:]


def _find(buffer: bytes, start: int) -> int:
    """Where in ``buffer`` a header begins, be it only its first bytes; its length if nowhere."""
    found = buffer.find(HEADER, start)
    if found >= 0:
        return found
    for begin in range(max(start, len(buffer) - len(HEADER) + 1), len(buffer)):
        if HEADER.startswith(buffer[begin:]):
            return begin
    return len(buffer)


def _reading(
    gyro: Vector,
    accel: Vector,
    mag: tuple[Vector | None, bool],
    temperature: float,
    saturated: tuple[str, ...],
) -> Reading:
    a = STANDARD_GRAVITY
    return Reading(
        gyro=gyro,
        accel=(a * accel[0], a * accel[1], a * accel[2]),
        temperature=temperature,
        mag=mag[0],
        mag_overflow=mag[1],
        saturated=saturated,
    )
