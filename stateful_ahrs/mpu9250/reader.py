"""One thread that reads a source for ever, whatever happens to the device."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, TimeoutError

from ..errors import DeviceError, UsageError
from .burst import Reading
from .device_clock import DeviceClock, HostClock
from .monitor import Level, Monitor
from .self_test import Axis
from .source import Sample, Source

FIRST_PAUSE, LONGEST_PAUSE = 0.1, 5.0  # s before the device is looked for again, doubled each time
WELL = 1_000_000_000  # ns of samples after which the device counts as found again
TESTING = 5.0  # s that the self-test takes at most
ENDING = 0.5  # s in which a read returns; a bus that hangs longer is left to itself


class Reader(threading.Thread):
    """Calls ``on_reading(reading, stamp)`` for each sample, ``stamp`` in ns of ``now``.

    The source is open. While it is lost, ``lost`` is why, and it is looked for. Stamps are strictly
    in order over all of it.
    """

    def __init__(
        self,
        source: Source,
        on_reading: Callable[[Reading, int], None],
        now: Callable[[], int] = time.time_ns,
        steady: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        super().__init__(name="mpu9250", daemon=True)
        self.lost: DeviceError | None = None
        self._source = source
        self._on_reading = on_reading
        self._steady = steady
        self._monitor = Monitor(source)
        self._device_clock = DeviceClock()
        self._host_clock = HostClock(now, steady)
        self._ending = threading.Event()
        self._pause = FIRST_PAUSE
        self._test: Future[list[Axis]] | None = None  # asked for
        self._back_since: int | None = None  # when the first sample came after a loss

    def run(self) -> None:
        """Read until `end`."""
        while not self._ending.is_set():
            try:
                if self._test is not None:
                    self._run(self._test)
                for sample in self._source.read():
                    self._take(sample)
                self._settle()
            except DeviceError as error:
                if self._ending.is_set():
                    break
                self._lose(error)
                self._reopen()

    def self_test(self) -> list[Axis]:
        """Let the device test itself, between two samples; `DeviceError` if it cannot now."""
        if self.lost is not None:
            raise self.lost
        test: Future[list[Axis]] = Future()
        self._test = test
        try:
            return test.result(TESTING)
        except TimeoutError:
            self._test = None
            raise DeviceError(f"{self._source} has not tested itself for {TESTING:g} s.") from None

    def end(self) -> None:
        """Stop reading and release the device."""
        self._ending.set()
        if self.is_alive():
            self.join(ENDING)
        self._source.close()

    def verdict(self, elapsed: float) -> tuple[Level, str, dict[str, object]]:
        """What /diagnostics shows, over the time (s) since the last call."""
        level, sentence, values = self._monitor.verdict(elapsed, self.lost)
        values["device_clock_drift_ppm"] = self._device_clock.drift * 1e6
        values["device_clock_restarts"] = self._device_clock.restarts
        values["host_clock_steps"] = self._host_clock.steps
        return level, sentence, values

    def _run(self, test: Future[list[Axis]]) -> None:
        """Test the device, and read on where it was left."""
        self._test = None
        try:
            test.set_result(self._source.self_test())
        except UsageError as error:
            test.set_exception(error)
            return
        except DeviceError as error:
            test.set_exception(error)
        self._source.close()
        self._source.open()
        self._device_clock.restart()
        self._monitor.intervals.restart()

    def _take(self, sample: Sample) -> None:
        reading, arrival, device, missed = sample
        self._monitor.see(reading, missed, arrival)
        if self.lost is not None and self._back_since is None:
            self._back_since = arrival
        taken = arrival if device is None else self._device_clock.stamp(device, arrival)
        stamp = self._host_clock.time(taken)
        self._monitor.intervals.add(stamp, missed)
        if not self._ending.is_set():
            self._on_reading(reading, stamp)

    def _settle(self) -> None:
        """A device that was lost and has given samples for a while is well again."""
        if self._back_since is not None and self._steady() - self._back_since > WELL:
            self._pause, self._back_since, self.lost = FIRST_PAUSE, None, None

    def _lose(self, error: DeviceError) -> None:
        if self.lost is None:
            self._monitor.counts.losses += 1
        self.lost = error
        self._back_since = None

    def _reopen(self) -> None:
        """Look for the device until it is there."""
        while True:
            self._source.close()
            if self._ending.wait(self._pause):
                return
            self._pause = min(2.0 * self._pause, LONGEST_PAUSE)
            try:
                self._source.open()
            except DeviceError as error:
                self.lost = error
                continue
            self._device_clock.restart()
            self._monitor.intervals.restart()
            return
