"""Stamps → time steps: what to do when time stands still, jumps, or is missing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SECOND = 1_000_000_000  # ns
LONGEST_STEP = SECOND  # a longer gap cannot be bridged by the last rate: start anew
LONGEST_STEP_BACK = SECOND // 10  # late samples and clock corrections; a longer one is a restart
ZEROS_BEFORE_ARRIVAL = 10  # so many zero stamps in a row: the sender does not stamp


@dataclass
class Counts:
    """What the stamps did since the start, for /diagnostics."""

    duplicate: int = 0  # skipped
    out_of_order: int = 0  # skipped
    zero: int = 0  # skipped, or the time of arrival taken instead
    gaps: int = 0  # started anew
    jumps_back: int = 0  # started anew
    clock_jumps: int = 0  # the clock itself went back


class StampGate:
    """Turns the stamp of each sample into the step since the last.

    ``news`` is what was wrong with the last stamp, as (kind, sentence), or None.
    """

    def __init__(self) -> None:
        self.counts = Counts()
        self.news: tuple[str, str] | None = None
        self.last = 0  # ns: the stamp of the last sample used, or its time of arrival
        self._started = False
        self._zeros = 0
        self._by_arrival = False
        self._jumped_at: int | None = None  # the last stamp before the clock went back
        self._steady = False  # nothing of the above, as nearly always

    def step(self, stamp: int, arrival: int = 0) -> float | None:
        """Seconds since the last sample; 0 to start anew from this one; None to skip it.

        ``stamp`` in ns; ``arrival`` (ns) serves in its place when the sender does not stamp.
        """
        step = stamp - self.last
        if self._steady and 0 < step <= LONGEST_STEP:
            self.last = stamp
            return step * 1e-9
        self.news = None
        self._steady = False
        if stamp == 0:
            self.counts.zero += 1
            self._zeros += 1
            if self._started and not self._by_arrival and self._zeros < ZEROS_BEFORE_ARRIVAL:
                self.news = ("zero", "An IMU sample without a stamp among stamped ones is skipped.")
                return None
            self.news = ("arrival", "IMU samples have no stamp: the time of arrival is taken.")
            self._started = self._started and self._by_arrival
            self._by_arrival = True
            stamp = arrival
        else:
            self._zeros = 0
            self._started = self._started and not self._by_arrival
            self._by_arrival = False
        step = stamp - self.last
        if self._jumped_at is not None and stamp > self._jumped_at + LONGEST_STEP:
            self._jumped_at = None  # the stamps do not follow that clock
        if not self._started:
            self._started = True
        elif 0 < step <= LONGEST_STEP:
            self.last = stamp
            self._steady = self._zeros == 0 and self._jumped_at is None
            return step * 1e-9
        elif step == 0:
            self.counts.duplicate += 1
            self.news = ("duplicate", "An IMU sample with the stamp of the last one is skipped.")
            return None
        elif step > 0:
            self.counts.gaps += 1
            self.news = ("gap", f"IMU stamps jump ahead by {step * 1e-9:.3f} s: starting anew.")
        elif step < -LONGEST_STEP_BACK or self._jumped_at is not None:
            self._jumped_at = None
            self.counts.jumps_back += 1
            self.news = ("back", f"IMU stamps jump back by {-step * 1e-9:.3f} s: starting anew.")
        else:
            self.counts.out_of_order += 1
            self.news = (
                "order",
                f"An IMU sample is {-step * 1e-9:.3f} s older than the last: skipped.",
            )
            return None
        self.last = stamp
        return 0.0

    def clock_jumped(self) -> None:
        """The clock went back: so will the stamps, and then even by little it is a restart."""
        self.counts.clock_jumps += 1
        self._jumped_at = self.last
        self._steady = False


def steps(stamps: NDArray[np.int64]) -> NDArray[np.float64]:
    """The steps of a whole recording in s: 0 where a filter starts anew, NaN where it skips."""
    if len(stamps) > 1 and stamps[0] > 0:
        steps = np.empty(len(stamps))
        steps[0] = 0.0
        since = np.subtract(stamps[1:], stamps[:-1], out=steps[1:])
        if since.min() > 0 and since.max() <= LONGEST_STEP:
            since *= 1e-9
            return steps
    gate = StampGate()
    found = [gate.step(stamp) for stamp in stamps.tolist()]
    return np.array([np.nan if step is None else step for step in found], dtype=float)
