"""The I2C bus behind /dev/i2c-N, through smbus2."""

from __future__ import annotations

import errno
import glob
from typing import TYPE_CHECKING, Any

from ..errors import DeviceError, UsageError
from .bus import BusError

if TYPE_CHECKING:
    from smbus2 import SMBus

I2C_FUNC_I2C = 0x1  # linux/i2c.h: the adapter does plain transactions
HELD = (errno.ETIMEDOUT, errno.EAGAIN, errno.EBUSY)


class I2cBus:
    """Bus ``number``; see `Bus`. Every call is one transaction of at most two messages."""

    def __init__(self, number: int) -> None:
        try:
            import smbus2
        except ModuleNotFoundError:
            raise UsageError(
                "transport i2c needs the Python package smbus2: apt install python3-smbus2, or "
                "pip install 'stateful_ahrs[i2c]'."
            ) from None
        self._number = number
        self._message: Any = smbus2.i2c_msg
        try:
            self._bus: SMBus = smbus2.SMBus(number)
        except OSError as error:
            raise _closed(number, error) from None
        if not self._bus.funcs & I2C_FUNC_I2C:
            self._bus.close()
            raise DeviceError(
                f"{path(number)}: this adapter speaks SMBus alone, which has no burst of 23 bytes. "
                "Connect the sensor to another bus."
            )

    def write(self, address: int, register: int, data: bytes) -> None:
        """Write ``data`` into the registers from ``register`` on."""
        self._transfer(address, self._message.write(address, bytes((register,)) + data))

    def read(self, address: int, register: int, count: int) -> bytes:
        """Return exactly ``count`` bytes of the registers from ``register`` on."""
        answer = self._message.read(address, count)
        self._transfer(address, self._message.write(address, (register,)), answer)
        return bytes(answer)

    def close(self) -> None:
        """Close the device file."""
        self._bus.close()

    def _transfer(self, address: int, *messages: Any) -> None:
        try:
            self._bus.i2c_rdwr(*messages)
        except OSError as error:
            raise _failed(self._number, address, error) from None
        except TypeError:  # in between
            raise BusError(f"{path(self._number)} has been closed.") from None


def path(number: int) -> str:
    """The device file of a bus."""
    return f"/dev/i2c-{number}"


def _closed(number: int, error: OSError) -> DeviceError:
    """Why the bus cannot be opened, and what to do."""
    file = path(number)
    if error.errno == errno.EACCES:
        return DeviceError(
            f"{file}: permission denied. Add your user to the group i2c "
            "(sudo usermod -aG i2c $USER) and log in again."
        )
    if error.errno == errno.ENOENT:
        others = ", ".join(sorted(glob.glob("/dev/i2c-*"))) or "no bus at all"
        return DeviceError(
            f"{file}: there is no such bus, there is {others}. Switch I2C on (Raspberry Pi: "
            "sudo raspi-config nonint do_i2c 0) or set i2c_bus."
        )
    return DeviceError(f"{file}: cannot be opened ({error.strerror}).")


def _failed(number: int, address: int, error: OSError) -> BusError:
    """Why a transaction failed, and what to do."""
    file = path(number)
    if error.errno in (errno.ENXIO, errno.EREMOTEIO, errno.EIO):
        return BusError(
            f"{file}: no device answers at address 0x{address:02X}. `i2cdetect -y {number}` shows "
            "those that do: set i2c_address, or check the wires and the supply."
        )
    if error.errno in HELD:
        return BusError(
            f"{file}: the bus is busy ({error.strerror}): something holds its lines. Check the "
            "wires, the pull-up resistors and what else is on it."
        )
    return BusError(f"{file}: a transaction with 0x{address:02X} failed ({error.strerror}).")
