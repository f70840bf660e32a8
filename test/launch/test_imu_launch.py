"""The scenarios with nodes started by launch/imu.launch.py.

Skipped where launch_pytest is missing: it comes with ROS, not from PyPI.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("launch_pytest")

import launch_pytest
import scenarios
from graph import Graph, until
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from rcl_interfaces.srv import GetParameters
from sensor_msgs.msg import Imu

LAUNCH_FILE = Path(__file__).parents[2] / "launch" / "imu.launch.py"


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Iterator[Graph]:
    """A graph of its own, which the launched nodes join."""
    with Graph() as graph:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(graph.domain))
        yield graph


def launched(**arguments: str) -> LaunchDescription:
    include = IncludeLaunchDescription(str(LAUNCH_FILE), launch_arguments=arguments.items())
    return LaunchDescription([include])


@launch_pytest.fixture
def tumbling(graph: Graph, tmp_path: Path) -> LaunchDescription:
    config = tmp_path / "driver.yaml"
    config.write_text("imu_driver: {ros__parameters: {rate: 200.0, sim_motion: tumble}}")
    return launched(driver_config=str(config))


@launch_pytest.fixture
def in_a_namespace(graph: Graph) -> LaunchDescription:
    return launched(namespace="left", transport="sim", alpha="1", world_frame="ned")


@pytest.mark.launch(fixture=tumbling)
def test_driver_and_fusion_agree_with_the_truth(graph: Graph) -> None:
    scenarios.driver_and_fusion_agree_with_the_truth(graph)


@pytest.mark.launch(fixture=tumbling)
def test_alpha_is_live(graph: Graph) -> None:
    scenarios.alpha_is_live(graph)


@pytest.mark.launch(fixture=in_a_namespace)
def test_arguments_reach_the_nodes(graph: Graph) -> None:
    orientations = graph.hear(Imu, "left/imu/data")
    until(lambda: orientations, "an orientation in the namespace")
    names = {"fusion": ["alpha", "world_frame", "filter"], "imu_driver": ["transport"]}
    values = {node: parameters(graph, f"left/{node}", names[node]) for node in names}
    assert values == {"fusion": [1.0, "ned", "stateful"], "imu_driver": ["sim"]}


def parameters(graph: Graph, node: str, names: list[str]) -> list[Any]:
    request = GetParameters.Request(names=names)
    values = graph.call(GetParameters, f"{node}/get_parameters", request).values
    return [value.string_value or value.double_value for value in values]
