"""Quality of service as REP-2003 has it, with queues that a stalled process does not overflow.

Publishers are reliable, as the system default is; sensor subscribers take best effort, so that
they hear either kind. Both can be overridden by ``qos_overrides.<topic>...`` parameters.
"""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

PUBLISHER = QoSProfile(depth=100)
SENSOR_SUBSCRIBER = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)


def advertise(node: Node, kind: type, topic: str) -> Any:
    """A publisher of the node."""
    return node.create_publisher(kind, topic, PUBLISHER, qos_overriding_options=overridable())


def overridable() -> QoSOverridingOptions:
    """Let users override history, depth and reliability by parameters."""
    return QoSOverridingOptions.with_default_policies()
