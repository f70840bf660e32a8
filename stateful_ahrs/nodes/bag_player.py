"""bag_player: plays a bag into the graph where `ros2 bag play` is not installed."""

from __future__ import annotations

import argparse
import re
import sys
import time
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock

from ..command import Parser, exit_with_sentence
from ..errors import AhrsError, RecordingError, UsageError
from ..recordings.bag import Topic
from ..recordings.playback import Bag, Event, open_bag
from ..recordings.progress import bar
from ..recordings.wire import IMU, MAGNETIC_FIELD
from ..words import counted
from . import messages, qos
from .life import graph, one_line, own_arguments
from .parameters import warn_of_unknown

INERTIAL = (IMU, MAGNETIC_FIELD)
WAIT = 5.0  # s; discovery repeats itself every 3 s where its first words were lost
SETTLED = 1.0  # s without a further subscriber: those that exist are matched, on both sides
LINGER = 500_000_000  # ns; a best-effort subscriber loses what it has not taken when we vanish
ACKNOWLEDGED = 5.0  # s; a subscriber that needs longer at the end does not read
TENTH = 100_000_000  # ns, between two reports of progress; no loop is shorter
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
        self._outs: dict[Topic, Any] = {}
        for topic, count in bag.topics.items():
            if not count:
                continue
            try:
                self._outs[topic] = self._advertise(topic)
            except UsageError as error:
                self.get_logger().warning(
                    f"{topic} and its {counted(count, 'message')} left out: {error}"
                )
        if not self._outs:
            raise RecordingError(f"{bag.name} has nothing that can be played.")
        self._clock_out = self.create_publisher(Clock, "/clock", 1) if clock else None

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
            if not self.context.ok():  # told to end meanwhile
                raise
            raise UsageError(one_line(error)) from None

    def play(self, rate: float, loop: bool, wait: float, subscribers: int | None) -> None:
        """Play, once or until ROS shuts down, when enough listen or ``wait`` s are over."""
        self._await_subscribers(wait, subscribers)
        if not rclpy.ok():
            return
        topics = list(self._outs)
        self.get_logger().info(
            f"playing {counted(sum(self._bag.topics[topic] for topic in topics), 'message')} of "
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
                    if progress and event.due // TENTH != due // TENTH:
                        progress(event.due * 1e-9 * rate / self._bag.seconds)
                    due = event.due
                if not loop:
                    break
                beginning += max(due, TENTH)
        self._await_delivery()

    def _publish(self, event: Event) -> None:
        if event.topic:
            self._outs[event.topic].publish(event.message)
        elif self._clock_out:
            self._clock_out.publish(Clock(clock=messages.time(event.time)))

    def _await_subscribers(self, wait: float, wanted: int | None) -> None:
        """Return when those that exist are matched: enough subscribe, and nobody else joins."""
        begin = last_change = time.monotonic()
        heard: dict[Topic, int] = {}
        while rclpy.ok() and (now := time.monotonic()) - begin < wait:
            counts = {topic: out.get_subscription_count() for topic, out in self._outs.items()}
            if counts != heard:
                heard, last_change = counts, now
            if now - last_change > SETTLED and self._are_enough(counts, wanted):
                return
            time.sleep(NAP)
        if wait and rclpy.ok():
            self.get_logger().warning(
                f"{counted(sum(heard.values()), 'subscription')} within {wait:g} s; "
                "playing all the same"
            )

    @staticmethod
    def _are_enough(counts: dict[Topic, int], wanted: int | None) -> bool:
        if wanted is not None:
            return sum(counts.values()) >= wanted
        inertial = [count for topic, count in counts.items() if topic.kind in INERTIAL]
        return any(inertial or counts.values())

    def _await_delivery(self) -> None:
        self._sleep_until(time.monotonic_ns() + LINGER)
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
    parser = Parser(prog="bag_player", description="Play a bag into the ROS graph.", epilog=EPILOG)
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
        help="wait so long for subscribers before the first message (default: %(default)g s)",
    )
    parser.add_argument(
        "--subscribers",
        type=int,
        metavar="N",
        help="of all topics together to wait for (default: one of an IMU or magnetometer topic)",
    )
    return parser.parse_args(own_arguments(argv))


def _play() -> None:
    options = _options(sys.argv[1:])
    try:
        with open_bag(options.bag) as bag, graph():
            player = Player(bag, options.clock)
            warn_of_unknown(player)
            player.play(options.rate, options.loop, options.wait, options.subscribers)
    except KeyboardInterrupt:  # while the bag was being opened
        pass


def main() -> None:
    """Play a bag."""
    sys.exit(exit_with_sentence("bag_player", _play))


if __name__ == "__main__":
    main()
