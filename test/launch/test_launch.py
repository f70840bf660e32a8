"""The scenarios with nodes started by the launch files.

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
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from rcl_interfaces.srv import GetParameters
from sensor_msgs.msg import Imu

LAUNCH = Path(__file__).parents[2] / "launch"


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Iterator[Graph]:
    """A graph of its own, which the launched nodes join."""
    with Graph() as graph:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(graph.domain))
        yield graph


def launched(file: str, **arguments: str) -> LaunchDescription:
    include = IncludeLaunchDescription(str(LAUNCH / file), launch_arguments=arguments.items())
    return LaunchDescription([include])


@launch_pytest.fixture
def tumbling(graph: Graph, tmp_path: Path) -> LaunchDescription:
    config = tmp_path / "driver.yaml"
    config.write_text(
        "imu_driver: {ros__parameters: {rate: 200.0, sim_motion: tumble, fifo: true}}"
    )
    return launched("imu.launch.py", driver_config=str(config))


@launch_pytest.fixture
def in_a_namespace(graph: Graph) -> LaunchDescription:
    return launched(
        "imu.launch.py", namespace="left", transport="sim", alpha="1", world_frame="ned"
    )


@launch_pytest.fixture
def from_a_bag(graph: Graph) -> LaunchDescription:
    bag = str(scenarios.TURNS)
    wait_for_all = "--subscribers 3 --wait 20"  # of fusion two, of the test the truth
    return launched("playback.launch.py", bag=bag, world_frame="nwu", options=wait_for_all)


@pytest.mark.launch(fixture=from_a_bag)
def test_a_bag_is_followed_to_its_end(graph: Graph) -> None:
    scenarios.a_bag_is_followed_to_its_end(graph, play=lambda: None)


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


@pytest.mark.parametrize(
    ("file", "arguments"),
    [
        ("imu.launch.py", {"alpha": "7"}),
        ("imu.launch.py", {"transport": "nope"}),
        ("playback.launch.py", {"bag": str(scenarios.TURNS), "filter": "nope"}),
        ("playback.launch.py", {"bag": "nowhere"}),
    ],
)
def test_a_node_that_fails_ends_the_launch_as_an_error(
    graph: Graph, file: str, arguments: dict[str, str]
) -> None:
    service = LaunchService()
    service.include_launch_description(launched(file, **arguments))
    assert service.run() == 1


def test_the_end_of_a_bag_ends_the_launch_well(graph: Graph) -> None:
    service = LaunchService()
    bag = {"bag": str(scenarios.TURNS), "options": "--rate 8"}
    service.include_launch_description(launched("playback.launch.py", **bag))
    assert service.run() == 0


def parameters(graph: Graph, node: str, names: list[str]) -> list[Any]:
    request = GetParameters.Request(names=names)
    values = graph.call(GetParameters, f"{node}/get_parameters", request).values
    return [value.string_value or value.double_value for value in values]
