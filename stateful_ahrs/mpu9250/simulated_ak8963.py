"""The AK8963 magnetometer, register by register."""

from __future__ import annotations

import struct
from collections.abc import Callable

from ..rotor import Vector
from . import registers as reg

PERIODS = {reg.AK_CONTINUOUS_8_HZ: 125_000_000, reg.AK_CONTINUOUS_100_HZ: 10_000_000}  # ns
SWITCH_TIME = 100_000  # ns in power-down before another mode is taken
FINE, COARSE = (0.15e-6, 32760), (0.6e-6, 8190)  # tesla per count and full scale: 16 and 14 bit
OVERFLOW = 4912e-6  # tesla, of |x| + |y| + |z|
SIZE = 0x13
AXES = struct.Struct("<3h")


class SimulatedAk8963:
    """Power-down, the two continuous modes and the fuse ROM; times in ns.

    ``field`` tells the field in tesla at a time, in the frame of the accelerometer; ``fuses`` are
    the factory's sensitivity adjustments. A mode that is not entered from power-down, or too soon,
    is ignored: the data sheet forbids it and promises nothing.
    """

    def __init__(self, field: Callable[[int], Vector], fuses: tuple[int, int, int]) -> None:
        self._field = field
        self._fuses = bytes(fuses)
        self._gains = [(fuse - 128) * 0.5 / 128 + 1 for fuse in fuses]
        self._changed = -SWITCH_TIME  # when the mode changed last
        self._reset()

    def write(self, register: int, value: int, now: int) -> None:
        """Write one register."""
        if register == reg.AK_CNTL2 and value & reg.AK_SOFT_RESET:
            self._reset()
            self._changed = now
        elif register == reg.AK_CNTL1:
            self._set_mode(value, now)

    def read(self, register: int, count: int, now: int) -> bytes:
        """Read registers; what has been measured by now is in them."""
        self._measure(now)
        end = register + count
        data = bytes(self._registers[register:end]).ljust(count, b"\0")
        if register <= reg.AK_ST2 and end > reg.AK_HXL:
            self._registers[reg.AK_ST1] = 0
            self._held = end <= reg.AK_ST2  # until ST2 is read, nothing new comes in
        return data

    def _reset(self) -> None:
        self._registers = bytearray(SIZE)
        self._registers[reg.AK_WIA] = reg.AK_DEVICE_ID
        self._held = False
        self._measured = 0  # measurements since the mode changed

    def _set_mode(self, value: int, now: int) -> None:
        registers = self._registers
        before, mode = registers[reg.AK_CNTL1] & reg.AK_MODE_MASK, value & reg.AK_MODE_MASK
        if mode == before:
            return
        if mode != reg.AK_POWER_DOWN and (
            before != reg.AK_POWER_DOWN or now - self._changed < SWITCH_TIME
        ):
            return
        self._changed = now
        self._measured = 0
        registers[reg.AK_CNTL1] = value
        fuses = self._fuses if mode == reg.AK_FUSE_ROM else bytes(3)
        registers[reg.AK_ASAX : reg.AK_ASAX + 3] = fuses

    def _measure(self, now: int) -> None:
        control = self._registers[reg.AK_CNTL1]
        period = PERIODS.get(control & reg.AK_MODE_MASK)
        if period is None or self._held:
            return
        n = (now - self._changed) // period
        if n <= self._measured:
            return
        skipped = n > self._measured + 1 or self._registers[reg.AK_ST1] & reg.AK_DRDY
        self._measured = n
        x, y, z = self._field(self._changed + n * period)
        scale, limit = FINE if control & reg.AK_16_BIT else COARSE
        counts = [
            min(max(round(value / (scale * gain)), -limit), limit)
            for value, gain in zip((y, x, -z), self._gains, strict=True)  # its own axes
        ]
        AXES.pack_into(self._registers, reg.AK_HXL, *counts)
        self._registers[reg.AK_ST1] = reg.AK_DRDY | (reg.AK_DOR if skipped else 0)
        overflow = reg.AK_HOFL if abs(x) + abs(y) + abs(z) >= OVERFLOW else 0
        self._registers[reg.AK_ST2] = overflow | (control & reg.AK_16_BIT)
