"""Boards that carry the simulated chip: what each sends of one burst of its registers.

Written after the boards' public firmware and manuals, independently of the parsers.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass

from stateful_ahrs.mpu9250 import frame
from stateful_ahrs.mpu9250 import registers as reg
from stateful_ahrs.mpu9250.bus import Bus
from stateful_ahrs.mpu9250.chip import Mpu9250, Settings

FUSES = (176, 178, 167)
BURST = struct.Struct(">B7h")
FIELD = struct.Struct("<B3hB")


def counts(burst: bytes) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Accelerometer, temperature and gyroscope; magnetometer, adjusted as the firmware does it."""
    inertial = BURST.unpack_from(burst)[1:]
    mag = FIELD.unpack_from(burst, BURST.size)[1:4]
    return inertial, tuple(n * (fuse + 128) // 256 for n, fuse in zip(mag, FUSES, strict=True))


@dataclass
class Razor:
    """SparkFun's 9DoF Razor IMU M0: what its keys switch."""

    settings = Settings(100.0, gyro_range=2000, accel_range=2, dlpf=6)
    baudrate = 115200
    time: bool = True
    accel: bool = True
    gyro: bool = True
    compass: bool = True
    calculated: bool = True
    quaternion: bool = False
    euler: bool = False
    heading: bool = False

    def sample(self, burst: bytes, sequence: int, micros: int) -> bytes:
        """One line."""
        (ax, ay, az, _, gx, gy, gz), (mx, my, mz) = counts(burst)
        fields = [str(micros // 1000 % (1 << 32))] * self.time
        for on, values, scale in (
            (self.accel, (ax, ay, az), 16384.0),
            (self.gyro, (gx, gy, gz), 16.4),
            (self.compass, (mx, my, mz), 6.665),
        ):
            if on and self.calculated:
                fields += [f"{value / scale:.2f}" for value in values]
            elif on:
                fields += [str(value) for value in values]
        if self.quaternion:
            q = (0.5, -0.5, 0.5, -0.5)
            fields += [f"{n:.4f}" if self.calculated else str(round(n * 2**30)) for n in q]
        if self.euler:
            fields += ["-1.25", "0.07", "359.99"]
        if self.heading:
            fields += [f"{math.degrees(math.atan2(my, mx)):.2f}"]
        return (", ".join(fields) + "\r\n").encode()


@dataclass
class RtUsbText:
    """RT's USB module, text format."""

    settings = Settings(100.0, gyro_range=2000, accel_range=16, dlpf=3)
    baudrate = 57600

    def sample(self, burst: bytes, sequence: int, micros: int) -> bytes:
        """One line."""
        (ax, ay, az, t, gx, gy, gz), (mx, my, mz) = counts(burst)
        values = [math.radians(n / 16.4) for n in (gx, gy, gz)]
        values += [n / 2048.0 for n in (ax, ay, az)]
        values += [n * 0.15 for n in (my, mx, -mz)]  # the module turns them itself
        values += [t / 333.87 + 21.0]
        return ",".join([str(sequence % 256), *(f"{n:.6f}" for n in values)]).encode() + b"\n"


@dataclass
class RtUsbBinary:
    """RT's USB module, binary format."""

    settings = RtUsbText.settings
    baudrate = 57600
    firmware: int = 6

    def sample(self, burst: bytes, sequence: int, micros: int) -> bytes:
        """28 bytes."""
        (ax, ay, az, t, gx, gy, gz), (mx, my, mz) = counts(burst)
        head = b"\xff\xffRT\x39\x41" + bytes((self.firmware, sequence % 256))
        return head + struct.pack("<10h", ax, ay, az, t, gx, gy, gz, my, mx, -mz)


@dataclass
class Bridge:
    """Our own sketch on a microcontroller."""

    settings = Settings(1000.0, gyro_range=1000, accel_range=4, dlpf=2)
    baudrate = 921600
    who_am_i: int = 0x71

    def sample(self, burst: bytes, sequence: int, micros: int) -> bytes:
        """One frame."""
        s = self.settings
        adjustment = bytes(FUSES)
        return frame.pack(
            self.who_am_i, s.gyro_range, s.accel_range, adjustment, sequence, micros, burst
        )


Board = Razor | RtUsbText | RtUsbBinary | Bridge
BOARDS: dict[str, Callable[[], Board]] = {
    "razor": Razor,
    "rt_usb text": RtUsbText,
    "rt_usb binary": RtUsbBinary,
    "frame": Bridge,
}


def bursts(bus: Bus, settings: Settings, count: int, sleep: Callable[[float], None]) -> list[bytes]:
    """That many samples of a chip, each the 23 bytes of one burst."""
    Mpu9250(bus, settings, sleep=sleep)
    found: list[bytes] = []
    while len(found) < count:
        sleep(1e-4)
        data = bus.read(reg.ADDRESS, reg.INT_STATUS, 23)
        if data[0] & reg.RAW_DATA_RDY:
            found.append(data)
    return found
