"""Streams of bytes from the boards, and what must be found in them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import lru_cache

from boards import BOARDS, FUSES, Board, bursts

from stateful_ahrs.mpu9250.burst import Burst, Reading
from stateful_ahrs.mpu9250.chip import Settings
from stateful_ahrs.mpu9250.motion import motion
from stateful_ahrs.mpu9250.protocols import Parser, Record
from stateful_ahrs.mpu9250.simulator import SimulatedMpu9250, VirtualClock

COUNT = 24


@lru_cache
def sampled(settings: Settings, count: int = COUNT) -> tuple[bytes, ...]:
    """Bursts of a chip in motion, its magnetometer read with each."""
    clock = VirtualClock(500_000_000)
    bus = SimulatedMpu9250(motion("tumble"), clock=clock, fuses=FUSES, seed=3)
    clock.sleep(2.0)  # into the motion
    return tuple(bursts(bus, settings, count, clock.sleep))


def stream(board: Board, first: int = 0, count: int = COUNT) -> list[bytes]:
    """What the board sends for each burst, from the number ``first`` on, 10 ms apart."""
    return [
        board.sample(burst, first + n, 2_000_000 + 10_000 * (first + n))
        for n, burst in enumerate(sampled(board.settings)[:count])
    ]


def meant(settings: Settings) -> list[Reading]:
    """The readings of the same bursts, read as from a bus."""
    x, y, z = ((fuse - 128) * 0.5 / 128 + 1 for fuse in FUSES)
    burst = Burst(settings.gyro_range, settings.accel_range, (x, y, z))
    readings = [burst.reading(data) for data in sampled(settings)]
    assert None not in readings
    return readings  # type: ignore[return-value]


def fed(parser: Parser, data: bytes, pieces: Iterable[int] = ()) -> list[Record]:
    """The records of ``data``, fed in pieces of these sizes and then the rest."""
    found = []
    for size in pieces:
        found += parser.feed(data[:size])
        data = data[size:]
    return found + parser.feed(data)


def bytewise(parser: Parser, data: bytes) -> list[Record]:
    """The records of ``data``, fed byte by byte."""
    return fed(parser, data, [1] * len(data))


def differ(found: Reading, expected: Reading) -> float:
    """The largest difference, in counts of the chip at ±2000 °/s, ±2 g and 0.15 µT."""
    pairs = [
        (found.gyro, expected.gyro, math.radians(1.0 / 16.4)),
        (found.accel, expected.accel, 9.80665 / 16384.0),
    ]
    if found.mag is not None and expected.mag is not None:
        pairs.append((found.mag, expected.mag, 0.15e-6))
    return max(abs(a - b) / unit for p, q, unit in pairs for a, b in zip(p, q, strict=True))


__all__ = ["BOARDS", "COUNT", "bytewise", "differ", "fed", "meant", "sampled", "stream"]
