"""Stamps: the clock of a device mapped to the host's, and the host's steady clock to its time."""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

SECOND = 1_000_000_000  # ns
SPAN = SECOND // 4  # of device time, of which the sample with the least delay is kept
FEW = 3  # spans that tell no drift
SPANS = 40  # so many make the line: ten seconds, over which a drift is constant
LATE = SECOND // 2  # by so much later than the line says ...
PATIENCE = SECOND  # ... for so long: the device clock was set back, or stood still
SLEW = 0.1  # of the time that passes: so fast a stamp moves to where it belongs
STEP = SECOND // 10  # if it is further away than this, it goes there at once
TICK = 1_000  # ns, between stamps that would otherwise be the same or in the wrong order


class Point(NamedTuple):
    """When the device says a sample was taken, and when the host had it. ns, both."""

    device: int
    host: int


class DeviceClock:
    """Tells when on the host's steady clock a sample was taken that the device stamped.

    What lies between the two clocks is an offset, a drift and a delay; the delay is never
    negative and sometimes near its least. So the line under all points, and as near to them as
    can be, is the map (Moon, Skelly and Towsley 1999, solved on the hull), but for the least
    delay itself, which nobody can know from one side.
    """

    def __init__(self) -> None:
        self.restarts = 0  # of the map, because the two clocks parted
        self._last = Point(0, 0)  # device time and stamp of the last sample
        self._started = False
        self._begun_anew = True
        self.restart()

    @property
    def drift(self) -> float:
        """How much faster the host's clock runs than the device's, as a fraction."""
        return self._slope

    def restart(self) -> None:
        """Forget the map: the device was away, and its clock may have begun anew."""
        self._least: list[Point] = []
        self._best: Point | None = None  # of the span that runs
        self._span_end = 0
        self._origin: Point | None = None
        self._slope = 0.0
        self._late_since: int | None = None

    def stamp(self, device: int, host: int) -> int:
        """When the sample was taken, ns by the host's steady clock; later than the one before.

        ``device``: ns by the device's clock; ``host``: when it arrived. Samples of one arrival
        share it.
        """
        if self._parted(device, host):
            self.restarts += 1
            self.restart()
        self._learn(Point(device, host))
        target = self._map(device)
        if not self._started:
            self._started = True
            stamp = target
        elif self._begun_anew:
            stamp = max(target, self._last.host + TICK)
        else:
            stamp = self._approach(target, device - self._last.device)
        self._begun_anew = False
        self._last = Point(device, stamp)
        return stamp

    def _map(self, device: int) -> int:
        assert self._origin is not None
        elapsed = device - self._origin.device
        return self._origin.host + elapsed + round(elapsed * self._slope)

    def _parted(self, device: int, host: int) -> bool:
        """Whether the map cannot be right any more."""
        if self._origin is None:
            return False
        if device < self._last.device:
            return True
        delay = host - self._map(device)
        if delay < -LATE:
            return True
        if delay < LATE:
            self._late_since = None
        elif self._late_since is None:
            self._late_since = host
        return self._late_since is not None and host - self._late_since > PATIENCE

    def _learn(self, point: Point) -> None:
        if self._origin is None:
            self._origin = self._best = point
            self._span_end = point.device + SPAN
            self._begun_anew = True
            return
        if point.device >= self._span_end:
            assert self._best is not None
            self._least = [*self._least[1 - SPANS :], self._best]
            self._best = None
            self._span_end = point.device + SPAN
            self._fit()
        if self._best is None or self._delay(point) < self._delay(self._best):
            self._best = point
        if self._delay(point) < 0:  # nothing arrives before it was sent: the line is too high
            self._origin = point

    def _delay(self, point: Point) -> int:
        return point.host - self._map(point.device)

    def _fit(self) -> None:
        """Lay the line along that side of the lower hull that is under the middle of the points."""
        if len(self._least) < FEW:
            return
        hull: list[Point] = []
        for point in self._least:
            while len(hull) > 1 and not _left(hull[-2], hull[-1], point):
                hull.pop()
            hull.append(point)
        middle = sum(point.device for point in self._least) // len(self._least)
        for a, b in pairwise(hull):
            if b.device >= middle:
                self._origin = a
                self._slope = (b.host - a.host) / (b.device - a.device) - 1.0
                return

    def _approach(self, target: int, elapsed: int) -> int:
        """From the last stamp towards the target; intervals stay within 10 % of the device's."""
        last = self._last.host
        error = target - (last + elapsed)
        if error > STEP:
            return target
        limit = round(SLEW * elapsed)
        if error < -STEP:
            limit = elapsed - TICK  # too far ahead for slewing: wait, but never go back
        return max(last + elapsed + min(max(error, -limit), limit), last + TICK)


def _left(a: Point, b: Point, c: Point) -> bool:
    """Whether the way from a over b to c turns up."""
    return (b.device - a.device) * (c.host - a.host) > (b.host - a.host) * (c.device - a.device)


class HostClock:
    """Turns the steady clock into the host's time, in ns.

    The time may be set while a driver runs: stamps follow it, and `steps` counts it. In between
    they are strictly in order.
    """

    def __init__(
        self,
        now: Callable[[], int] = time.time_ns,
        steady: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.steps = 0  # times that the clock was set
        self._now = now
        self._steady = steady
        self._offset = self._measured()
        self._checked = steady()
        self._last = 0

    def time(self, steady: int) -> int:
        """The time at ``steady``, later than the last that was asked for."""
        if self._steady() - self._checked > SECOND:
            offset = self._measured()
            if abs(offset - self._offset) > STEP:
                self.steps += 1
                self._last = 0
            self._offset = offset
            self._checked = self._steady()
        self._last = max(steady + self._offset, self._last + TICK)
        return self._last

    def _measured(self) -> int:
        """Time less steady time, of three tries the one that was interrupted least."""
        tries = []
        for _ in range(3):
            before, now, after = self._steady(), self._now(), self._steady()
            tries.append((after - before, now - (before + after) // 2))
        return min(tries)[1]
