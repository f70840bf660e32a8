"""Samples over a serial port, from any board that speaks one of the protocols."""

from __future__ import annotations

import errno
import termios
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..errors import DeviceError, UsageError
from ..words import counted
from .chip import NAMES, SIX_AXES
from .detect import EitherParser, parser
from .self_test import Axis
from .source import Faults, Sample

WAIT = 0.1  # s for a byte
FIRST = 5.0  # s for the first sample: a board that restarts when its port is opened
SILENCE = 1.0  # s between two others


class SerialSource:
    """A board at a serial port; see `Source`. ``steady`` is the host's steady clock, ns."""

    def __init__(
        self,
        port: str,
        baudrate: int,
        protocol: str = "auto",
        steady: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.faults = Faults()
        self._name = port
        self._baudrate = baudrate
        self._protocol = protocol
        self._parser: EitherParser = parser(protocol)
        self._steady = steady
        self._port: Any = None
        self._discarded = 0  # before the port was opened last

    def open(self) -> None:
        """Open the port; its protocol is found out by reading."""
        try:
            import serial  # type: ignore[import-untyped]
        except ModuleNotFoundError:
            raise UsageError(
                "transport serial needs the Python package pyserial: apt install python3-serial, "
                "or pip install 'stateful_ahrs[serial]'."
            ) from None
        try:
            self._port = serial.Serial(self._name, self._baudrate, timeout=WAIT, exclusive=True)
            self._port.reset_input_buffer()
        except (OSError, ValueError, termios.error) as error:  # pyserial's own are OSErrors
            raise self._closed(error) from None
        self._parser = parser(self._protocol)
        self._discarded = self.faults.bytes_discarded
        self._received = 0
        self._patience = FIRST
        self._alive = self._steady()

    def read(self) -> list[Sample]:
        """What has come; within a tenth of a second nothing, if nothing came."""
        try:
            data = self._port.read(self._port.in_waiting or 1)
        except (OSError, TypeError) as error:  # TypeError: the port was closed in between
            raise DeviceError(f"{self._name} is gone ({_reason(error)}). Plug it in.") from None
        arrival = self._steady()
        records = self._parser.feed(data)
        self._received += len(data)
        self.faults.bytes_discarded = self._discarded + self._parser.discarded
        if records:
            self._alive = arrival
            self._received = 0
            self._patience = SILENCE
        elif (arrival - self._alive) * 1e-9 > self._patience:
            raise self._silent()
        return [Sample(r.reading, arrival, r.clock, r.missed) for r in records]

    def self_test(self) -> list[Axis]:
        """None: the board alone speaks to its chip."""
        raise UsageError(
            "a board at a serial port does not let its chip test itself: that needs transport i2c."
        )

    def close(self) -> None:
        """Release the port."""
        if self._port is not None:
            self._port.close()

    @property
    def rate(self) -> None:
        """The board decides."""
        return None

    @property
    def has_magnetometer(self) -> bool:
        """All have one but a bridge with an MPU-6500."""
        return self._parser.who_am_i not in SIX_AXES

    def __str__(self) -> str:
        protocol = self._parser.name or f"protocol {self._protocol}"
        without = "" if self.has_magnetometer else ", no magnetometer"
        return f"{NAMES[self._parser.who_am_i]} at {self._name} ({protocol}{without})"

    def _silent(self) -> DeviceError:
        """Why there are no samples, as far as can be told."""
        if not self._received:
            return DeviceError(
                f"{self._name} sends nothing. Check that the board has power and that its sketch "
                "runs; a Razor that a space has paused needs another."
            )
        if self._parser.complaint:
            return DeviceError(f"{self._name} sends no samples: {self._parser.complaint}")
        return DeviceError(
            f"{self._name} sent {counted(self._received, 'byte')} without a sample in protocol "
            f"{self._protocol}. Check baudrate ({self._baudrate}) and protocol."
        )

    def _closed(self, error: OSError | ValueError | termios.error) -> DeviceError:
        """Why the port cannot be opened, and what to do."""
        code = getattr(error, "errno", None)
        if code == errno.ENOENT:
            others = sorted(str(p) for g in ("ttyACM*", "ttyUSB*") for p in Path("/dev").glob(g))
            return DeviceError(
                f"{self._name}: there is no such port, there is {', '.join(others) or 'none'}. "
                "Plug the board in, or set port."
            )
        if code == errno.EACCES:
            return DeviceError(
                f"{self._name}: permission denied. Add your user to the group dialout "
                "(sudo usermod -aG dialout $USER) and log in again."
            )
        if code in (errno.EAGAIN, errno.EBUSY) or "lock" in str(error):
            return DeviceError(f"{self._name} is in use by another program. End that first.")
        return DeviceError(f"{self._name}: cannot be opened ({_reason(error)}).")


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or " ".join(str(error).split())
