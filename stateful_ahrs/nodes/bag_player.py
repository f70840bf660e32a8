"""bag_player: plays a bag into the graph where `ros2 bag play` is not installed."""

from __future__ import annotations

import argparse
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

import rclpy
from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.utilities import remove_ros_args
from rosgraph_msgs.msg import Clock

from ..errors import AhrsError, RecordingError, UsageError, exit_with_sentence
from ..recordings.bag import Topic
from ..recordings.playback import Bag, Event, open_bag
from ..recordings.progress import bar
from ..recordings.wire import IMU, MAGNETIC_FIELD
from . import messages, qos

WAIT = 5.0  # s; discovery repeats itself every 3 s where its first words were lost
SETTLED = 0.3  # s without a further subscriber: those that exist are matched
ACKNOWLEDGED = 5.0  # s; a subscriber that needs longer at the end does not read
SHORTEST_LOOP = 100_000_000  # ns
NAP = 0.05  # s, the longest: so soon is a shutdown noticed
EPILOG = """\
Messages keep their stamps and topics. Topics in a bag are absolute: move one with
--ros-args -r /imu/data_raw:=/robot/imu/data_raw. Topics of a type that is not installed are left
out. Exit codes: 0 played, or ended by SIGINT; 1 the bag could not be played; 2 usage."""


class Player(Node):
    """Publishes a bag's messages when they are due."""

    def __init__(self, bag: Bag, clock: float) -> None:
        super().__init__("bag_player", start_parameter_services=False)
        self._bag = bag
        self._clock_rate = clock
        self._outs: dict[Topic | None, Any] = {}
        for topic, count in bag.topics.items():
            if not count:
                continue
            try:
                self._outs[topic] = self._advertise(topic)
            except UsageError as error:
                self.get_logger().warning(f"{topic} and its {count} messages left out: {error}")
        if not self._outs:
            raise RecordingError(f"{bag.name} has nothing that can be played.")
        if clock:
            self._outs[None] = self.create_publisher(Clock, "/clock", QoSProfile(depth=1))

    def _advertise(self, topic: Topic) -> Any:
        """A publisher; `UsageError` if there can be none."""
        if topic in self._bag.foreign:
            raise UsageError("in ROS 2 the type may have another form.")
        if self._clock_rate and topic.name == "/clock":
            raise UsageError("--clock publishes its own.")
        profile = QoSProfile(depth=qos.PUBLISHER.depth)
        if topic in self._bag.latched:
            profile.durability = DurabilityPolicy.TRANSIENT_LOCAL
        try:
            return self.create_publisher(_message_type(topic.kind), topic.name, profile)
        except (InvalidTopicNameException, rclpy_implementation.RCLError) as error:
            raise UsageError(_one_line(error)) from None

    def play(self, rate: float, loop: bool, wait: float) -> None:
        """Play, once or until ROS shuts down, when somebody listens or ``wait`` s are over."""
        self._await_subscribers(wait)
        topics = [topic for topic in self._outs if topic]
        self.get_logger().info(
            f"playing {sum(self._bag.topics[topic] for topic in topics)} messages of "
            f"{self._bag.seconds:.1f} s on {', '.join(topic.name for topic in topics)}"
        )
        beginning = time.monotonic_ns()
        with bar("playing") as progress:
            while rclpy.ok():
                due = 0
                for event in self._bag.events(topics, rate, self._clock_rate):
                    if not self._sleep_until(beginning + event.due):
                        return
                    self._publish(event)
                    if progress and event.due // SHORTEST_LOOP != due // SHORTEST_LOOP:
                        progress(event.due * 1e-9 * rate / self._bag.seconds)
                    due = event.due
                if not loop:
                    break
                beginning += max(due, SHORTEST_LOOP)
        self._await_acknowledgement()

    def _publish(self, event: Event) -> None:
        if event.topic is None:
            self._outs[None].publish(Clock(clock=messages.time(event.time)))
        else:
            self._outs[event.topic].publish(event.message)

    def _await_subscribers(self, wait: float) -> None:
        """Return when those that exist are matched: somebody listens, and nobody else joins."""
        kinds = {IMU, MAGNETIC_FIELD} & {topic.kind for topic in self._outs if topic}
        begin = last_change = time.monotonic()
        heard = 0
        while rclpy.ok() and (now := time.monotonic()) - begin < wait:
            counts = {
                topic: out.get_subscription_count() for topic, out in self._outs.items() if topic
            }
            if sum(counts.values()) != heard:
                heard, last_change = sum(counts.values()), now
            relevant = any(n for topic, n in counts.items() if not kinds or topic.kind in kinds)
            if relevant and now - last_change > SETTLED:
                return
            time.sleep(NAP)
        if wait and not heard:
            self.get_logger().info(f"nobody has subscribed within {wait:g} s")

    def _await_acknowledgement(self) -> None:
        end = time.monotonic() + ACKNOWLEDGED
        for out in self._outs.values():
            while rclpy.ok() and not out.wait_for_all_acked(Duration(seconds=NAP)):
                if time.monotonic() > end:
                    raise AhrsError(
                        f"a subscriber of {out.topic_name} has not taken all messages within "
                        f"{ACKNOWLEDGED:g} s after the last."
                    )

    def _sleep_until(self, due: int) -> bool:
        """Sleep until the steady clock says ``due`` (ns); False if ROS shuts down."""
        while (left := due - time.monotonic_ns()) > 0 and rclpy.ok():
            time.sleep(min(left * 1e-9, NAP))
        return rclpy.ok()


