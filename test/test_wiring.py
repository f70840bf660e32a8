"""Each transport has its source, and what does not go together is refused with what does."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from stateful_ahrs.errors import DeviceError, UsageError
from stateful_ahrs.mpu9250 import i2c
from stateful_ahrs.mpu9250.chip import Settings
from stateful_ahrs.mpu9250.chip_source import ChipSource
from stateful_ahrs.mpu9250.motion import motion
from stateful_ahrs.mpu9250.serial_source import SerialSource
from stateful_ahrs.mpu9250.simulator import SimulatedMpu9250
from stateful_ahrs.mpu9250.wiring import Wiring


def test_each_transport_has_its_source():
    sim = SimulatedMpu9250(motion("rest"))
    assert isinstance(Wiring("sim").source(Settings(), sim), ChipSource)
    i2c_source = Wiring("i2c", i2c_bus=7).source(Settings())
    assert str(i2c_source) == "MPU-9250 on /dev/i2c-7"
    serial_source = Wiring("serial", port="/dev/ttyUSB3").source(Settings())
    assert isinstance(serial_source, SerialSource)
    assert str(serial_source) == "MPU-9250 at /dev/ttyUSB3 (protocol auto)"


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"transport": "spi"}, "transport must be one of sim, i2c, serial, got 'spi'"),
        ({"i2c_address": 0x0C}, r"i2c_address must be 104 \(0x68\) or, .* 105 \(0x69\), got 12"),
        ({"i2c_bus": -1}, "i2c_bus must be 0 or more, got -1"),
        ({"baudrate": 0}, "baudrate must be between 1 and 12000000, got 0"),
        ({"baudrate": 1 << 32}, "baudrate must be between 1 and 12000000, got 4294967296"),
        ({"protocol": "nmea"}, "protocol must be one of auto, frame, razor, rt_usb, got 'nmea'"),
    ],
)
def test_what_there_is_not_is_refused(wrong: dict[str, object], sentence: str):
    with pytest.raises(UsageError, match=sentence):
        Wiring(**wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["fifo", "bypass"])
def test_a_board_at_a_serial_port_reads_its_chip_itself(name: str):
    with pytest.raises(UsageError, match=f"{name} is for transport i2c.*Set {name} to false"):
        Wiring("serial").source(Settings(**{name: True}))


@pytest.mark.skipif(Path("/dev/i2c-250").exists(), reason="there is such a bus")
def test_a_bus_that_is_not_there_is_said_with_those_that_are():
    pytest.importorskip("smbus2")
    with pytest.raises(DeviceError, match=r"/dev/i2c-250: there is no such bus, there is .*raspi"):
        i2c.I2cBus(250)


@pytest.mark.parametrize(
    ("code", "sentence"),
    [
        (errno.EACCES, r"permission denied. Add your user to the group i2c \(sudo usermod"),
        (errno.ENOENT, "there is no such bus, there is .*Switch I2C on"),
        (errno.ENOTTY, "cannot be opened"),
    ],
)
def test_a_bus_that_cannot_be_opened_is_said_with_the_remedy(code: int, sentence: str):
    with pytest.raises(DeviceError, match=f"/dev/i2c-1: {sentence}"):
        raise i2c._closed(1, OSError(code, os.strerror(code)))


@pytest.mark.parametrize(
    ("code", "sentence"),
    [
        (errno.ENXIO, "no device answers at address 0x69. `i2cdetect -y 3` shows"),
        (errno.EREMOTEIO, "no device answers at address 0x69"),
        (errno.EIO, "no device answers at address 0x69"),
        (errno.ETIMEDOUT, "the bus is busy"),
        (errno.EAGAIN, "the bus is busy"),
        (errno.ENODEV, "a transaction with 0x69 failed"),
    ],
)
def test_a_transaction_that_fails_is_said_with_the_remedy(code: int, sentence: str):
    with pytest.raises(DeviceError, match=f"/dev/i2c-3: {sentence}"):
        raise i2c._failed(3, 0x69, OSError(code, os.strerror(code)))
