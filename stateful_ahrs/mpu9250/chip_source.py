"""Samples of a chip on a bus, each read once and soon, or in groups from its FIFO."""

from __future__ import annotations

import time
from collections.abc import Callable

from ..errors import DeviceError
from ..rotor import Vector
from . import registers as reg
from .burst import Reading
from .bus import Bus, BusError
from .chip import MagnetometerError, Mpu9250, Settings
from .self_test import Axis, self_test
from .source import Faults, Sample

EARLY = 0.1  # of the period: poll from so long before the next sample is expected ...
POLL = 0.02  # ... at such intervals, which bound the error of the stamp
SILENCE = 200_000_000  # ns, and two periods: a chip that gives no sample for longer is lost
DRAIN = 4_000_000  # ns between two looks into the FIFO, which holds 23 ms at 1 kHz
TRIES = 3  # so many errors of the bus in a row are a loss
CHECK = 1_000_000_000  # ns between two looks at the configuration
MAG_SILENCE = 2_000_000_000  # ns; a magnetometer that is silent for longer is started anew ...
MAG_PATIENCE = 300_000_000_000  # ns, the longest: ... after twice the time at each further try


class ChipSource:
    """An MPU-9250 on the bus that ``open_bus`` opens; see `Source`.

    ``sleep`` (s) and ``steady`` (ns) are the clock of the bus where it is simulated in a time of
    its own. ``where`` names the wire for people.
    """

    def __init__(
        self,
        open_bus: Callable[[], Bus],
        settings: Settings = Settings(),
        address: int = reg.ADDRESS,
        where: str = "",
        sleep: Callable[[float], None] = time.sleep,
        steady: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.faults = Faults()
        self.settings = settings
        self._open_bus = open_bus
        self._address = address
        self._where = where
        self._sleep = sleep
        self._steady = steady
        self._period = settings.divisor * 1_000_000  # ns
        self._chip: Mpu9250 | None = None

    def open(self) -> None:
        """Open the bus, identify and configure the chip.

        Its magnetometer may fail only once it has been there: then the others go on.
        """
        bus = self._open_bus()
        try:
            try:
                chip = Mpu9250(bus, self.settings, self._address, self._sleep)
            except MagnetometerError:
                if self._chip is None:
                    raise
                chip = Mpu9250(bus, self.settings, self._address, self._sleep, magnetometer=False)
            self._chip = chip
        except DeviceError:
            bus.close()
            raise
        self._begin()
        self._mag_patience = MAG_SILENCE

    def _begin(self) -> None:
        """Nothing has been read yet."""
        now = self._steady()
        self._taken: int | None = None  # when the last sample was taken
        self._alive = self._checked = now
        self._errors = 0
        self._index = 0  # of the next sample in the FIFO
        self._gap = 0  # samples lost since the last
        self._mag: Vector | None = None
        self._without_mag = 0  # samples since the last measurement

    def self_test(self) -> list[Axis]:
        """The chip's own test, on a bus of its own."""
        self.close()
        bus = self._open_bus()
        try:
            return self_test(bus, self._address, self._sleep)
        finally:
            bus.close()

    def close(self) -> None:
        """Release the bus."""
        if self._chip is not None:
            self._chip.close()

    @property
    def rate(self) -> float:
        """Hz, as configured."""
        return 1e9 / self._period

    @property
    def has_magnetometer(self) -> bool:
        """Whether the chip has one; so it is supposed before it is identified."""
        return self._chip is None or self._chip.has_magnetometer

    def __str__(self) -> str:
        return f"{self._chip or 'MPU-9250'}{f' on {self._where}' if self._where else ''}"

    def read(self) -> list[Sample]:
        """One sample, or those in the FIFO; none if the bus failed and may recover."""
        chip = self._chip
        assert chip is not None, "not open"
        try:
            now = self._steady()
            if now - self._checked > CHECK:
                self._checked = now
                chip.check()
                self._watch_magnetometer(chip)
            samples = self._drain(chip) if self.settings.fifo else self._poll(chip)
        except BusError as error:
            self._recover(error)
            return []
        self._errors = 0
        return samples

    def _poll(self, chip: Mpu9250) -> list[Sample]:
        """The next sample, soon after it was taken."""
        period = self._period
        if self._taken is not None:
            self._sleep_until(self._taken + period - round(EARLY * period))
        empty: int | None = None
        while True:
            before = self._steady()
            reading = chip.read()
            if reading is not None:
                break
            empty = before
            self._expect(before)
            self._sleep(POLL * period * 1e-9)
        self._alive = before
        reading = self._unrepeated(reading)
        earliest = before - period if empty is None else empty  # it was taken after this
        last, self._taken = self._taken, before
        if last is None:
            return [Sample(reading, before)]
        # Periods since the last: of a time known well the nearest number, else those completed.
        known = 1.0 - (before - earliest) / period
        steps = max(1, int((before - last) / period + max(0.5 * known, POLL)))
        self._taken = min(max(last + steps * period, earliest), before)
        return [Sample(reading, self._taken, None, steps - 1)]

    def _drain(self, chip: Mpu9250) -> list[Sample]:
        """What the FIFO has collected. Its clock is the number of the sample."""
        if self._taken is not None:
            self._sleep_until(self._taken + max(self._period, DRAIN))
        before = self._steady()
        readings, overflowed = chip.drain()
        if overflowed:
            emptied = self._steady()
            if self._taken is not None:  # before the first it only had no reader yet
                lost = max(1, round((emptied - self._alive) / self._period))
                self.faults.fifo_overflows += 1
                self._gap += lost
                self._index += lost
            self._alive = emptied
        if not readings:
            self._expect(before)
            if self._taken is None:
                self._sleep(POLL * self._period * 1e-9)
            else:
                self._taken = before
            return []
        self._taken = self._alive = before
        samples = []
        for reading in readings:
            reading = self._unrepeated(reading)
            samples.append(Sample(reading, before, self._index * self._period, self._gap))
            self._index += 1
            self._gap = 0
        return samples

    def _unrepeated(self, reading: Reading) -> Reading:
        """The reading without its magnetometer if that gave the very same as before.

        A stopped auxiliary master leaves the last measurement in the registers, marked as new. A
        live one repeats itself on three axes once in 2000 times: its noise is four counts.
        """
        self._without_mag += 1
        if reading.mag is not None and reading.mag == self._mag:
            return reading._replace(mag=None)
        if reading.mag is not None or reading.mag_overflow:
            self._mag = reading.mag
            self._without_mag = 0
        return reading

    def _expect(self, now: int) -> None:
        """Raise `DeviceError` if a sample is overdue."""
        silence = now - self._alive
        if silence > SILENCE + 2 * self._period:
            raise DeviceError(
                f"{self} answers, but has taken no sample for {silence * 1e-9:.2f} s. "
                "Check its supply."
            )

    def _watch_magnetometer(self, chip: Mpu9250) -> None:
        """Configure the chip anew if its magnetometer has fallen silent, ever less often."""
        silence = self._without_mag * self._period
        if not chip.has_magnetometer or silence < self._mag_patience:
            return
        self._mag_patience = min(2 * self._mag_patience, MAG_PATIENCE)
        self.faults.mag_restarts += 1
        last, index = self._alive, self._index
        try:
            chip.configure()
        except MagnetometerError:
            chip.configure(magnetometer=False)
        self._begin()
        if self.settings.fifo:
            self._gap = round((self._alive - last) / self._period)
            self._index = index + self._gap
        else:
            self._taken = last

    def _recover(self, error: BusError) -> None:
        """Leave the bus a moment; raise the error if it is not the first in a row."""
        self.faults.bus_errors += 1
        self._errors += 1
        if self._errors >= TRIES:
            raise error
        self._sleep(min(self._period * 1e-9, 1e-3))

    def _sleep_until(self, due: int) -> None:
        left = due - self._steady()
        if left > 0:
            self._sleep(left * 1e-9)
