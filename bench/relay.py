"""The floor: a node that hands on the bytes of its samples and does nothing to them.

As anyone would write it with rclpy's EventsExecutor, with the quality of service of fusion.
"""

from __future__ import annotations

from typing import Any

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import Imu, MagneticField

from stateful_ahrs.nodes import life, qos


class Relay(Node):
    """Subscribes to what fusion does."""

    def __init__(self) -> None:
        super().__init__("relay")
        out = self.create_publisher(Imu, "imu/data", qos.PUBLISHER)
        quality = qos.SENSOR_SUBSCRIBER
        self.create_subscription(MagneticField, "imu/mag", _ignore, quality, raw=True)
        self.create_subscription(Imu, "imu/data_raw", out.publish, quality, raw=True)


def _ignore(_: Any) -> None:
    pass


def main() -> None:
    """Run it until ROS ends."""
    with life.graph():
        executor, reason = life.fastest_executor()
        node = Relay()
        node.get_logger().info(f"executor {reason}")
        executor.add_node(node)
        while rclpy.ok():
            executor.spin_once(timeout_sec=1.0)


if __name__ == "__main__":
    main()
