"""Recordings of the simulated chip by the name of its motion, and their truth."""

from __future__ import annotations

from stateful_ahrs.evaluation.reproduction import simulated as recordings
from stateful_ahrs.filters.frames import WorldFrame
from stateful_ahrs.mpu9250.motion import motion
from stateful_ahrs.mpu9250.world import Errors
from stateful_ahrs.recordings import Recording
from stateful_ahrs.rotor import Rotor, conjugate, product

START = recordings.START


def simulated(
    name: str, seconds: float, rate: float = 100.0, seed: int = 0, errors: Errors = Errors()
) -> Recording:
    """What the chip measures on the motion of this name, and the truth."""
    return recordings.simulated(motion(name), seconds, rate, seed, errors, name)


def nwu(recording: Recording) -> list[Rotor]:
    """The truth of a recording, sensor → earth (NWU)."""
    back = conjugate(WorldFrame("enu").rotor)
    return [product(back, tuple(q)) for q in recording.reference]
