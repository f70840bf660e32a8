"""A live stream of orientations, judged sample by sample."""

from __future__ import annotations

from ..rotor import IDENTITY, Rotor, Turn, conjugate, difference, dot, product

WAITING = 5000  # stamps without a partner that are remembered


class Tally:
    """What can be said of orientations and their truth as both arrive, in any order.

    Rotors are of unit length, sensor → the same earth frame; stamps in ns pair them.
    """

    def __init__(self) -> None:
        self.samples = 0
        self.sign_flips = 0
        self.largest_step = 0.0  # rad, from one orientation to the next
        self.truths = 0  # whatever their stamps
        self.error: float | None = None  # rad, at the last stamp that both had
        self._first = self._last = 0
        self._start = IDENTITY
        self._turn = Turn()
        self._rotor: Rotor | None = None
        self._orientations: dict[int, Rotor] = {}
        self._truths: dict[int, Rotor] = {}

    def add(self, stamp: int, rotor: Rotor) -> None:
        """Take an orientation."""
        if self._rotor is None:
            self._first, self._start = stamp, rotor
        else:
            self.sign_flips += dot(rotor, self._rotor) < 0.0
            self.largest_step = max(self.largest_step, difference(rotor, self._rotor))
        self._turn.update(product(conjugate(self._start), rotor))
        self.samples += 1
        self._rotor, self._last = rotor, stamp
        self._compare(stamp, rotor, self._orientations, self._truths)

    def add_truth(self, stamp: int, rotor: Rotor) -> None:
        """Take the truth; that of a time before the first orientation has nothing to tell."""
        self.truths += 1
        if self._rotor is not None and stamp >= self._first:
            self._compare(stamp, rotor, self._truths, self._orientations)

    @property
    def turned(self) -> float:
        """The angle (rad) from the first orientation to the last, over any number of turns."""
        return self._turn.angle

    @property
    def rate(self) -> float:
        """Orientations per second of their stamps; 0 before the second."""
        return (
            0.0 if self.samples < 2 else (self.samples - 1) * 1e9 / max(self._last - self._first, 1)
        )

    @property
    def lost(self) -> int:
        """How many truths older than the last orientation have none of their own."""
        return sum(stamp < self._last for stamp in self._truths)

    def _compare(
        self, stamp: int, rotor: Rotor, own: dict[int, Rotor], others: dict[int, Rotor]
    ) -> None:
        other = others.pop(stamp, None)
        if other is not None:
            self.error = difference(rotor, other)
            return
        own[stamp] = rotor
        if len(own) > WAITING:
            del own[next(iter(own))]
