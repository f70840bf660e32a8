"""The sensor in a process of its own, as the simulators of this folder carry it: its faults and
its log, switched by lines on stdin."""

from __future__ import annotations

import struct
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[2])]

from faulty import FaultyBus

from stateful_ahrs.mpu9250.motion import motion
from stateful_ahrs.mpu9250.simulator import SimulatedMpu9250

ROW = struct.Struct("<q14s")  # of the log: stamp in ns by the clock of the sensor, counts


class Sensor:
    """A simulated chip on a bus with faults."""

    def __init__(self, clock: Callable[[], int], log: Path, who_am_i: int, moving: str) -> None:
        self._log: BinaryIO = log.open("wb")
        self.sim = SimulatedMpu9250(
            motion(moving), clock=clock, who_am_i=who_am_i, log=self._write, seed=11
        )
        self.bus = FaultyBus(self.sim)
        self._errors = self.sim.world.errors

    def _write(self, stamp: int, data: bytes) -> None:
        self._log.write(ROW.pack(stamp, data))

    def obey(self, command: str, value: float) -> bool:
        """Do what a line says; False if it is not for the sensor."""
        if command == "nack":
            self.bus.nacks = int(value)
        elif command in ("stuck", "frozen"):
            setattr(self.bus, command, bool(value))
        elif command == "latency":
            self.bus.latency = value
        elif command == "power":
            self.sim.power_cycle()
        elif command == "magnet":
            self._feel(hard_iron=(value, 0.0, 0.0))
        elif command == "spin":
            self._feel(gyro_bias=(value, 0.0, 0.0))
        elif command == "temperature":
            self._feel(temperature=value)
        elif command == "heal":
            self.sim.world.errors = self._errors
        elif command == "log":
            self._log.flush()
        else:
            return False
        return True

    def _feel(self, **changed: object) -> None:
        self.sim.world.errors = replace(self._errors, **changed)  # type: ignore[arg-type]


def read_log(log: Path) -> list[tuple[int, tuple[int, ...]]]:
    """Stamp and the six axes' counts of each sample that the chip took."""
    data = log.read_bytes()
    data = data[: len(data) // ROW.size * ROW.size]
    rows = []
    for stamp, raw in ROW.iter_unpack(data):
        x, y, z, _, u, v, w = struct.unpack(">7h", raw)
        rows.append((stamp, (x, y, z, u, v, w)))
    return rows
