"""The MPU-9250 on a bus: identified, configured, read."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from ..errors import DeviceError, UsageError
from ..rotor import Vector
from . import registers as reg
from .burst import INERTIAL, MAGNETIC, NOBODY, STUCK, Burst, Reading
from .bus import Bus, BusError

GYRO_RANGES = (250, 500, 1000, 2000)  # °/s
ACCEL_RANGES = (2, 4, 8, 16)  # g
DLPF_SETTINGS = (1, 2, 3, 4, 5, 6)  # the others run at 8 kHz, whatever the divider
INTERNAL_RATE = 1000.0  # Hz, before the divider
MAX_DIVISOR = 256
RATE_TOLERANCE = 0.0015  # 333 stands for 333.333

NAMES = {reg.MPU_9250: "MPU-9250", 0x73: "MPU-9255", 0x70: "MPU-6500"}
SIX_AXES = {0x70}
OTHERS = {
    0x12: "ICM-20602",
    0x68: "MPU-6050 or MPU-9150",
    0x74: "MPU-6515",
    0x78: "MPU-6880",
    0x98: "ICM-20689",
    0xAF: "ICM-20608",
}

RESET_TIME = 0.1  # s
START_UP_TIME = 0.035  # s, of the gyroscope; the accelerometer's is shorter
READY = bytes((reg.RAW_DATA_RDY,))
MODE_TIME = 0.001  # s between two modes of the AK8963: ten times what it needs
TRANSFER_TIME = 0.01  # s, for the auxiliary master: ten of its rounds


@dataclass(frozen=True)
class Settings:
    """What a user chooses of the chip; `UsageError` where the chip has no such thing."""

    rate: float = 200.0  # Hz: 1000 / n, n from 1 to 256
    gyro_range: int = 1000  # ± °/s
    accel_range: int = 4  # ± g
    dlpf: int = 2  # low-pass of both: 1: 184 Hz, 2: 92, 3: 41, 4: 20, 5: 10, 6: 5 (gyroscope)
    fifo: bool = False  # let the chip collect samples: for rates that reading each cannot hold
    bypass: bool = False  # read the magnetometer on the bus, not through the auxiliary master

    def __post_init__(self) -> None:
        if self.fifo and self.bypass:
            raise UsageError(
                "fifo and bypass exclude each other: the FIFO holds what the auxiliary master "
                "fetches. Set one of them to false."
            )
        _one_of("gyro_range", self.gyro_range, GYRO_RANGES, " °/s")
        _one_of("accel_range", self.accel_range, ACCEL_RANGES, " g")
        _one_of("dlpf", self.dlpf, DLPF_SETTINGS)
        if not (math.isfinite(self.rate) and self.rate > 0.0):
            raise UsageError(f"rate must be a positive number of Hz, got {self.rate:g}.")
        if abs(INTERNAL_RATE / self.divisor - self.rate) > RATE_TOLERANCE * self.rate:
            nearest = sorted({math.ceil(self._ratio), math.floor(self._ratio)}, reverse=True)
            rates = " and ".join(f"{INTERNAL_RATE / divisor:g}" for divisor in nearest)
            raise UsageError(
                f"rate must be 1000 Hz divided by a whole number from 1 to {MAX_DIVISOR}, "
                f"got {self.rate:g} Hz; nearest: {rates} Hz."
            )

    @property
    def divisor(self) -> int:
        """By how much the chip divides its 1000 Hz."""
        return round(self._ratio)

    @property
    def _ratio(self) -> float:
        return min(max(INTERNAL_RATE / self.rate, 1.0), MAX_DIVISOR)


def _one_of(name: str, value: int, choices: tuple[int, ...], unit: str = "") -> None:
    if value not in choices:
        nearest = min(choices, key=lambda choice: abs(choice - value))
        raise UsageError(
            f"{name} must be one of {', '.join(map(str, choices))}{unit}, "
            f"got {value}; nearest: {nearest}."
        )


class MagnetometerError(DeviceError):
    """The chip is well, and its magnetometer is not."""


class Mpu9250:
    """A configured MPU-9250, MPU-9255, or MPU-6500 (which has no magnetometer).

    `DeviceError` if the chip is absent, of another kind, or does not keep what it is told; a
    `MagnetometerError` only if ``magnetometer``: without it the other six axes are read.
    ``sleep`` (s) is that of the bus where it is simulated in a time of its own.
    """

    def __init__(
        self,
        bus: Bus,
        settings: Settings = Settings(),
        address: int = reg.ADDRESS,
        sleep: Callable[[float], None] = time.sleep,
        magnetometer: bool = True,
    ) -> None:
        self._bus = bus
        self._address = address
        self._sleep = sleep
        self.settings = settings
        self._fifo_torn = False  # nobody knows where a sample begins in it
        self.configure(magnetometer)

    def configure(self, magnetometer: bool = True) -> None:
        """Bring the chip from any state to the settings; also after it lost its supply."""
        self._identify()
        self._write(reg.PWR_MGMT_1, reg.H_RESET)
        self._sleep(RESET_TIME)
        self._configuration: dict[int, int] = {}
        self._set(reg.PWR_MGMT_1, reg.CLKSEL_AUTO)
        self._sleep(START_UP_TIME)
        s = self.settings
        if s.bypass:
            self._set(reg.INT_PIN_CFG, reg.BYPASS_EN)
        self._set(reg.CONFIG, s.dlpf)
        self._set(reg.GYRO_CONFIG, GYRO_RANGES.index(s.gyro_range) << reg.RANGE_SHIFT)
        self._set(reg.ACCEL_CONFIG, ACCEL_RANGES.index(s.accel_range) << reg.RANGE_SHIFT)
        self._set(reg.ACCEL_CONFIG2, s.dlpf)
        self._set(reg.INT_ENABLE, reg.RAW_DATA_RDY)
        wanted = magnetometer and self.has_magnetometer
        adjustment = self._start_magnetometer() if wanted else None
        self._set(reg.SMPLRT_DIV, s.divisor - 1)  # last: the auxiliary master works at this rate
        self._burst = Burst(s.gyro_range, s.accel_range, adjustment)
        if s.fifo:
            self._start_fifo()
        self.verify()

    def verify(self) -> None:
        """Raise `DeviceError` if a register has lost its setting, as after a drop of the supply."""
        for register, value in self._configuration.items():
            found = self._read(register)
            if found != value:
                raise self._forgotten(register, found)

    def check(self) -> None:
        """`verify` of the registers that say what samples are, in one short transaction."""
        first, last = reg.SMPLRT_DIV, reg.ACCEL_CONFIG2
        data = self._bus.read(self._address, first, last + 1 - first)
        for register, found in enumerate(data, first):
            if found != self._configuration[register]:
                raise self._forgotten(register, found)

    def _forgotten(self, register: int, found: int) -> DeviceError:
        return DeviceError(
            f"{self} lost its configuration: register 0x{register:02X} holds 0x{found:02X}, "
            f"expected 0x{self._configuration[register]:02X}. Check its supply and its wires."
        )

    def read(self) -> Reading | None:
        """The newest sample, in one transaction; None if it has been read before.

        In bypass the magnetometer takes a transaction of its own.
        """
        burst = self._burst
        if not self.settings.bypass or burst.size == INERTIAL.size:
            return burst.reading(self._bus.read(self._address, reg.INT_STATUS, burst.size))
        data = self._bus.read(self._address, reg.INT_STATUS, INERTIAL.size)
        if not data[0] & reg.RAW_DATA_RDY:
            return None
        return burst.reading(data + self._bus.read(reg.AK_ADDRESS, reg.AK_ST1, MAGNETIC.size))

    def drain(self) -> tuple[list[Reading], bool]:
        """The samples in the FIFO, oldest first, and whether some were lost.

        A FIFO that overflowed, or that was left in the midst of a transaction that failed, has lost
        bytes, so that nobody knows where a sample begins: it is emptied, and there are no samples.
        """
        if self._fifo_torn:
            self._empty_fifo()
            return [], True
        size = self._burst.size - 1  # a sample in the FIFO has no status
        data = self._bus.read(self._address, reg.FIFO_COUNTH, 2)
        if data == b"\xff\xff":
            raise BusError(STUCK)
        count = (data[0] << 8 | data[1]) & reg.FIFO_COUNT_MASK
        whole = count // size * size
        self._fifo_torn = True
        samples = self._bus.read(self._address, reg.FIFO_R_W, whole) if whole else b""
        (status,) = self._bus.read(self._address, reg.INT_STATUS, 1)
        if status & reg.FIFO_OFLOW or count > reg.FIFO_SIZE // size * size:
            self._empty_fifo()
            return [], True
        self._fifo_torn = False
        found = (self._burst.reading(READY + samples[n : n + size]) for n in range(0, whole, size))
        return [reading for reading in found if reading is not None], False

    def close(self) -> None:
        """Release the bus."""
        self._bus.close()

    def __str__(self) -> str:
        without = "" if self.has_magnetometer else " (no magnetometer)"
        return f"{self.name} at 0x{self._address:02X}{without}"

    def _identify(self) -> None:
        found = self._read(reg.WHO_AM_I)
        if found == NOBODY:
            raise BusError(STUCK)
        if found not in NAMES:
            what = OTHERS.get(found, "unknown")
            known = ", ".join(f"0x{code:02X} ({name})" for code, name in NAMES.items())
            raise DeviceError(
                f"the chip at 0x{self._address:02X} answers 0x{found:02X} ({what}) to WHO_AM_I; "
                f"expected {known}."
            )
        self.name = NAMES[found]
        self.has_magnetometer = found not in SIX_AXES

    def _start_magnetometer(self) -> Vector:
        """Set the AK8963 measuring, the auxiliary master fetching; return the adjustment."""
        bypass = self.settings.bypass
        self._set(reg.USER_CTRL, 0 if bypass else reg.I2C_MST_EN)
        if not bypass:
            self._set(reg.I2C_MST_CTRL, reg.WAIT_FOR_ES | reg.I2C_MST_400_KHZ)
        try:
            self._write_mag(reg.AK_CNTL2, reg.AK_SOFT_RESET)
        except BusError as error:
            if not bypass:
                raise
            raise MagnetometerError(f"the magnetometer of the {self}: {error}") from None
        (identity,) = self._read_mag(reg.AK_WIA, 1)
        if identity != reg.AK_DEVICE_ID:
            raise MagnetometerError(
                f"the magnetometer of the {self} answers 0x{identity:02X}, expected "
                f"0x{reg.AK_DEVICE_ID:02X} (AK8963). Switch the board off and on again."
            )
        self._write_mag(reg.AK_CNTL1, reg.AK_FUSE_ROM)
        fuses = self._read_mag(reg.AK_ASAX, 3)
        if fuses == b"\xff\xff\xff":
            raise MagnetometerError(
                f"the magnetometer of the {self} answers 0xFF for each factory adjustment: its "
                "bus is stuck. Switch the board off and on again."
            )
        mode = reg.AK_16_BIT | reg.AK_CONTINUOUS_100_HZ
        self._write_mag(reg.AK_CNTL1, reg.AK_POWER_DOWN)  # the way from one mode to another
        self._write_mag(reg.AK_CNTL1, mode)
        (found,) = self._read_mag(reg.AK_CNTL1, 1)
        if found != mode:
            raise MagnetometerError(
                f"the magnetometer of the {self} stays in mode 0x{found:02X} after 0x{mode:02X}."
            )
        if not bypass:
            self._set(reg.I2C_SLV0_ADDR, reg.AK_ADDRESS | reg.I2C_READ)
            self._set(reg.I2C_SLV0_REG, reg.AK_ST1)
            self._set(reg.I2C_SLV0_CTRL, reg.I2C_SLV0_EN | MAGNETIC.size)
        x, y, z = ((fuse - 128) * 0.5 / 128 + 1 for fuse in fuses)
        return (x, y, z)

    def _start_fifo(self) -> None:
        """Let the chip collect what a burst would read."""
        magnetic = self._burst.size > INERTIAL.size
        self._set(reg.INT_ENABLE, reg.RAW_DATA_RDY | reg.FIFO_OFLOW)
        self._set(reg.FIFO_EN, reg.FIFO_INERTIAL | (reg.FIFO_SLV0 if magnetic else 0))
        self._set(reg.USER_CTRL, self._configuration.get(reg.USER_CTRL, 0) | reg.USE_FIFO)
        self._empty_fifo()

    def _empty_fifo(self) -> None:
        """Empty the FIFO, between two samples of which the next is its first."""
        on = self._configuration[reg.USER_CTRL]
        self._write(reg.USER_CTRL, on & ~reg.USE_FIFO)
        self._write(reg.USER_CTRL, on & ~reg.USE_FIFO | reg.FIFO_RST)
        self._write(reg.USER_CTRL, on)
        self._fifo_torn = False

    def _write_mag(self, register: int, value: int) -> None:
        if self.settings.bypass:
            self._bus.write(reg.AK_ADDRESS, register, bytes((value,)))
            self._sleep(MODE_TIME)
            return
        self._write(reg.I2C_SLV0_DO, value)
        self._transfer(reg.AK_ADDRESS, register, 1)

    def _read_mag(self, register: int, count: int) -> bytes:
        if self.settings.bypass:
            return self._bus.read(reg.AK_ADDRESS, register, count)
        self._transfer(reg.AK_ADDRESS | reg.I2C_READ, register, count)
        return self._bus.read(self._address, reg.EXT_SENS_DATA_00, count)

    def _transfer(self, address: int, register: int, count: int) -> None:
        """Let the auxiliary master do one transfer (it repeats it each round), then stop it."""
        self._write(reg.I2C_SLV0_ADDR, address)
        self._write(reg.I2C_SLV0_REG, register)
        self._write(reg.I2C_SLV0_CTRL, reg.I2C_SLV0_EN | count)
        self._sleep(TRANSFER_TIME)
        self._write(reg.I2C_SLV0_CTRL, 0)

    def _set(self, register: int, value: int) -> None:
        """Write what the register is to hold from now on."""
        self._write(register, value)
        self._configuration[register] = value

    def _write(self, register: int, value: int) -> None:
        self._bus.write(self._address, register, bytes((value,)))

    def _read(self, register: int) -> int:
        return self._bus.read(self._address, register, 1)[0]
