"""Motions whose attitude and angular rate are known exactly."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..errors import UsageError
from ..rotor import IDENTITY, Rotor, Vector, conjugate, from_axis_angle, product, rotate

X: Vector = (1.0, 0.0, 0.0)
Y: Vector = (0.0, 1.0, 0.0)
Z: Vector = (0.0, 0.0, 1.0)
TURN = 2.0 * math.pi  # rad


@dataclass(frozen=True)
class Turn:
    """A turn about an axis fixed in the sensor, from rest to rest, with a smooth rate."""

    axis: Vector  # unit, sensor frame
    angle: float  # rad
    start: float  # s
    duration: float  # s

    def angle_at(self, t: float) -> float:
        """Angle turned so far, rad."""
        s = self._progress(t)
        return self.angle * (s - math.sin(TURN * s) / TURN)

    def speed_at(self, t: float) -> float:
        """Derivative of the angle, rad/s; at most twice the mean."""
        return self.angle / self.duration * (1.0 - math.cos(TURN * self._progress(t)))

    def _progress(self, t: float) -> float:
        return min(max((t - self.start) / self.duration, 0.0), 1.0)


class Motion:
    """Turns, each on top of those before it, from level and facing north; then rest.

    Turns that overlap in time make an axis that wanders. A motion with a ``period`` (s) begins
    again after it; its turns must have ended by then where they began.
    """

    def __init__(self, *turns: Turn, period: float | None = None) -> None:
        self._turns = turns
        self._period = period

    def rotor(self, t: float) -> Rotor:
        """Attitude at ``t`` s: sensor → earth (NWU), continuous in sign."""
        t = self._phase(t)
        q = IDENTITY
        for turn in self._turns:
            q = product(q, from_axis_angle(turn.axis, turn.angle_at(t)))
        return q

    def rate(self, t: float) -> Vector:
        """Angular rate at ``t`` s in the sensor frame, rad/s: the exact derivative of the rotor."""
        t = self._phase(t)
        rate = (0.0, 0.0, 0.0)
        for turn in self._turns:
            x, y, z = rotate(conjugate(from_axis_angle(turn.axis, turn.angle_at(t))), rate)
            speed = turn.speed_at(t)
            rate = (x + speed * turn.axis[0], y + speed * turn.axis[1], z + speed * turn.axis[2])
        return rate

    def _phase(self, t: float) -> float:
        return t if self._period is None else t % self._period


# Each begins with a second of rest, in which a filter finds north.
MOTIONS = {
    "rest": Motion(),
    # Kusaka & Tanaka's experiment: 8 s of motion
    "turns": Motion(Turn(Y, TURN, 1.0, 4.0), Turn(Z, TURN, 5.0, 4.0)),
    "two_turns": Motion(Turn(Z, 2.0 * TURN, 1.0, 8.0)),
    # for ever: 6.5 s of motion about a wandering axis, 3.5 s of rest
    "tumble": Motion(Turn(Z, TURN, 1.0, 5.0), Turn(Y, TURN, 2.5, 5.0), period=10.0),
    # every direction of the sensor comes up once, in a spiral: for calibration
    "sphere": Motion(Turn(X, TURN, 1.0, 30.0), Turn(Z, 6.0 * TURN, 1.0, 30.0)),
}


def motion(name: str) -> Motion:
    """The motion of this name; `UsageError` if there is none."""
    try:
        return MOTIONS[name]
    except KeyError:
        known = ", ".join(MOTIONS)
        raise UsageError(f"there is no motion {name!r}; known: {known}.") from None
