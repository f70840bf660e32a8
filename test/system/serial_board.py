"""A board at a serial port: a pseudo-terminal into which a simulated sensor is written.

    python serial_board.py PORT LOG KIND MOTION [OPTION=VALUE ...]

PORT becomes a link to the terminal. KIND and its options are those of `boards`; ``rate`` in Hz
and ``drift`` of the board's clock are options too. Lines on stdin switch faults (see `Sensor`),
and besides: ``unplug`` and ``plug`` the board, ``drop`` so many samples, ``restart`` the board,
``silent``, ``garbage`` of so many bytes, a ``reply``. Each line is answered on stdout.
"""

from __future__ import annotations

import os
import random
import select
import sys
import time
import tty
from dataclasses import fields, replace
from pathlib import Path

from boards import BOARDS, bursts
from sensor import Sensor

from stateful_ahrs.mpu9250 import registers as reg
from stateful_ahrs.mpu9250.simulator import VirtualClock

PATIENCE = 0.5  # s
REPLY = b"IMU rate set to 100 Hz\r\n"


class Board:
    """Sends each sample when it is due, or as soon as the line takes it: none is lost here."""

    def __init__(
        self, port: Path, log: Path, kind: str, moving: str, options: dict[str, float]
    ) -> None:
        make = BOARDS[kind]
        rate = options.pop("rate", 0.0)
        self._drift = options.pop("drift", 0.0)
        names = {field.name for field in fields(make)}  # type: ignore[arg-type]
        assert set(options) <= names, options
        self._board = make(**options)  # type: ignore[arg-type]
        if rate:
            self._board.settings = replace(self._board.settings, rate=rate)
        self._port = port
        self._clock = VirtualClock()
        self.sensor = Sensor(self._clock, log, 0x71, moving)
        self._ends: tuple[int, int] | None = None
        self._drop = 0
        self._silent = False
        self._random = random.Random(5)
        self.plug()

    def plug(self) -> None:
        """Put the board into the port; it starts up."""
        self._ends = os.openpty()
        tty.setraw(self._ends[1])
        os.set_blocking(self._ends[0], False)
        self._full_since: float | None = None
        self._port.unlink(missing_ok=True)
        self._port.symlink_to(os.ttyname(self._ends[1]))
        self.restart()

    def unplug(self) -> None:
        """Take it out."""
        if self._ends is not None:
            self._port.unlink()
            for end in self._ends:
                os.close(end)
            self._ends = None

    def restart(self) -> None:
        """Start the sketch: chip configured, numbers and clock from zero."""
        bus, settings = self.sensor.bus, self._board.settings
        bursts(bus, settings, 1, self._clock.sleep)
        self._period = settings.divisor * 1_000_000
        self._sequence = 0
        self._booted = self._clock.now
        self._ahead = self._clock.now - time.monotonic_ns()

    def serve(self) -> None:
        """Send until stdin ends."""
        due = self._clock.now
        while True:
            due += self._period
            while (left := due - self._ahead - time.monotonic_ns()) > 0 or self._ends is None:
                if select.select([sys.stdin], [], [], max(0.0, left * 1e-9))[0]:
                    line = sys.stdin.readline()
                    if not line:
                        return
                    self._obey(*line.split())
                    print("done", flush=True)
                    due = max(due, self._clock.now + self._period)
                elif self._ends is None:
                    due = time.monotonic_ns() + self._ahead + self._period
            self._clock.now = due
            self._sample()

    def _sample(self) -> None:
        data = self.sensor.bus.read(reg.ADDRESS, reg.INT_STATUS, 23)
        if not data[0] & reg.RAW_DATA_RDY:
            return
        self._sequence += 1
        if self._silent:
            return
        if self._drop:
            self._drop -= 1
            return
        micros = round((self._clock.now - self._booted) * (1.0 + self._drift) / 1000)
        self._write(self._board.sample(data, self._sequence, micros))

    def _write(self, data: bytes) -> None:
        """Wait for a slow reader; without a reader, or with one that stands still, give up."""
        while self._ends is not None and data:
            try:
                data = data[os.write(self._ends[0], data) :]
                self._full_since = None
            except BlockingIOError:
                now = time.monotonic()
                self._full_since = self._full_since or now
                if now - self._full_since > PATIENCE:
                    return
                time.sleep(0.001)

    def _obey(self, command: str, value: str = "1") -> None:
        if command in ("plug", "unplug", "restart"):
            getattr(self, command)()
        elif command == "drop":
            self._drop = int(value)
        elif command == "silent":
            self._silent = value == "1"
        elif command == "garbage":
            self._write(self._random.randbytes(int(value)))
        elif command == "reply":
            self._write(REPLY)
        elif not self.sensor.obey(command, float(value)):
            raise SystemExit(f"unknown command {command!r}")


def main() -> None:
    """Serve."""
    port, log, kind, moving, *pairs = sys.argv[1:]
    options = {name: float(value) for name, value in (pair.split("=") for pair in pairs)}
    options = {name: int(n) if n.is_integer() else n for name, n in options.items()}
    board = Board(Path(port), Path(log), kind, moving, options)
    print("ready", flush=True)
    board.serve()


if __name__ == "__main__":
    main()
