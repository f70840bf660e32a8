"""One blocking thread that reads every sample of a chip once, soon after it is there."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from ..errors import DeviceError
from .burst import Reading
from .chip import Mpu9250

EARLY = 0.1  # of the period: poll from so long before the next sample is expected ...
POLL = 0.02  # ... at such intervals, which bounds the error of the stamp


@dataclass
class Counts:
    """What became of the samples, for /diagnostics."""

    samples: int = 0
    missed: int = 0  # taken by the chip, overwritten before they were read
    mag_samples: int = 0
    mag_overflows: int = 0
    saturated: int = 0


class Reader(threading.Thread):
    """Calls ``on_reading(reading, stamp)`` for each sample, ``stamp`` in ns of ``clock``.

    ``on_lost`` gets the `DeviceError` that ends the thread.
    """

    def __init__(
        self,
        chip: Mpu9250,
        on_reading: Callable[[Reading, int], None],
        on_lost: Callable[[DeviceError], None],
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        super().__init__(name="mpu9250", daemon=True)
        self.counts = Counts()
        self._chip = chip
        self._on_reading = on_reading
        self._on_lost = on_lost
        self._clock = clock
        self._ending = threading.Event()

    def run(self) -> None:
        """Read until `end`."""
        period = self._chip.settings.divisor * 1e-3
        last = time.monotonic()
        try:
            while not self._ending.wait(last + (1.0 - EARLY) * period - time.monotonic()):
                while (reading := self._chip.read()) is None:
                    time.sleep(POLL * period)
                    if self._ending.is_set():
                        return
                stamp, now = self._clock(), time.monotonic()
                if self.counts.samples:
                    self.counts.missed += max(0, round((now - last) / period) - 1)
                last = now
                self._count(reading)
                self._on_reading(reading, stamp)
        except DeviceError as error:
            self._on_lost(error)

    def end(self) -> None:
        """Stop reading and release the bus."""
        self._ending.set()
        if self.is_alive():
            self.join()
        self._chip.close()

    def _count(self, reading: Reading) -> None:
        counts = self.counts
        counts.samples += 1
        counts.mag_samples += reading.mag is not None
        counts.mag_overflows += reading.mag_overflow
        counts.saturated += bool(reading.saturated)
