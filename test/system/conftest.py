"""The graph fixture."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is neither sourced nor installed from PyPI")

from graph import Graph


@pytest.fixture
def graph() -> Iterator[Graph]:
    """A graph of its own for each test."""
    with Graph() as graph:
        yield graph
