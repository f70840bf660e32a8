"""Which magnetometer sample belongs to which inertial sample, as they arrive."""

from __future__ import annotations

from bisect import insort

from ..rotor import Vector
from .stamps import LONGEST_STEP, LONGEST_STEP_BACK, SECOND

WAITING = 1000  # magnetometer samples that wait for their time; more are superseded
LATEST = SECOND // 20  # ns: what comes later than this tells another heading


class Pairing:
    """Gives a magnetometer sample to the first inertial sample that is not older (see `pair`).

    The two come over different topics, so either may be first. A magnetometer sample that
    comes just after its inertial sample amends that step instead of waiting for the next.
    """

    def __init__(self) -> None:
        self._waiting: list[tuple[int, Vector]] = []  # by stamp
        self._span = (-1, -1)  # stamps of the last two inertial samples
        self._newest = -1
        self.superseded = 0  # a newer one was there already: never used
        self.late = 0  # its inertial sample was long gone: never used

    def add(self, stamp: int, mag: Vector) -> bool:
        """Take a sample (stamp in ns); True if it belongs to the last inertial sample."""
        if stamp < self._newest - LONGEST_STEP_BACK:
            self._newest = -1  # the stamps jumped back; the inertial ones will, or did
        before, last = self._span
        if before < stamp <= last and stamp > self._newest:
            self.superseded += self._newest > before
            self._newest = stamp
            return True
        if stamp <= self._newest or len(self._waiting) == WAITING:
            self.superseded += 1
            return False
        insort(self._waiting, (stamp, mag))
        return False

    def take(self, stamp: int) -> Vector | None:
        """The newest sample not younger than the inertial sample of this stamp (ns), if new."""
        last = self._span[1]
        self._span = (last, stamp)
        found = None
        while self._waiting and self._waiting[0][0] <= stamp:
            self.superseded += found is not None
            self._newest, found = self._waiting.pop(0)
        if found is not None and self._newest < min(last, stamp - LATEST):
            self.late += 1
            return None
        return found

    def restart(self, stamp: int) -> None:
        """Start anew at this stamp (ns): samples of another time are superseded."""
        near = [kept for kept in self._waiting if abs(kept[0] - stamp) <= LONGEST_STEP]
        self.superseded += len(self._waiting) - len(near)
        self._waiting = near
        self._span = (-1, -1)
        self._newest = -1
