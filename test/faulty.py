"""A bus with the faults that buses have."""

from __future__ import annotations

import time
from collections.abc import Callable

from stateful_ahrs.mpu9250 import registers as reg
from stateful_ahrs.mpu9250.bus import Bus, BusError


class FaultyBus:
    """Hands transactions on to ``bus``, or does to them what a bad one does."""

    def __init__(self, bus: Bus, sleep: Callable[[float], None] = time.sleep) -> None:
        self.bus = bus
        self.sleep = sleep
        self.nacks = 0  # transactions to come that nobody acknowledges
        self.refused: int | None = None  # the register whose next access is not acknowledged
        self.unplugged = False  # nobody acknowledges anything
        self.stuck = False  # the data line stays up: all is 0xFF
        self.frozen = False  # the chip says it has new data, and it is the old
        self.latency = 0.0  # s more for each transaction
        self.transactions = 0
        self.closed = 0
        self._old = b""

    def write(self, address: int, register: int, data: bytes) -> None:
        self._suffer(address, register)
        if not self.stuck:
            self.bus.write(address, register, data)

    def read(self, address: int, register: int, count: int) -> bytes:
        self._suffer(address, register)
        if self.stuck:
            return b"\xff" * count
        data = self.bus.read(address, register, count)
        if register == reg.INT_STATUS and count > 1:
            if self.frozen and self._old:
                return self._old
            if data[0] & reg.RAW_DATA_RDY:
                self._old = data
        return data

    def close(self) -> None:
        self.closed += 1

    def _suffer(self, address: int, register: int) -> None:
        self.transactions += 1
        if self.latency:
            self.sleep(self.latency)
        if self.unplugged or self.nacks or register == self.refused:
            self.refused = None
            self.nacks = max(0, self.nacks - 1)
            raise BusError(f"no device answers at I2C address 0x{address:02X}.")
