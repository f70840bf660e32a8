"""Quality of service as REP-2003 has it, with queues that a stalled process does not overflow.

Publishers are reliable, as the system default is; sensor subscribers take best effort, so that
they hear either kind. Both can be overridden by ``qos_overrides.<topic>...`` parameters.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from copy import copy
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy import get_rmw_implementation_identifier
from rclpy.event_handler import (
    PublisherEventCallbacks,
    SubscriptionEventCallbacks,
    UnsupportedEventTypeError,
)
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from ..errors import UsageError

DEEPEST = 2**31 - 1  # what the middleware counts with


def _checked(profile: QoSProfile) -> SetParametersResult:
    """Refuse a depth that the middleware would choke on; a `ValueError` tells more than it can."""
    if not 0 <= profile.depth <= DEEPEST:
        raise ValueError(f"depth must be between 0 and {DEEPEST}, got {profile.depth}.")
    return SetParametersResult(successful=True)


OVERRIDABLE = QoSOverridingOptions.with_default_policies(  # history, depth, reliability
    callback=_checked
)
PUBLISHER = QoSProfile(depth=100)
SENSOR_SUBSCRIBER = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)


class Output:
    """A publisher that is ``wanted`` while someone listens.

    The middleware tells when that changes: to ask it at each sample costs half of publishing. With
    one that does not tell, it always is. ``raw``: it is given the bytes of each message, on the
    thread that destroys the node, and so past what rclpy does to be safe of others.
    """

    def __init__(self, node: Node, kind: type, topic: str, raw: bool) -> None:
        self.wanted = False

        def made(events: PublisherEventCallbacks | None) -> Any:
            return node.create_publisher(
                kind,
                topic,
                copy(PUBLISHER),  # which rclpy changes where it is overridden
                event_callbacks=events,
                qos_overriding_options=OVERRIDABLE,
            )

        try:
            publisher = made(PublisherEventCallbacks(matched=self._on_matched))
        except UnsupportedEventTypeError:
            publisher = made(None)
            self.wanted = True
            node.get_logger().warning(
                f"{get_rmw_implementation_identifier()} does not tell who listens: all topics are "
                "computed and published all the time.",
                once=True,
            )
        self.topic_name = publisher.topic_name
        self.publish = publisher.handle.publish_raw if raw else publisher.publish

    def _on_matched(self, event: Any) -> None:
        self.wanted = event.current_count > 0


def advertise(node: Node, kind: type, topic: str, raw: bool = False) -> Output:
    """A publisher of the node; `UsageError` if its QoS was overridden with what is none."""
    with _refused(node, topic):
        return Output(node, kind, topic, raw)


def subscribe(
    node: Node, kind: type, topic: str, callback: Any, on_lost: Any, raw: bool = False
) -> Any:
    """A sensor subscription; ``on_lost`` hears of samples that the middleware lost, if it tells.

    ``raw``: the callback gets the bytes of each message.
    """

    def made(events: SubscriptionEventCallbacks | None) -> Any:
        return node.create_subscription(
            kind,
            topic,
            callback,
            copy(SENSOR_SUBSCRIBER),
            event_callbacks=events,
            qos_overriding_options=OVERRIDABLE,
            raw=raw,
        )

    with _refused(node, topic):
        try:
            return made(SubscriptionEventCallbacks(message_lost=on_lost))
        except UnsupportedEventTypeError:
            node.get_logger().warning(
                f"{get_rmw_implementation_identifier()} does not tell of samples that it loses: "
                "lost_in_transport stays 0.",
                once=True,
            )
            return made(None)


@contextmanager
def _refused(node: Node, topic: str) -> Iterator[None]:
    try:
        yield
    except (RuntimeError, ValueError, rclpy_implementation.RCLError) as error:
        if not node.context.ok():  # the node was told to end before it was made
            raise
        raise UsageError(f"the QoS for {topic} cannot be used: {error}") from None