def _message_type(kind: str) -> type:
    """The class of a type such as ``sensor_msgs/msg/Imu``; `UsageError` if it is not installed."""
    match = re.fullmatch(r"([a-z]\w*)/msg/([A-Z]\w*)", kind, re.ASCII)
    try:
        if match:
            found = getattr(import_module(f"{match[1]}.msg"), match[2])
            if hasattr(found, "get_fields_and_field_types"):
                return found
    except (ImportError, AttributeError):
        pass
    raise UsageError("its type is not installed here.")


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; see bag_player --help.")


def _number(low: float, high: float) -> Callable[[str], float]:
    """Parses a number between the two."""

    def number(text: str) -> float:
        try:
            if low <= float(text) <= high:
                return float(text)
        except ValueError:
            pass
        raise argparse.ArgumentTypeError(f"must be between {low:g} and {high:g}, got {text!r}")

    return number


def _options(argv: Sequence[str]) -> argparse.Namespace:
    parser = _Parser(prog="bag_player", description="Play a bag into the ROS graph.", epilog=EPILOG)
    parser.add_argument(
        "bag", type=Path, metavar="BAG", help="rosbag2 folder, .mcap, .db3 or ROS 1 .bag"
    )
    parser.add_argument(
        "--rate",
        type=_number(0.001, 1000.0),
        default=1.0,
        metavar="R",
        help="times the speed of the recording",
    )
    parser.add_argument("--loop", action="store_true", help="begin again at the end, for ever")
    parser.add_argument(
        "--clock",
        type=_number(0.1, 10_000.0),
        nargs="?",
        const=100.0,
        default=0.0,
        metavar="HZ",
        help="publish the bag's time on /clock, for use_sim_time (%(const)g Hz unless given)",
    )
    parser.add_argument(
        "--wait",
        type=_number(0.0, 3600.0),
        default=WAIT,
        metavar="S",
        help="for the first subscriber of an IMU or magnetometer topic (default: %(default)g s)",
    )
    try:
        own = remove_ros_args(argv)
    except Exception as error:
        raise UsageError(f"the ROS arguments cannot be used: {_one_line(error)}") from None
    return parser.parse_args(own)


@contextmanager
def _graph() -> Iterator[None]:
    """ROS while the block runs; SIGINT and SIGTERM shut it down."""
    signal.signal(signal.SIGINT, lambda *_: None)  # no KeyboardInterrupt amid rclpy's C++
    rclpy.init()
    try:
        yield
    except rclpy_implementation.RCLError:
        if rclpy.ok():  # else a publisher lost the race with the shutdown
            raise
    finally:
        rclpy.try_shutdown()


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def _play() -> None:
    options = _options(sys.argv[1:])
    try:
        with open_bag(options.bag) as bag, _graph():
            Player(bag, options.clock).play(options.rate, options.loop, options.wait)
    except KeyboardInterrupt:  # while the bag was being opened
        pass


def main() -> None:
    """Play a bag."""
    sys.exit(exit_with_sentence("bag_player", _play))


if __name__ == "__main__":
    main()
