"""How every node starts, spins and ends."""

from __future__ import annotations

import gc
import re
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace

import rclpy
from rclpy.exceptions import NotInitializedException, ParameterException
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.utilities import remove_ros_args

from ..command import exit_with_sentence
from ..errors import UsageError
from .parameters import Spec, warn_of_unknown


def run(name: str, make: Callable[[], Node], specs: Iterable[Spec]) -> int:
    """Make the node and run it until it is told to end; return the exit code."""

    def command() -> None:
        own = own_arguments(sys.argv)[1:]
        if own and own[0] in ("-h", "--help"):
            print(f"usage: {name} [--ros-args -p NAME:=VALUE ...]\n\nParameters:")
            for spec in specs:
                print(f"  {spec.name} ({spec.default!r}): {spec.description}")
            return
        if own:
            raise UsageError(
                f"unexpected argument {own[0]!r}: parameters are given as "
                f"--ros-args -p NAME:=VALUE; see {name} --help."
            )
        with graph():
            node = make()
            warn_of_unknown(node)
            try:
                spin(node)
            finally:
                node.destroy_node()

    return exit_with_sentence(name, command)


def own_arguments(argv: list[str]) -> list[str]:
    """What ROS leaves of the arguments; `UsageError` if it does not understand its own."""
    try:
        return list(remove_ros_args(argv))
    except Exception as error:
        raise UsageError(f"the ROS arguments cannot be used: {one_line(error)}") from None


@contextmanager
def graph() -> Iterator[None]:
    """ROS while the block runs. SIGINT and SIGTERM shut it down: then the block is to end.

    What fails in it because ROS has shut down ends it as well, at any line, and is no error.
    """
    # A KeyboardInterrupt amid rclpy's C++ comes out as another error; rclpy's own handler stays.
    signal.signal(signal.SIGINT, lambda *_: None)
    try:
        rclpy.init()
    except Exception as error:
        if "log directory" in str(error):
            raise UsageError(
                f"ROS cannot write its log: {one_line(error)}. "
                "Set ROS_LOG_DIR to a folder that you may write."
            ) from None
        raise UsageError(f"the ROS arguments cannot be used: {one_line(error)}") from None
    try:
        yield
    except ParameterException as error:
        raise UsageError(one_line(error)) from None
    except (RuntimeError, NotInitializedException, rclpy_implementation.RCLError):
        if rclpy.ok():
            raise
    finally:
        rclpy.try_shutdown()


def fastest_executor() -> tuple[Executor, str]:
    """The executor that costs least in this rclpy, and why it is that one."""
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor(), (
            "SingleThreadedExecutor: this rclpy has no EventsExecutor, which takes less than half "
            "of the CPU."
        )
    return EventsExecutor(), "EventsExecutor: of rclpy's the one that costs least."


def spin(node: Node) -> None:
    """Run the node's callbacks until ROS shuts down."""
    executor, reason = fastest_executor()
    node.get_logger().info(f"executor {reason}")
    executor.add_node(node)
    plain = isinstance(executor, SingleThreadedExecutor)
    if not plain:
        simplify(node)
    never: Future = Future()
    gc.freeze()  # what was made so far stays: to look through it would hold up a sample for 20 ms
    try:
        # EventsExecutor.spin() never calls anything in the PyPI build (its infinite deadline
        # overflows); a loop of finite waits works in every build. After spin_once it would come
        # back here for each sample, which costs 9 µs; the plain executor adds a callback to the
        # future each time that it does not, and never takes one away.
        while rclpy.ok():
            if plain:
                executor.spin_once(timeout_sec=1.0)
            else:
                executor.spin_until_future_complete(never, timeout_sec=1.0)
    except ExternalShutdownException:
        pass
    finally:
        executor.shutdown()


class Direct(Subscription):
    """A subscription of which the EventsExecutor reads its own attributes; for no other executor.

    With each message it looks up the handle, the callback, and how to call that. In rclpy these are
    properties and members of an enum, and each is a call of Python or two.
    """

    handle = callback = None  # not properties: each instance has its own


def simplify(node: Node) -> None:
    """Make the subscriptions of the node that take a message without its info `Direct`."""
    try:  # what rclpy does not promise: where it is another, subscriptions stay as they are
        usual = Subscription.CallbackType.MessageOnly
        alike = SimpleNamespace(value=usual.value)
        for subscription in node.subscriptions:
            if subscription._callback_type is usual:
                handle, callback = subscription.handle, subscription.callback
                subscription.__class__ = Direct
                subscription.handle, subscription.callback = handle, callback
                subscription._callback_type = alike
                subscription.CallbackType = SimpleNamespace(MessageOnly=alike)
    except (AttributeError, TypeError) as error:
        node.get_logger().debug(f"subscriptions stay as rclpy makes them: {error}")


def one_line(error: Exception) -> str:
    """What the error says, without the places in rcl's sources."""
    return re.sub(r", at /\S+", "", " ".join(str(error).split()))
