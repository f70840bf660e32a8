"""The launch file starts driver and fusion; skipped where ROS's launch_pytest is not installed."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
import rclpy
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.wait_for_message import wait_for_message
from sensor_msgs.msg import Imu

launch_pytest = pytest.importorskip("launch_pytest")
launch = pytest.importorskip("launch")

LAUNCH_FILE = Path(__file__).parents[2] / "launch" / "imu.launch.py"


@pytest.fixture(autouse=True)
def domain(monkeypatch: pytest.MonkeyPatch) -> None:
    """A graph of this test's own, on this machine."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")


@pytest.fixture
def listener(domain: None) -> Iterator[Node]:
    rclpy.init()
    yield rclpy.create_node("listener")
    rclpy.shutdown()


@launch_pytest.fixture
def imu_launch():
    arguments = {"namespace": "left", "transport": "sim", "alpha": "1"}
    return launch.LaunchDescription(
        [
            launch.actions.IncludeLaunchDescription(
                str(LAUNCH_FILE), launch_arguments=arguments.items()
            )
        ]
    )


@pytest.mark.launch(fixture=imu_launch)
def test_orientation_arrives_in_the_namespace_that_was_asked_for(listener: Node):
    arrived, imu = wait_for_message(
        Imu, listener, "left/imu/data", qos_profile=qos_profile_sensor_data, time_to_wait=20.0
    )
    assert arrived
    q = imu.orientation
    assert q.w**2 + q.x**2 + q.y**2 + q.z**2 == pytest.approx(1.0, abs=1e-9)
