"""The floor: a node that hands on the bytes of its samples and does nothing to them."""

from __future__ import annotations

import sys
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import Imu, MagneticField

from stateful_ahrs.nodes import life, qos


class Relay(Node):
    """Subscribes to what fusion does, with the same quality of service and executor."""

    def __init__(self) -> None:
        super().__init__("relay")
        out = qos.advertise(self, Imu, "imu/data")
        qos.subscribe(self, MagneticField, "imu/mag", _ignore, _ignore, raw=True)
        qos.subscribe(self, Imu, "imu/data_raw", out.publish, _ignore, raw=True)


def _ignore(_: Any) -> None:
    pass


if __name__ == "__main__":
    sys.exit(life.run("relay", Relay, []))
