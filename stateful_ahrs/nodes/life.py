"""How every node starts, spins and ends."""

from __future__ import annotations

import re
from collections.abc import Callable

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from ..errors import UsageError, exit_with_sentence


def run(name: str, make: Callable[[], Node]) -> int:
    """Initialise ROS, make the node, run it until it is told to end; return the exit code."""

    def command() -> None:
        try:
            rclpy.init()
        except Exception as error:
            raise UsageError(f"the ROS arguments cannot be used: {_one_line(error)}") from None
        try:
            try:
                node = make()
            except ParameterException as error:
                raise UsageError(_one_line(error)) from None
            spin(node)
            node.destroy_node()
        except (KeyboardInterrupt, ExternalShutdownException):
            pass
        finally:
            rclpy.try_shutdown()

    return exit_with_sentence(name, command)


def spin(node: Node) -> None:
    """Run the node's callbacks until SIGINT, SIGTERM, or the context ends."""
    executor = EventsExecutor()
    executor.add_node(node)
    try:
        # EventsExecutor.spin() never calls anything in the PyPI build (its infinite deadline
        # overflows); a loop of finite waits works in every build.
        while rclpy.ok():
            executor.spin_once(timeout_sec=1.0)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except rclpy_implementation.RCLError:
        if rclpy.ok():  # else a publisher lost the race with the shutdown
            raise
    finally:
        executor.shutdown()


def _one_line(error: Exception) -> str:
    """What the error says, without the places in rcl's sources."""
    return re.sub(r", at /\S+", "", " ".join(str(error).split()))
