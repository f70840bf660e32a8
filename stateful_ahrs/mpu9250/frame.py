"""Our own frame: one burst of the chip over a serial line, as docs/frame.md defines it.

The bridge copies the chip's 23 bytes as they are; what they mean is decided here, by the same
code that reads the chip on a bus.
"""

from __future__ import annotations

import binascii
import struct
from functools import lru_cache

from ..errors import DeviceError
from ..rotor import Vector
from . import registers as reg
from .burst import NOBODY, STUCK, Burst
from .chip import ACCEL_RANGES, GYRO_RANGES, NAMES, OTHERS, SIX_AXES
from .protocols import Clock, Counter, Record

VERSION = 1
# version, WHO_AM_I, ranges, factory adjustment, sequence, µs, burst from INT_STATUS to ST2
BODY = struct.Struct("<BBB3sHI23s")
CRC = struct.Struct("<H")
SIZE = BODY.size + CRC.size  # of a frame before it is stuffed: 37
STUFFED = SIZE + 1  # on the line, without the zero that ends it
RANGE_MASK = 0x03
ACCEL_SHIFT = 2
NO_ADJUSTMENT = (b"\xff\xff\xff", b"\0\0\0")  # of a magnetometer that the bridge could not read


def pack(
    who_am_i: int,
    gyro_range: int,
    accel_range: int,
    adjustment: bytes,
    sequence: int,
    micros: int,
    burst: bytes,
) -> bytes:
    """A frame as it goes over the line, its zero included.

    ``adjustment``: the AK8963's three fuse bytes; ``burst``: 23 bytes, or 15 of a chip without
    magnetometer. ``sequence`` and ``micros`` wrap.
    """
    ranges = GYRO_RANGES.index(gyro_range) | ACCEL_RANGES.index(accel_range) << ACCEL_SHIFT
    body = BODY.pack(
        VERSION, who_am_i, ranges, adjustment, sequence & 0xFFFF, micros & 0xFFFFFFFF, burst
    )
    return stuff(body + CRC.pack(crc(body))) + b"\0"


def crc(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, initial value 0xFFFF."""
    return binascii.crc_hqx(data, 0xFFFF)


def stuff(data: bytes) -> bytes:
    """COBS (Cheshire and Baker 1999) of less than 254 bytes: the same content without a zero."""
    return b"".join(bytes((len(group) + 1,)) + group for group in data.split(b"\0"))


def unstuff(data: bytes) -> bytes | None:
    """The content of what `stuff` made; None if it did not make this."""
    groups = []
    position, end = 0, len(data)
    while position < end:
        code = data[position]
        group = data[position + 1 : position + code]
        if code == 0 or len(group) != code - 1:
            return None
        groups.append(group)
        position += code
    return b"\0".join(groups)


class FrameParser:
    """Frames in a stream of bytes; see `Parser`."""

    def __init__(self) -> None:
        self.discarded = 0
        self.complaint = ""
        self.who_am_i = reg.MPU_9250
        self._buffer = b""
        self._counter = Counter(1 << 16)
        self._clock = Clock(1000, 1 << 32)

    def feed(self, data: bytes) -> list[Record]:
        """The records of the frames that ``data`` ends."""
        records = []
        *chunks, self._buffer = (self._buffer + data).split(b"\0")
        for chunk in chunks:
            record = self._record(chunk)
            if record is None:
                self.discarded += len(chunk) + 1
            else:
                records.append(record)
        if len(self._buffer) > STUFFED:
            self.discarded += len(self._buffer)
            self._buffer = b""
        return records

    def _record(self, chunk: bytes) -> Record | None:
        frame = unstuff(chunk) if len(chunk) <= STUFFED else None
        if not frame or len(frame) < 1 + CRC.size or crc(frame[:-2]) != CRC.unpack(frame[-2:])[0]:
            return None
        if frame[0] != VERSION or len(frame) != SIZE:
            self.complaint = (
                f"its frames have version {frame[0]} and {len(frame)} bytes, expected {VERSION} "
                f"and {SIZE}: load the sketch that belongs to this driver."
            )
            return None
        _, who_am_i, ranges, adjustment, sequence, micros, data = BODY.unpack_from(frame)
        if who_am_i == NOBODY:
            self.complaint = f"of the chip behind it {STUCK}"
            return None
        if who_am_i not in NAMES:
            self.complaint = (
                f"the chip behind it answers 0x{who_am_i:02X} "
                f"({OTHERS.get(who_am_i, 'unknown')}) to WHO_AM_I."
            )
            return None
        try:
            burst = meaning(who_am_i, ranges, adjustment)
            reading = burst.reading(data[: burst.size])
        except DeviceError as error:
            self.complaint = f"of the chip behind it {error}"
            return None
        if reading is None:
            self.complaint = "the chip behind it has no new samples."
            return None
        self.who_am_i = who_am_i
        now = self._clock.update(micros)
        if self._clock.step == 0:
            self._counter.restart()
        return Record(reading, now, self._counter.missed(sequence))


@lru_cache(maxsize=16)
def meaning(who_am_i: int, ranges: int, adjustment: bytes) -> Burst:
    """What the burst of a frame means."""
    factors: Vector | None = None
    if who_am_i not in SIX_AXES and adjustment not in NO_ADJUSTMENT:
        x, y, z = ((fuse - 128) * 0.5 / 128 + 1 for fuse in adjustment)
        factors = (x, y, z)
    return Burst(
        GYRO_RANGES[ranges & RANGE_MASK],
        ACCEL_RANGES[ranges >> ACCEL_SHIFT & RANGE_MASK],
        factors,
    )
