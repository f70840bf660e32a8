"""Answers i2c_shim.c: a simulated chip on a bus behind /dev/i2c-N.

    python i2c_simulator.py FOLDER NUMBER LOG WHO_AM_I MOTION

Lines on stdin switch faults (see `Sensor`), and besides: ``unplug`` and ``plug`` the sensor,
``deny`` the next program that opens the bus, ``hold`` the lines of the bus, ``remove`` the
adapter with its device file and ``insert`` it again. Each line is answered on stdout.
"""

from __future__ import annotations

import contextlib
import errno
import selectors
import socket
import struct
import sys
import time
from pathlib import Path

from sensor import Sensor

from stateful_ahrs.mpu9250.bus import BusError

HEAD = struct.Struct("<3H")  # address, flags, length of a message
READ = 0x0001
FUNCTIONS = 0x0EFF0009  # what the Raspberry Pi's adapter says: plain I2C and emulated SMBus
BYTE, BYTE_DATA, WORD_DATA, BLOCK = 1, 2, 3, 8


class Adapter:
    """The bus and the programs that have it open."""

    def __init__(self, folder: Path, number: int, sensor: Sensor) -> None:
        self._path = folder / f"i2c-{number}"
        self._sensor = sensor
        self._selector = selectors.DefaultSelector()
        self._selector.register(sys.stdin, selectors.EVENT_READ)
        self._programs: list[socket.socket] = []
        self._deny = self._hold = False
        self._door: socket.socket | None = None
        self.insert()

    def insert(self) -> None:
        """Make the device file."""
        self._door = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._door.bind(str(self._path))
        self._door.listen()
        self._selector.register(self._door, selectors.EVENT_READ)

    def remove(self) -> None:
        """Take the adapter away, from those too that have it open."""
        if self._door is None:
            return
        self._selector.unregister(self._door)
        self._door.close()
        self._door = None
        self._path.unlink()
        for program in self._programs[:]:
            self._leave(program)

    def serve(self) -> None:
        """Answer until stdin ends."""
        while True:
            for key, _ in self._selector.select():
                if key.fileobj is sys.stdin:
                    line = sys.stdin.readline()
                    if not line:
                        return
                    self._obey(*line.split())
                    print("done", flush=True)
                elif key.fileobj is self._door:
                    self._enter()
                elif key.fileobj in self._programs:  # else it was just removed
                    self._answer(key.fileobj)  # type: ignore[arg-type]

    def _obey(self, command: str, value: str = "1") -> None:
        if command in ("unplug", "plug"):
            self._sensor.bus.unplugged = command == "unplug"
            if command == "plug":
                self._sensor.sim.power_cycle()
        elif command == "deny":
            self._deny = value == "1"
        elif command == "hold":
            self._hold = value == "1"
        elif command in ("remove", "insert"):
            getattr(self, command)()
        elif not self._sensor.obey(command, float(value)):
            raise SystemExit(f"unknown command {command!r}")

    def _enter(self) -> None:
        assert self._door is not None
        program, _ = self._door.accept()
        program.send(struct.pack("<i", errno.EACCES if self._deny else 0))
        if self._deny:
            program.close()
            return
        self._programs.append(program)
        self._selector.register(program, selectors.EVENT_READ)

    def _leave(self, program: socket.socket) -> None:
        self._selector.unregister(program)
        self._programs.remove(program)
        program.close()

    def _answer(self, program: socket.socket) -> None:
        with contextlib.suppress(ConnectionError):
            packet = program.recv(1 << 14)
            if packet:
                program.send(self._result(packet))
                return
        self._leave(program)

    def _result(self, packet: bytes) -> bytes:
        kind, body = packet[:1], packet[1:]
        try:
            if kind == b"R":
                if self._hold:
                    return struct.pack("<i", errno.ETIMEDOUT)
                data = self._transfer(body)
            elif kind == b"S":
                data = self._smbus(body)
            else:
                data = struct.pack("<Q", FUNCTIONS) if kind == b"F" else b""
        except BusError:
            return struct.pack("<i", errno.EREMOTEIO)
        return struct.pack("<i", 0) + data

    def _transfer(self, body: bytes) -> bytes:
        """I2C_RDWR: a register to write and what goes into it, or to read from on."""
        found, register, position = b"", 0, 1
        for _ in range(body[0]):
            address, flags, length = HEAD.unpack_from(body, position)
            position += HEAD.size
            if flags & READ:
                found += self._sensor.bus.read(address, register, length)
                continue
            register, data = body[position], body[position + 1 : position + length]
            position += length
            if data:
                self._sensor.bus.write(address, register, data)
        return found

    def _smbus(self, body: bytes) -> bytes:
        """I2C_SMBUS: the kinds that i2c-tools and smbus2 use to look at registers."""
        address, reading, register, size = struct.unpack_from("<HBBI", body)
        block = body[8:]
        bus = self._sensor.bus
        count = {BYTE: 1, BYTE_DATA: 1, WORD_DATA: 2}.get(size, block[0])
        if not reading:
            bus.write(address, register, block[1 : 1 + count] if size == BLOCK else block[:count])
            return block
        data = bus.read(address, register, count)
        data = bytes((count,)) + data if size == BLOCK else data
        return data.ljust(34, b"\0")


def main() -> None:
    """Serve."""
    folder, number, log, who_am_i, moving = sys.argv[1:]
    sensor = Sensor(time.monotonic_ns, Path(log), int(who_am_i, 0), moving)
    adapter = Adapter(Path(folder), int(number), sensor)
    print("ready", flush=True)
    adapter.serve()


if __name__ == "__main__":
    main()
