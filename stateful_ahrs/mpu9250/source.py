"""What the driver reads: samples, whatever wire they come over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from .burst import Reading
from .self_test import Axis


class Sample(NamedTuple):
    """A reading, and what its source knows of when it was taken."""

    reading: Reading
    arrival: int  # ns of the host's steady clock: when it was taken, or came, if ``device`` is None
    device: int | None = None  # ns of the device's own clock: when it was taken
    missed: int = 0  # samples taken before this one, after the last, that were lost


@dataclass
class Faults:
    """What went wrong on the wire without losing the device, for /diagnostics."""

    bus_errors: int = 0  # transactions that nobody acknowledged
    fifo_overflows: int = 0
    mag_restarts: int = 0  # the magnetometer had fallen silent
    bytes_discarded: int = 0


class Source(Protocol):
    """Where samples come from. It can be opened again after it was lost."""

    faults: Faults

    def open(self) -> None:
        """Find the device and configure it; `DeviceError` if it cannot be used."""

    def read(self) -> list[Sample]:
        """Wait for samples, not much longer than a period; `DeviceError` if the device is lost."""
        ...

    def self_test(self) -> list[Axis]:
        """Let the device test its axes; `DeviceError` if that fails. It is to be opened anew.

        `UsageError`, with nothing changed, if such a device has no self-test.
        """
        ...

    def close(self) -> None:
        """Release what `open` took; nothing if it is closed."""

    @property
    def rate(self) -> float | None:
        """Samples a second, as configured; None where the device decides."""
        ...

    @property
    def has_magnetometer(self) -> bool:
        """Whether the device has one, as far as is known."""
        ...

    def __str__(self) -> str:
        """The device and the wire, for people."""
        ...
