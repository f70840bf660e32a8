"""An MPU-9250 that answers register by register, and knows the truth."""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable
from typing import NamedTuple

from ..rotor import Rotor, Vector
from . import registers as reg
from .burst import (
    AXES,
    FULL_SCALE,
    HIGHEST,
    LOWEST,
    STANDARD_GRAVITY,
    TEMPERATURE_ORIGIN,
    TEMPERATURE_SCALE,
)
from .bus import BusError
from .motion import Motion
from .simulated_ak8963 import SimulatedAk8963
from .world import Earth, Errors, World

RESET_TIME = 100_000_000  # ns without an answer
START_UP_TIME = 35_000_000  # ns from waking to the first sample
FAST_PERIOD = 125_000  # ns: 8 kHz, where the low-pass is wide open and the divider has no effect
TRIMS = (101, 99, 103, 112, 108, 105)  # accelerometer, gyroscope: 0.43 g and 57 °/s or so
PERIOD = 1_000_000  # ns, times 1 + SMPLRT_DIV
WITH_MAGNETOMETER = (0x71, 0x73)  # WHO_AM_I of MPU-9250 and MPU-9255

# Bandwidth (Hz) and delay (s) by DLPF setting, from the register map
GYRO_FILTER = (
    (250.0, 0.97e-3),
    (184.0, 2.9e-3),
    (92.0, 3.9e-3),
    (41.0, 5.9e-3),
    (20.0, 9.9e-3),
    (10.0, 17.85e-3),
    (5.0, 33.48e-3),
    (3600.0, 0.17e-3),
)
ACCEL_FILTER = (
    (218.1, 1.88e-3),
    (218.1, 1.88e-3),
    (99.0, 2.88e-3),
    (44.8, 4.88e-3),
    (21.2, 8.87e-3),
    (10.2, 16.83e-3),
    (5.05, 32.48e-3),
    (420.0, 1.38e-3),
)

BITS = (0x80, 0x40, 0x20)  # of the self-test: x, y, z
MEASUREMENT = struct.Struct(">7h")
FIFO_DEPTH = 600  # samples that are more than the FIFO holds, whatever they consist of
FIFO_PARTS = (  # bits of FIFO_EN, first register, count; in the order of the registers
    (0x08, reg.ACCEL_XOUT_H, 6),
    (0x80, reg.ACCEL_XOUT_H + 6, 2),
    (0x40, reg.ACCEL_XOUT_H + 8, 2),
    (0x20, reg.ACCEL_XOUT_H + 10, 2),
    (0x10, reg.ACCEL_XOUT_H + 12, 2),
)
READ_ONLY = {reg.I2C_MST_STATUS, reg.WHO_AM_I, *range(reg.INT_STATUS, reg.I2C_SLV0_DO)}


class VirtualClock:
    """A clock that moves only while somebody sleeps: seconds of motion in no time."""

    def __init__(self, now: int = 0) -> None:
        self.now = now  # ns

    def __call__(self) -> int:
        """The time in ns."""
        return self.now

    def sleep(self, seconds: float) -> None:
        """Return at once, that much later."""
        self.now += round(seconds * 1e9)


def _nobody(address: int) -> BusError:
    return BusError(f"no device answers at I2C address 0x{address:02X}.")


class Truth(NamedTuple):
    """What a sample was a sample of."""

    stamp: int  # ns, by the simulator's clock
    rotor: Rotor  # sensor → earth (NWU)
    rate: Vector  # rad/s, sensor frame


