"""What became of the samples, and whether the sensor is well: for /diagnostics."""

from __future__ import annotations

import enum
import math
from dataclasses import asdict, dataclass

from ..errors import DeviceError
from ..words import counted
from .burst import Reading
from .source import Source

FROZEN_TIME = 250_000_000  # ns; the noise of a live sensor never repeats for so long ...
FROZEN_SAMPLES = 20  # ... and over so many samples
COLDEST, HOTTEST = -40.0, 105.0  # °C: where the chip works, and what self-heating adds
SLOW = 0.9  # of the rate


class Level(enum.IntEnum):
    """As in diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass
class Counts:
    """What became of the samples since the start."""

    samples: int = 0
    missed: int = 0  # taken by the chip, but lost before they were read
    mag_samples: int = 0
    mag_overflows: int = 0
    saturated: int = 0
    frozen: int = 0  # times that the same counts came for too long
    temperature_implausible: int = 0
    losses: int = 0  # times that the device was lost


class Intervals:
    """How even the stamps are: the deviation of the steps between samples from their mean."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._steps: list[int] = []

    def add(self, stamp: int, missed: int) -> None:
        """The stamp of a sample, ns; a step over missing ones tells nothing."""
        if self._last is not None and not missed:
            self._steps.append(stamp - self._last)
        self._last = stamp

    def restart(self) -> None:
        """What comes next is no step from the last."""
        self._last = None

    def take(self) -> tuple[float, float]:
        """Deviation, rms and largest, s, of the steps since the last call."""
        steps, self._steps = self._steps, []
        if not steps:
            return 0.0, 0.0
        mean = sum(steps) / len(steps)
        deviations = [step - mean for step in steps]
        rms = math.sqrt(sum(d * d for d in deviations) / len(steps))
        return rms * 1e-9, max(map(abs, deviations)) * 1e-9


class Monitor:
    """Sees every reading; says once a second what it thinks of them."""

    def __init__(self, source: Source) -> None:
        self.counts = Counts()
        self.intervals = Intervals()
        self._source = source
        self._before: dict[str, int] = {}
        self._live: Reading | None = None  # the first of those that are all the same
        self._live_since = 0
        self._repeated = 0
        self._saturated: tuple[str, ...] = ()
        self._temperature = math.nan

    def see(self, reading: Reading, missed: int, now: int) -> None:
        """Count a reading that came at ``now`` (ns, steady); `DeviceError` if it is frozen."""
        counts = self.counts
        counts.samples += 1
        counts.missed += missed
        if counts.samples == 1:  # whoever opens a port meets a stream in the midst of a sample
            self._before["bytes_discarded"] = self._source.faults.bytes_discarded
        self._watch(reading, now)
        counts.mag_samples += reading.mag is not None
        counts.mag_overflows += reading.mag_overflow
        if reading.saturated:
            counts.saturated += 1
            self._saturated = reading.saturated
        self._temperature = reading.temperature
        if not (COLDEST <= reading.temperature <= HOTTEST or math.isnan(reading.temperature)):
            counts.temperature_implausible += 1

    def _watch(self, reading: Reading, now: int) -> None:
        live = self._live
        if (
            live is None
            or reading.accel != live.accel
            or reading.gyro != live.gyro
            or (reading.mag is not None and reading.mag != live.mag)
        ):
            self._live, self._live_since, self._repeated = reading, now, 0
            return
        self._repeated += 1
        if self._repeated >= FROZEN_SAMPLES and now - self._live_since > FROZEN_TIME:
            self.counts.frozen += 1
            raise DeviceError(
                f"{self._source} gives the same counts again and again. If that stays, switch it "
                "off and on."
            )

    def verdict(
        self, elapsed: float, lost: DeviceError | None
    ) -> tuple[Level, str, dict[str, object]]:
        """Level, one sentence, and values, over the time (s) since the last call."""
        source = self._source
        totals = {**asdict(self.counts), **asdict(source.faults)}
        since = {name: n - self._before.get(name, 0) for name, n in totals.items()}
        self._before = totals
        rms, largest = self.intervals.take()
        values: dict[str, object] = {
            "device": str(source),
            "imu_rate_hz": since["samples"] / elapsed,
            "mag_rate_hz": since["mag_samples"] / elapsed,
            "temperature_c": self._temperature,
            "stamp_jitter_ms": rms * 1e3,
            "stamp_jitter_largest_ms": largest * 1e3,
            **totals,
        }
        if lost is not None:
            return Level.ERROR, str(lost), values
        complaint = self._complaint(since, elapsed)
        if complaint:
            return Level.WARN, complaint, values
        return Level.OK, f"{source}: {since['samples'] / elapsed:.0f} Hz.", values

    def _complaint(self, since: dict[str, int], elapsed: float) -> str:
        """The worst of what happened, or ""."""
        rate, n = self._source.rate, since["samples"]
        missed = ""
        if since["missed"]:
            missed = f" {counted(since['missed'], 'sample is', 'samples are')} missing."
        if since["bytes_discarded"]:
            bytes_were = ("byte was no sample and was", "bytes were no samples and were")
            return f"{counted(since['bytes_discarded'], *bytes_were)} discarded.{missed}"
        if since["bus_errors"]:
            return f"{counted(since['bus_errors'], 'transaction')} failed: check the wires.{missed}"
        if since["fifo_overflows"]:
            times = counted(since["fifo_overflows"], "time")
            return f"The FIFO overflowed {times}: too busy.{missed}"
        if missed:
            they_were = ("sample was lost before it was", "samples were lost before they were")
            remedy = "" if rate is None else " Set fifo to true."
            return f"{counted(since['missed'], *they_were)} read.{remedy}"
        if not n:
            return "No samples."
        if rate is not None and n + 1 < SLOW * rate * elapsed:
            return f"{n / elapsed:.1f} samples a second, expected {rate:g}."
        if since["temperature_implausible"]:
            return f"A temperature of {self._temperature:.0f} °C is not plausible."
        if since["saturated"]:
            axes = ", ".join(self._saturated)
            samples = counted(since["saturated"], "sample")
            return f"{samples} saturated ({axes}): choose a larger range."
        if since["mag_overflows"]:
            samples = counted(since["mag_overflows"], "magnetometer sample")
            return f"{samples} overflowed: a magnet is too near."
        if not since["mag_samples"] and self._source.has_magnetometer:
            return "The magnetometer gives no samples."
        return ""
