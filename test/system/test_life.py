"""How nodes end."""

import pytest

pytest.importorskip("rclpy")

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import Imu

from stateful_ahrs.nodes import life, qos


def test_a_node_told_to_end_before_it_was_made_ends_well():
    with life.graph():
        node = Node("early")
        rclpy.shutdown()  # as a signal does
        qos.advertise(node, Imu, "imu/data")
        raise AssertionError("what is shut down publishes nothing")


def test_an_error_while_ros_runs_is_not_swallowed():
    with pytest.raises(RuntimeError, match="of its own"), life.graph():
        raise RuntimeError("an error of its own")
