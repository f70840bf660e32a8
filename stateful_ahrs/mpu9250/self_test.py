"""The chip's own self-test (InvenSense AN-MPU-9250A-03), at rest.

On request the chip pushes each mass with a known electrostatic force. How far the output moves,
against how far it moved in the factory, tells whether the axis works.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import NamedTuple

from ..errors import DeviceError
from ..filters.rest import LARGEST
from ..rotor import Vector, minus
from . import registers as reg
from .burst import AXES, FULL_SCALE, STANDARD_GRAVITY, Reading
from .bus import Bus
from .chip import Mpu9250, Settings

SAMPLES = 200
SETTINGS = Settings(rate=1000.0, gyro_range=250, accel_range=2, dlpf=2)
SETTLING = 0.02  # s after the force is switched
POLL = 2e-4  # s
PATIENCE = 1.0  # s of waiting for samples; they take 0.2
STILL = (math.radians(3.0), 0.5)  # rad/s and m/s², between the largest and the mean at rest
MOVED = "the sensor moved during its self-test: keep it still and try again."

TRIM = 2620.0  # counts for code 1; each further one 1 % more
GYRO_SCALE = math.radians(SETTINGS.gyro_range) / FULL_SCALE
ACCEL_SCALE = SETTINGS.accel_range * STANDARD_GRAVITY / FULL_SCALE
ACCEL_RATIO = (0.5, 1.5)
GYRO_RATIO = (0.5, math.inf)
# A chip without a factory trim is judged by the response itself.
ACCEL_RESPONSE = (0.225 * STANDARD_GRAVITY, 0.675 * STANDARD_GRAVITY)  # m/s²
GYRO_RESPONSE = (math.radians(60.0), math.inf)  # rad/s


class Axis(NamedTuple):
    """How one axis answered."""

    name: str  # such as "gyro x"
    passed: bool
    response: float  # rad/s or m/s²
    ratio: float | None  # of the factory's response; None where the chip holds none

    def __str__(self) -> str:
        verdict = "pass" if self.passed else "FAIL"
        if self.ratio is not None:
            return f"{self.name}: {verdict}, {self.ratio:.2f} of the factory's response"
        if self.name.startswith("gyro"):
            return f"{self.name}: {verdict}, response {math.degrees(self.response):.0f} °/s"
        return f"{self.name}: {verdict}, response {self.response / STANDARD_GRAVITY:.2f} g"


def self_test(
    bus: Bus, address: int = reg.ADDRESS, sleep: Callable[[float], None] = time.sleep
) -> list[Axis]:
    """Test the six axes of a chip at rest; a second. The chip is to be configured anew afterwards.

    Accelerometer first. `DeviceError` if the chip is not there, is silent, or was moved.
    """
    chip = Mpu9250(bus, SETTINGS, address, sleep, magnetometer=False)
    codes = bus.read(address, reg.SELF_TEST_ACCEL, 3) + bus.read(address, reg.SELF_TEST_GYRO, 3)
    sleep(SETTLING)
    at_rest = _mean(chip, sleep)
    if max(map(abs, at_rest[1])) > LARGEST:
        raise DeviceError(MOVED)
    for register in (reg.ACCEL_CONFIG, reg.GYRO_CONFIG):
        bus.write(address, register, bytes((reg.SELF_TEST_XYZ,)))  # ranges ±2 g and ±250 °/s
    sleep(SETTLING)
    try:
        pushed = _mean(chip, sleep)
    finally:
        for register in (reg.ACCEL_CONFIG, reg.GYRO_CONFIG):
            bus.write(address, register, b"\0")
    accel, gyro = (minus(after, before) for after, before in zip(pushed, at_rest, strict=True))
    return [
        _judged(name, response, code)
        for name, response, code in zip(AXES, (*accel, *gyro), codes, strict=True)
    ]


def _mean(chip: Mpu9250, sleep: Callable[[float], None]) -> tuple[Vector, Vector]:
    """Mean specific force and rates of the next samples."""
    readings: list[Reading] = []
    polls = PATIENCE / POLL
    while len(readings) < SAMPLES:
        reading = chip.read()
        if reading is not None:
            readings.append(reading)
            continue
        polls -= 1
        if polls < 0:
            raise DeviceError(
                f"{chip} gave {len(readings)} samples, expected {SAMPLES}. Check its supply."
            )
        sleep(POLL)
    accel = _still([reading.accel for reading in readings], STILL[1])
    return accel, _still([reading.gyro for reading in readings], STILL[0])


def _still(vectors: list[Vector], limit: float) -> Vector:
    x, y, z = (sum(parts) / len(vectors) for parts in zip(*vectors, strict=True))
    furthest = max(max(map(abs, minus(vector, (x, y, z)))) for vector in vectors)
    if furthest > limit:
        raise DeviceError(MOVED)
    return (x, y, z)


def _judged(name: str, response: float, code: int) -> Axis:
    is_gyro = name.startswith("gyro")
    if code:
        scale = GYRO_SCALE if is_gyro else ACCEL_SCALE
        ratio = response / (scale * TRIM * 1.01 ** (code - 1))
        low, high = GYRO_RATIO if is_gyro else ACCEL_RATIO
        return Axis(name, low < ratio < high, response, ratio)
    low, high = GYRO_RESPONSE if is_gyro else ACCEL_RESPONSE
    return Axis(name, low <= abs(response) <= high, response, None)
