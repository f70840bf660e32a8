"""Recordings of the simulated chip, read through its registers in virtual time."""

from __future__ import annotations

import numpy as np

from stateful_ahrs.filters.frames import WorldFrame
from stateful_ahrs.mpu9250.chip import Mpu9250, Settings
from stateful_ahrs.mpu9250.motion import motion
from stateful_ahrs.mpu9250.simulator import SimulatedMpu9250, VirtualClock
from stateful_ahrs.mpu9250.world import Errors
from stateful_ahrs.recordings import Recording
from stateful_ahrs.rotor import Rotor, conjugate, product

START = 1_700_000_000_000_000_000  # ns


def simulated(
    name: str, seconds: float, rate: float = 100.0, seed: int = 0, errors: Errors = Errors()
) -> Recording:
    """What the chip measures on the motion of this name, and the truth."""
    clock = VirtualClock(START)
    bus = SimulatedMpu9250(motion(name), clock=clock, seed=seed, errors=errors)
    chip = Mpu9250(bus, Settings(rate=rate), sleep=clock.sleep)
    world = WorldFrame("enu")
    stamps, gyro, accel, mag_stamps, mag, truth = [], [], [], [], [], []
    while len(stamps) < seconds * rate:
        clock.sleep(0.5 / rate)
        reading = chip.read()
        if reading is None:
            continue
        stamps.append(bus.truth.stamp)
        gyro.append(reading.gyro)
        accel.append(reading.accel)
        truth.append(world.update(bus.truth.rotor))
        if reading.mag is not None:
            mag_stamps.append(bus.truth.stamp)
            mag.append(reading.mag)
    return Recording(
        name=name,
        stamps=np.array(stamps),
        gyro=np.array(gyro),
        accel=np.array(accel),
        mag_stamps=np.array(mag_stamps),
        mag=np.array(mag),
        reference_stamps=np.array(stamps),
        reference=np.array(truth),
    )


def nwu(recording: Recording) -> list[Rotor]:
    """The truth of a recording, sensor → earth (NWU)."""
    back = conjugate(WorldFrame("enu").rotor)
    return [product(back, tuple(q)) for q in recording.reference]
