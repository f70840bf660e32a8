"""The simulated chip alone: what reading it a thousand times a second costs, and nothing else.

A line on stdin is for how many seconds; the answer is the number of reads.
"""

from __future__ import annotations

import sys
import time

from stateful_ahrs.mpu9250 import registers as reg
from stateful_ahrs.mpu9250.burst import INERTIAL, MAGNETIC
from stateful_ahrs.mpu9250.chip import Mpu9250, Settings
from stateful_ahrs.mpu9250.motion import motion
from stateful_ahrs.mpu9250.simulator import SimulatedMpu9250

RATE = 1000  # Hz


def main() -> None:
    """Read when stdin says so."""
    bus = SimulatedMpu9250(motion("rest"))
    Mpu9250(bus, Settings(rate=float(RATE)))
    print("ready", flush=True)
    for line in sys.stdin:
        count = round(RATE * float(line))
        begin = time.monotonic()
        for i in range(count):
            bus.read(reg.ADDRESS, reg.INT_STATUS, INERTIAL.size + MAGNETIC.size)
            left = begin + (i + 1) / RATE - time.monotonic()
            if left > 0.0:
                time.sleep(left)
        print(count, flush=True)


if __name__ == "__main__":
    main()
