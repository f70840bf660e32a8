"""The scenarios with nodes started as processes; `test/launch` starts them by launch files."""

from __future__ import annotations

import scenarios
from graph import Graph


def test_driver_and_fusion_agree_with_the_truth(graph: Graph) -> None:
    graph.start("imu_driver", rate=200.0, sim_motion="tumble", fifo=True)  # no sample is lost
    graph.start("fusion")
    scenarios.driver_and_fusion_agree_with_the_truth(graph)


def test_a_bag_is_followed_to_its_end(graph: Graph) -> None:
    graph.start("fusion", world_frame="nwu")
    scenarios.a_bag_is_followed_to_its_end(
        graph,
        lambda: graph.start(
            "bag_player",
            str(scenarios.TURNS),
            *("--subscribers", "3", "--wait", "20", "--rate", "4"),
        ),
    )


def test_alpha_is_live(graph: Graph) -> None:
    graph.start("fusion")
    scenarios.alpha_is_live(graph)
