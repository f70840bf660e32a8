"""What every serial protocol has in common: bytes in, records out, each discarded byte counted."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple, Protocol

from ..rotor import Vector
from . import registers as reg
from .burst import MAG_SCALE, Reading

LONGEST_LINE = 256  # bytes; the longest that any of the boards sends has 190
LONGEST_STEP = 10_000_000_000  # ns; a device clock that leaps further has started anew
MAG_LIMIT = 4912e-6  # tesla, of |x| + |y| + |z|: the AK8963 measures nothing beyond
GYRO_LIMIT = math.radians(2000.5)  # rad/s, the largest range and what rounding adds
ACCEL_LIMIT = 16.01  # g, likewise
GAP = 1.5  # times the usual step: a sample is missing
SHORT_GAP = 32  # numbers: one that ends at 0 is rather a loss than a device that started anew
USUAL = 15  # steps whose median is the usual one


class Record(NamedTuple):
    """One sample as it came over the line."""

    reading: Reading
    clock: int | None  # ns by the device's own clock, from any beginning; None: it sends none
    missed: int  # samples that the device sent or took before this one and that did not come


class Parser(Protocol):
    """Finds records in a stream of bytes, whatever else is in it; never raises."""

    discarded: int  # bytes thrown away so far
    complaint: str  # why the last were, as far as it helps a user; "" if there is nothing to say
    who_am_i: int  # the chip behind it, as far as the stream tells

    def feed(self, data: bytes) -> list[Record]:
        """The records that ``data`` completes; an incomplete one waits for the rest, bounded."""
        ...


class Counter:
    """Finds the gaps in a number that counts up by one and wraps."""

    def __init__(self, modulus: int) -> None:
        self._modulus = modulus
        self._last: int | None = None

    def missed(self, number: int) -> int:
        """How many numbers were left out before this one; 0 for the first.

        A step back is that of a device that started anew, and so is a long one to 0: no gap.
        """
        last, self._last = self._last, number
        if last is None:
            return 0
        missed = (number - last - 1) % self._modulus
        return missed if missed < (self._modulus // 2 if number else SHORT_GAP) else 0

    def restart(self) -> None:
        """Take the next number as the first."""
        self._last = None


class Clock:
    """Unwraps the clock of a device. ``step`` is what it did last, ns; 0 if it started anew."""

    def __init__(self, unit: int, modulus: int) -> None:
        self._unit = unit  # ns
        self._modulus = modulus
        self._last: int | None = None
        self.now = 0  # ns
        self.step = 0

    def update(self, ticks: int) -> int:
        """Return the time in ns; it goes on from the last, or from ``ticks`` after a restart."""
        if self._last is None:
            self.step = 0
        else:
            self.step = (ticks - self._last) % self._modulus * self._unit
        if self._last is None or self.step > LONGEST_STEP:
            self.step, self.now = 0, ticks * self._unit
        else:
            self.now += self.step
        self._last = ticks
        return self.now


class Steps:
    """Finds missing samples in a clock alone: a step of several times the usual one."""

    def __init__(self) -> None:
        self._steps: deque[int] = deque(maxlen=USUAL)

    def missed(self, step: int) -> int:
        """How many samples are missing in a step (ns); 0 until the usual step is known."""
        usual = sorted(self._steps)[len(self._steps) // 2] if len(self._steps) == USUAL else 0
        if step:
            self._steps.append(step)
        return round(step / usual) - 1 if usual and step > GAP * usual else 0


class LineParser:
    """The lines of a text protocol. What came before the first line end is never a whole line."""

    who_am_i = reg.MPU_9250

    def __init__(self) -> None:
        self.discarded = 0
        self.complaint = ""
        self._buffer = b""
        self._cut = True  # the line in the buffer lacks its beginning

    def feed(self, data: bytes) -> list[Record]:
        """The records of the lines that ``data`` ends."""
        records = []
        *lines, self._buffer = (self._buffer + data).split(b"\n")
        for line in lines:
            record = None if self._cut else self._record(line.removesuffix(b"\r"))
            self._cut = False
            if record is None:
                self.discarded += len(line) + 1
            else:
                records.append(record)
        if len(self._buffer) > LONGEST_LINE:
            self.discarded += len(self._buffer)
            self._buffer = b""
            self._cut = True
        return records

    def _record(self, line: bytes) -> Record | None:
        raise NotImplementedError


class Magnetometer:
    """Tells a new measurement from the last one sent again.

    Two in a row are never equal on all axes but by a chance of 1 in 2000: the noise is four
    counts. ``None`` is no new one, or none because the field was too strong.
    """

    def __init__(self) -> None:
        self._last: Vector | None = None

    def update(self, mag: Vector) -> tuple[Vector | None, bool]:
        """``mag`` in tesla as sent → (the new measurement, whether it overflowed)."""
        if mag == self._last:
            return None, False
        self._last = mag
        if abs(mag[0]) + abs(mag[1]) + abs(mag[2]) >= MAG_LIMIT:
            return None, True
        return mag, False


def plausible(gyro: Vector, accel: Vector, mag: Vector) -> bool:
    """Whether an MPU-9250 can have measured these, in rad/s, g and tesla."""
    return (
        max(map(abs, gyro)) <= GYRO_LIMIT
        and max(map(abs, accel)) <= ACCEL_LIMIT
        and max(map(abs, mag)) <= 32768 * 1.5 * MAG_SCALE  # at the largest factory adjustment
    )