class SimulatedMpu9250:
    """A bus with an MPU-9250 on it, carried through a motion that begins now.

    Time is what ``clock`` says (ns); with a `VirtualClock` everything is reproducible. A sample is
    taken when it is due and held until the next, so one burst never tears, and two may. Of the
    low-pass filters the delay and the noise bandwidth are there, not the damping of a motion
    faster than them. ``log`` gets the stamp and the 14 bytes of each sample taken, so that a test
    can tell what was lost on the way. ``who_am_i`` makes it another chip; all but 0x71 and 0x73
    come without the magnetometer, which keeps its state over a reset of the chip, as the real one
    does.
    """

    def __init__(
        self,
        motion: Motion,
        *,
        errors: Errors = Errors(),
        earth: Earth = Earth(),
        seed: int = 0,
        clock: Callable[[], int] = time.monotonic_ns,
        who_am_i: int = 0x71,
        fuses: tuple[int, int, int] = (176, 178, 167),
        trims: tuple[int, ...] = TRIMS,
        log: Callable[[int, bytes], None] = lambda stamp, data: None,
    ) -> None:
        self._clock = clock
        self._log = log
        self._origin = clock()
        self.world = World(motion, earth, errors, seed)
        self._who_am_i = who_am_i
        self._trims = trims
        self.self_test_response = [1.0] * len(AXES)  # as parts of the factory's
        self.mag_gone = False  # the magnetometer acknowledges nothing
        self._mag: SimulatedAk8963 | None = None
        if who_am_i in WITH_MAGNETOMETER:
            self._mag = SimulatedAk8963(lambda now: self.world.mag(self._seconds(now)), fuses)
        self._stamp = self._origin
        self._power_up(self._origin - RESET_TIME)

    def write(self, address: int, register: int, data: bytes) -> None:
        """One write transaction; `BusError` if nobody has the address."""
        now = self._clock()
        if address == reg.ADDRESS:
            self._advance(now)
            for offset, value in enumerate(data):
                self._store(register + offset, value, now)
        else:
            mag = self._bypassed(address)
            for offset, value in enumerate(data):
                mag.write(register + offset, value, now)

    def read(self, address: int, register: int, count: int) -> bytes:
        """One read transaction; `BusError` if nobody has the address."""
        now = self._clock()
        if address != reg.ADDRESS:
            return self._bypassed(address).read(register, count, now)
        self._advance(now)
        if register == reg.FIFO_R_W:
            data = bytes(self._fifo[:count])
            del self._fifo[:count]
            return data.ljust(count, b"\xff")
        self._registers[reg.FIFO_COUNTH : reg.FIFO_R_W] = len(self._fifo).to_bytes(2, "big")
        data = bytes(self._registers[register : register + count])
        if register <= reg.INT_STATUS < register + count:
            self._registers[reg.INT_STATUS] = 0
        return data

    def close(self) -> None:
        """Nothing to release."""

    @property
    def truth(self) -> Truth:
        """The truth at the last sample taken; before the first, at the beginning."""
        return self.truth_at(self._stamp)

    def truth_at(self, now: int) -> Truth:
        """The truth at any time, ns by the simulator's clock."""
        t = self._seconds(now)
        motion = self.world.motion
        return Truth(now, motion.rotor(t), motion.rate(t))

    def power_cycle(self) -> None:
        """Let the supply drop for a moment: both chips forget everything and start up anew."""
        now = self._clock()
        if self._mag is not None:
            self._mag.write(reg.AK_CNTL2, reg.AK_SOFT_RESET, now)
        self._power_up(now)

    def _seconds(self, now: int) -> float:
        return (now - self._origin) * 1e-9

    def _bypassed(self, address: int) -> SimulatedAk8963:
        """The magnetometer, where the bypass puts it on the bus."""
        registers = self._registers
        if (
            address != reg.AK_ADDRESS
            or self._mag is None
            or self.mag_gone
            or not registers[reg.INT_PIN_CFG] & reg.BYPASS_EN
            or registers[reg.USER_CTRL] & reg.I2C_MST_EN
        ):
            raise _nobody(address)
        return self._mag

    def _power_up(self, now: int) -> None:
        self._registers = bytearray(256)
        self._registers[reg.PWR_MGMT_1] = reg.CLKSEL_AUTO
        self._registers[reg.WHO_AM_I] = self._who_am_i
        self._registers[reg.SELF_TEST_ACCEL : reg.SELF_TEST_ACCEL + 3] = bytes(self._trims[:3])
        self._registers[reg.SELF_TEST_GYRO : reg.SELF_TEST_GYRO + 3] = bytes(self._trims[3:])
        self._fifo = bytearray()
        self._answers_from = now + RESET_TIME
        self._begin(self._answers_from + START_UP_TIME)

    def _store(self, register: int, value: int, now: int) -> None:
        registers = self._registers
        if register in READ_ONLY:
            return
        slept = registers[reg.PWR_MGMT_1] & reg.SLEEP
        registers[register] = value
        if register == reg.PWR_MGMT_1:
            if value & reg.H_RESET:
                self._power_up(now)
            elif slept and not value & reg.SLEEP:
                self._begin(now + START_UP_TIME)
        elif register in (reg.CONFIG, reg.SMPLRT_DIV):
            self._begin(max(now, self._first))
        elif register == reg.USER_CTRL and value & reg.FIFO_RST:
            self._fifo.clear()
            registers[register] = value & ~reg.FIFO_RST

    def _begin(self, first: int) -> None:
        """Take samples from ``first`` on, at the configured rate and through the filters."""
        dlpf = self._registers[reg.CONFIG] & reg.DLPF_MASK
        divided = 1 <= dlpf <= 6
        self._period = PERIOD * (1 + self._registers[reg.SMPLRT_DIV]) if divided else FAST_PERIOD
        self._first = first
        self._sample = -1  # number of the last one taken

    def _advance(self, now: int) -> None:
        """Take the newest sample that is due; those between, which nobody read, are gone.

        The auxiliary master served them too. Its transfer for the last but one has used up the
        magnetometer's data-ready bit; those before it would change nothing more. A FIFO keeps
        those between as well, as many as could be in it.
        """
        if now < self._answers_from:
            raise _nobody(reg.ADDRESS)
        n = (now - self._first) // self._period
        if n <= self._sample or self._registers[reg.PWR_MGMT_1] & reg.SLEEP:
            return
        collects = self._registers[reg.USER_CTRL] & reg.USE_FIFO
        oldest = n - FIFO_DEPTH if collects else n
        for k in range(max(self._sample + 1, min(oldest, n - 1)), n + 1):
            self._stamp = self._first + k * self._period
            self._transfer(self._stamp)
            if k >= oldest:
                self._take()
            if collects:
                self._collect()
        self._sample = n

    def _take(self) -> None:
        registers, world, t = self._registers, self.world, self._seconds(self._stamp)
        gyro_scale = math.radians(250 << (registers[reg.GYRO_CONFIG] >> reg.RANGE_SHIFT & 3))
        accel_scale = STANDARD_GRAVITY * (2 << (registers[reg.ACCEL_CONFIG] >> reg.RANGE_SHIFT & 3))
        bandwidth, delay = GYRO_FILTER[registers[reg.CONFIG] & reg.DLPF_MASK]
        gx, gy, gz = world.gyro(t - delay, bandwidth)
        bandwidth, delay = ACCEL_FILTER[registers[reg.ACCEL_CONFIG2] & reg.DLPF_MASK]
        ax, ay, az = world.accel(t - delay, bandwidth)
        g, a = FULL_SCALE / gyro_scale, FULL_SCALE / accel_scale
        temperature = (world.errors.temperature - TEMPERATURE_ORIGIN) * TEMPERATURE_SCALE
        sx, sy, sz = self._pushed(reg.ACCEL_CONFIG, 0)
        ux, uy, uz = self._pushed(reg.GYRO_CONFIG, 3)
        counts = (
            *(ax * a + sx, ay * a + sy, az * a + sz),
            temperature,
            *(gx * g + ux, gy * g + uy, gz * g + uz),
        )
        MEASUREMENT.pack_into(
            registers, reg.ACCEL_XOUT_H, *[min(max(round(n), LOWEST), HIGHEST) for n in counts]
        )
        registers[reg.INT_STATUS] |= registers[reg.INT_ENABLE] & reg.RAW_DATA_RDY
        self._log(self._stamp, bytes(registers[reg.ACCEL_XOUT_H : reg.EXT_SENS_DATA_00]))

    def _pushed(self, register: int, first: int) -> Vector:
        """Counts by which the self-test moves the three axes that the register sets."""
        config = self._registers[register]
        if not config & reg.SELF_TEST_XYZ:
            return (0.0, 0.0, 0.0)
        unit = 2620.0 / (1 << (config >> reg.RANGE_SHIFT & 3))
        parts = self.self_test_response[first : first + 3]
        x, y, z = (
            part * unit * 1.01 ** (trim - 1) if config & bit else 0.0
            for part, trim, bit in zip(parts, self._trims[first : first + 3], BITS, strict=True)
        )
        return (x, y, z)

    def _collect(self) -> None:
        """Put the sample into the FIFO, which drops its oldest bytes if it is full."""
        registers, what = self._registers, self._registers[reg.FIFO_EN]
        for bits, first, count in FIFO_PARTS:
            if what & bits:
                self._fifo += registers[first : first + count]
        if what & reg.FIFO_SLV0:
            count = registers[reg.I2C_SLV0_CTRL] & reg.I2C_SLV0_LENGTH_MASK
            self._fifo += registers[reg.EXT_SENS_DATA_00 : reg.EXT_SENS_DATA_00 + count]
        if len(self._fifo) > reg.FIFO_SIZE:
            del self._fifo[: -reg.FIFO_SIZE]
            registers[reg.INT_STATUS] |= registers[reg.INT_ENABLE] & reg.FIFO_OFLOW

    def _transfer(self, now: int) -> None:
        """One round of the auxiliary master: slave 0 alone."""
        registers = self._registers
        control = registers[reg.I2C_SLV0_CTRL]
        if not (registers[reg.USER_CTRL] & reg.I2C_MST_EN and control & reg.I2C_SLV0_EN):
            return
        slave, register = registers[reg.I2C_SLV0_ADDR], registers[reg.I2C_SLV0_REG]
        if self._mag is None or self.mag_gone or slave & ~reg.I2C_READ != reg.AK_ADDRESS:
            registers[reg.I2C_MST_STATUS] |= reg.I2C_SLV0_NACK
        elif slave & reg.I2C_READ:
            count = control & reg.I2C_SLV0_LENGTH_MASK
            data = self._mag.read(register, count, now)
            registers[reg.EXT_SENS_DATA_00 : reg.EXT_SENS_DATA_00 + count] = data
        else:
            self._mag.write(register, registers[reg.I2C_SLV0_DO], now)
