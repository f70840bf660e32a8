"""Recordings of the simulated chip, read through its registers in virtual time."""

from __future__ import annotations

import numpy as np

from ...filters.frames import WorldFrame
from ...mpu9250.chip import Mpu9250, Settings
from ...mpu9250.motion import Motion
from ...mpu9250.simulator import SimulatedMpu9250, VirtualClock
from ...mpu9250.world import Errors
from ...recordings import Recording

START = 1_700_000_000_000_000_000  # ns


def simulated(
    motion: Motion,
    seconds: float,
    rate: float = 100.0,
    seed: int = 0,
    errors: Errors = Errors(),
    name: str = "simulated",
) -> Recording:
    """What the chip measures on a motion, and the truth."""
    clock = VirtualClock(START)
    bus = SimulatedMpu9250(motion, clock=clock, seed=seed, errors=errors)
    chip = Mpu9250(bus, Settings(rate=rate), sleep=clock.sleep)
    world = WorldFrame("enu")
    stamps: list[int] = []
    gyro, accel, mag_stamps, mag, truth = [], [], [], [], []
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
