"""Publishes samples of a resting sensor at a rate, to one namespace or several, as it is told.

A line of JSON on stdin is a job: {"to": [namespaces], "rate": Hz, "seconds": s}; the answer is how
many samples each got. Stamps go on from job to job as if no time had passed in between; when a
sample was sent (steady clock, ns) is the last element of its gyroscope's covariance.
"""

from __future__ import annotations

import ctypes
import json
import random
import sys
import time
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Imu, MagneticField

from stateful_ahrs.nodes import cdr

MAG_RATE = 100.0  # Hz, or the rate of the samples if that is lower
START = 1_000_000_000_000_000_000  # ns
DIFFERENT = 1009  # samples, then the same again
PR_SET_TIMERSLACK = 29
DEPTH = QoSProfile(depth=1000)


class Source(Node):
    """Publishers for all namespaces."""

    def __init__(self, namespaces: list[str]) -> None:
        super().__init__("source", start_parameter_services=False)
        self._imu = {n: self._speak(Imu, f"/{n}/imu/data_raw") for n in namespaces}
        self._mag = {n: self._speak(MagneticField, f"/{n}/imu/mag") for n in namespaces}
        self._stamps = dict.fromkeys(namespaces, START)
        gauss = random.Random(1).gauss
        self._frame = cdr.frame("imu_link")
        self._samples = [
            (
                (gauss(0.0, 0.002), gauss(0.0, 0.002), gauss(0.0, 0.002)),
                (gauss(0.0, 0.08), gauss(0.0, 0.08), gauss(9.81, 0.08)),
                (gauss(20e-6, 6e-7), gauss(0.0, 6e-7), gauss(-40e-6, 6e-7)),
            )
            for _ in range(DIFFERENT)
        ]

    def _speak(self, kind: type, topic: str) -> Any:
        return self.create_publisher(kind, topic, DEPTH).publish

    def run(self, to: list[str], rate: float, seconds: float) -> int:
        """Publish; the samples that each of ``to`` got."""
        count, period = round(rate * seconds), round(1e9 / rate)
        mag_every = max(1, round(rate / MAG_RATE))
        frame, unknown, zeros = self._frame, cdr.covariance([-1.0] + [0.0] * 8), bytes(72)
        begin = time.monotonic_ns()
        for i in range(count):
            left = begin + i * period - time.monotonic_ns()
            if left > 0:
                time.sleep(left * 1e-9)
            gyro, accel, mag = self._samples[i % DIFFERENT]
            for n in to:
                self._stamps[n] = stamp = self._stamps[n] + period
                if i % mag_every == 0:
                    self._mag[n](cdr.magnetic_field(stamp, frame, mag, zeros))
                sent = zeros[8:] + cdr.NUMBER.pack(b"", float(time.monotonic_ns()))[4:]
                self._imu[n](
                    cdr.imu(stamp, frame, (1.0, 0.0, 0.0, 0.0), unknown, gyro, sent, accel, zeros)
                )
        return count


def main() -> None:
    """Do what stdin says until it ends."""
    ctypes.CDLL(None).prctl(PR_SET_TIMERSLACK, 1)  # ns: sleep as long as is asked, not longer
    rclpy.init()
    source = Source(sys.argv[1:])
    print("ready", flush=True)
    for line in sys.stdin:
        print(source.run(**json.loads(line)), flush=True)


if __name__ == "__main__":
    main()
