"""/diagnostics at 1 Hz, whatever the clock does."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR

Status = tuple[bytes, str, Mapping[str, object]]


class Diagnostics:
    """Publishes what ``status`` says: level, one sentence, and values."""

    def __init__(
        self, node: Node, task: str, status: Callable[[float], Status], hardware_id: str = ""
    ) -> None:
        self._node = node
        self._name = f"{node.get_fully_qualified_name().lstrip('/')}: {task}"
        self._hardware_id = hardware_id
        self._status = status
        self._level = OK
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._last = self._clock.now().nanoseconds
        node.create_timer(1.0, self.publish, clock=self._clock)

    def publish(self) -> None:
        """Publish now; rates are over the time since the last."""
        now = self._clock.now().nanoseconds
        level, message, values = self._status((now - self._last) * 1e-9)
        self._last = now
        if level != self._level:  # a change is worth a line on the console
            self._level = level
            if level == OK:
                self._node.get_logger().info(message)
            elif level == WARN:
                self._node.get_logger().warning(message)
            else:
                self._node.get_logger().error(message)
        if not self._publisher.get_subscription_count():
            return
        status = DiagnosticStatus(
            level=level, name=self._name, message=message, hardware_id=self._hardware_id
        )
        status.values = [KeyValue(key=key, value=_text(value)) for key, value in values.items()]
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)


def _text(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return " ".join(map(_text, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)


class Once:
    """Says each thing once in a node's life; how often it happened stands in /diagnostics."""

    def __init__(self, node: Node) -> None:
        self._logger = node.get_logger()
        self._said: set[str] = set()

    def warn(self, what: str, sentence: str) -> None:
        """Log the sentence as a warning if ``what`` has not been said before."""
        if what not in self._said:
            self._said.add(what)
            self._logger.warning(f"{sentence} Further ones are only counted in /diagnostics.")
