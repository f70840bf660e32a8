"""What a chip needs of the wire to it."""

from __future__ import annotations

from typing import Protocol

from ..errors import DeviceError


class BusError(DeviceError):
    """One transaction failed; the next may succeed."""


class Bus(Protocol):
    """A bus of devices with addresses, each with 8-bit registers that count up in a burst.

    Each call is one transaction; `BusError` where it fails, as where nobody acknowledges it.
    """

    def write(self, address: int, register: int, data: bytes) -> None:
        """Write ``data`` into the registers from ``register`` on."""

    def read(self, address: int, register: int, count: int) -> bytes:
        """Return exactly ``count`` bytes of the registers from ``register`` on."""
        ...

    def close(self) -> None:
        """Release the bus."""
