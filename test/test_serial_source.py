"""A serial port is found, read, lost and found again; over real pseudo-terminals."""

from __future__ import annotations

import os
import termios
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
from boards import BOARDS, Bridge
from streams import COUNT, stream

from stateful_ahrs.errors import DeviceError, UsageError
from stateful_ahrs.mpu9250 import serial_source
from stateful_ahrs.mpu9250.serial_source import SerialSource
from stateful_ahrs.mpu9250.source import Sample

pytest.importorskip("serial", reason="pyserial is not installed")


class Port:
    """A pseudo-terminal: what is written to ``board`` comes out at ``name``."""

    def __init__(self) -> None:
        self.board, self._line = os.openpty()
        tty.setraw(self._line)
        self.name = os.ttyname(self._line)

    def send(self, data: bytes) -> None:
        os.write(self.board, data)

    def unplug(self) -> None:
        for end in (self.board, self._line):
            if end >= 0:
                os.close(end)
        self.board = self._line = -1


@pytest.fixture
def port() -> Iterator[Port]:
    port = Port()
    yield port
    port.unplug()


def until(source: SerialSource, count: int) -> list[Sample]:
    samples: list[Sample] = []
    end = time.monotonic() + 10.0
    while len(samples) < count:
        assert time.monotonic() < end
        samples += source.read()
    return samples


@pytest.mark.parametrize("name", BOARDS)
def test_every_board_is_read_and_named(port: Port, name: str):
    board = BOARDS[name]()
    source = SerialSource(port.name, board.baudrate)
    source.open()
    data = b"".join(stream(board))
    port.send(data[:100])
    port.send(data[100:])
    samples = until(source, COUNT - 2)
    assert str(source) == f"MPU-9250 at {port.name} ({name})"
    assert all(abs(sample.arrival - time.monotonic_ns()) < 5e9 for sample in samples)
    source.close()


def test_a_bridge_with_an_mpu_6500_is_named_and_misses_no_magnetometer(port: Port):
    source = SerialSource(port.name, 921600)
    source.open()
    assert source.has_magnetometer  # as far as is known
    port.send(b"".join(stream(Bridge(who_am_i=0x70))))
    assert all(sample.reading.mag is None for sample in until(source, COUNT))
    assert str(source) == f"MPU-6500 at {port.name} (frame, no magnetometer)"
    assert not source.has_magnetometer
    source.close()


def test_what_had_come_before_the_port_was_opened_is_old_and_left_out(port: Port):
    port.send(b"".join(stream(Bridge())))
    source = SerialSource(port.name, 921600, "frame")
    source.open()
    port.send(b"".join(stream(Bridge(), first=100)))
    samples = until(source, COUNT)
    assert samples[0].device == 3_000_000_000
    source.close()


def test_discarded_bytes_add_up_over_all_openings(port: Port):
    source = SerialSource(port.name, 921600, "frame")
    for n in (1, 2):
        source.open()
        port.send(b"boot\0" + b"".join(stream(Bridge())))
        until(source, COUNT)
        source.close()
        assert source.faults.bytes_discarded == 5 * n


def test_a_board_that_is_unplugged_is_gone(port: Port):
    source = SerialSource(port.name, 921600)
    source.open()
    port.send(b"".join(stream(Bridge())))
    until(source, COUNT)
    port.unplug()
    with pytest.raises(DeviceError, match=f"{port.name} is gone .*Plug it in"):
        until(source, 1)
    source.close()
    with pytest.raises(DeviceError, match="there is no such port"):
        source.open()
    source.close()


def test_a_port_that_is_not_there_is_said_with_those_that_are():
    with pytest.raises(DeviceError, match="/dev/nosuchport: there is no such port, there is"):
        SerialSource("/dev/nosuchport", 115200).open()


def test_a_port_in_use_is_said(port: Port):
    first, second = SerialSource(port.name, 115200), SerialSource(port.name, 115200)
    first.open()
    with pytest.raises(DeviceError, match=f"{port.name} is in use by another program"):
        second.open()
    first.close()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may open everything")
def test_a_port_that_may_not_be_opened_is_said(tmp_path: Path):
    file = tmp_path / "tty"
    file.touch(0)
    with pytest.raises(DeviceError, match=r"permission denied. Add your user to the group"):
        SerialSource(str(file), 115200).open()


def test_permission_is_named_with_its_remedy():
    error = PermissionError(13, "could not open port", "/dev/ttyACM0")
    sentence = str(SerialSource("/dev/ttyACM0", 115200)._closed(error))
    assert "permission denied. Add your user to the group dialout (sudo usermod -aG" in sentence


def test_a_file_that_is_no_port_is_said(tmp_path: Path):
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(DeviceError, match="cannot be opened"):
        SerialSource(str(file), 115200).open()


def test_a_board_that_goes_while_its_port_is_opened_is_said(
    port: Port, monkeypatch: pytest.MonkeyPatch
):
    import serial

    def gone(_: object) -> None:
        raise termios.error(5, "Input/output error")

    monkeypatch.setattr(serial.Serial, "reset_input_buffer", gone)
    with pytest.raises(DeviceError, match=r"cannot be opened .*Input/output error"):
        SerialSource(port.name, 115200).open()


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serial_source, "FIRST", 0.3)
    monkeypatch.setattr(serial_source, "SILENCE", 0.3)


@pytest.mark.parametrize(
    ("data", "protocol", "sentence"),
    [
        (b"", "auto", "sends nothing. Check that the board has power"),
        (b"$GPGGA,1\r\n" * 20, "auto", "sent 200 bytes without a sample in protocol auto. Check"),
        (b"1, 0.1, 0.1, 1.00\r\n" * 9, "razor", "lines have 4 fields. Switch on the accelerom"),
        (b"".join(stream(Bridge())), "razor", "without a sample in protocol razor"),
    ],
)
def test_a_line_without_samples_is_said_with_what_helps(
    port: Port, impatient: None, data: bytes, protocol: str, sentence: str
):
    source = SerialSource(port.name, 115200, protocol)
    source.open()
    if data:
        port.send(data)
    with pytest.raises(DeviceError, match=sentence):
        until(source, 1)
    source.close()


def test_a_board_that_falls_silent_is_said(port: Port, impatient: None):
    source = SerialSource(port.name, 115200)
    source.open()
    port.send(b"".join(stream(Bridge())))
    until(source, COUNT)
    with pytest.raises(DeviceError, match="sends nothing"):
        until(source, 1)
    source.close()


def test_an_unknown_protocol_is_refused():
    with pytest.raises(UsageError, match="protocol must be one of"):
        SerialSource("/dev/ttyACM0", 115200, "nmea")
