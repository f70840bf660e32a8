"""A bag as it is played: messages as they lie in it, each with the time when it is due."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..errors import RecordingError
from ..words import counted
from .bag import Topic, choose
from .opening import BAGS, damage_told, is_ros1, reader, require
from .wire import BOOL, IMU, LAYOUTS

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

SAME_IN_ROS1 = (*LAYOUTS, BOOL)  # but for the header's seq


class Event(NamedTuple):
    """A message, or without a topic a tick of the clock."""

    due: int  # ns after the beginning
    time: int  # ns, when it was received
    topic: Topic | None
    message: bytes  # CDR


class Bag:
    """The messages of an open bag, in the order received."""

    def __init__(self, path: Path, reader: Reader1 | Reader2) -> None:
        self.name = path.name
        self.seconds = reader.duration * 1e-9
        self.topics: dict[Topic, int] = {}  # with how many messages each has
        self.latched: set[Topic] = set()  # kept by their publishers for those who join late
        self.foreign: set[Topic] = set()  # of a form that ROS 2 does not have
        self._path = path
        self._reader = reader
        for connection in reader.connections:
            topic = Topic(connection.topic, connection.msgtype)
            self.topics[topic] = self.topics.get(topic, 0) + connection.msgcount
            if _is_latched(connection):
                self.latched.add(topic)
            if is_ros1(path) and topic.kind not in SAME_IN_ROS1:
                self.foreign.add(topic)

    @property
    def roles(self) -> dict[str, Topic]:
        """Which topics are ``imu``, ``mag`` and ``reference``, chosen as `load_bag` does."""
        return choose(self.name, self.topics, None)

    def events(
        self, topics: Collection[Topic], rate: float = 1.0, clock: float = 0.0
    ) -> Iterator[Event]:
        """What is due when, at ``rate`` times the speed of the recording.

        ``clock`` (Hz) adds ticks, the first at the beginning; 0: none. Raises RecordingError
        where the bag turns out to be damaged.
        """
        start, ticks = None, 0
        for received, topic, message in self._messages(topics):
            if start is None:
                start = received
            due = round((received - start) / rate)
            while clock and (at := round(ticks * 1e9 / clock)) <= due:
                yield Event(at, start + round(at * rate), None, b"")
                ticks += 1
            yield Event(due, received, topic, message)

    def _messages(self, topics: Collection[Topic]) -> Iterator[tuple[int, Topic, bytes]]:
        """Of messages received at the same time the Imu is the last, as `write` has it."""
        topic_of = {c.id: Topic(c.topic, c.msgtype) for c in self._reader.connections}
        wanted = [c for c in self._reader.connections if topic_of[c.id] in topics]
        promised = sum(connection.msgcount for connection in wanted)
        convert = self._converter()
        found = 0
        with damage_told(self._path):
            stream = (
                (received, topic_of[connection.id], convert(message, connection.msgtype))
                for connection, received, message in self._reader.messages(connections=wanted)
            )
            for _, together in groupby(stream, key=itemgetter(0)):
                for item in sorted(together, key=lambda item: item[1].kind == IMU):
                    yield item
                    found += 1
        if found < promised:
            raise RecordingError(
                f"{self.name} is cut short: its index promises "
                f"{counted(promised, 'message')} and it has {found}."
            )

    def _converter(self) -> Callable[[bytes, str], bytes]:
        if not is_ros1(self._path):
            return lambda message, _: bytes(message)
        from rosbags.typesys import Stores, get_typestore

        types = get_typestore(Stores.ROS2_JAZZY)
        return lambda message, kind: bytes(types.ros1_to_cdr(message, kind))


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open a rosbag2 folder, an .mcap, a .db3 or a ROS 1 .bag to play it.

    Raises RecordingError for what is missing, damaged or without messages.
    """
    require(path, BAGS)
    path = path.absolute()  # which has a name even where it is "."
    with ExitStack() as stack:
        with damage_told(path):
            opened = reader(path)
            stack.enter_context(opened)
            bag = Bag(path, opened)
        if not any(bag.topics.values()):
            raise RecordingError(f"{path.name} has no messages.")
        yield bag


def _is_latched(connection: Connection) -> bool:
    profiles = getattr(connection.ext, "offered_qos_profiles", ())
    return bool(getattr(connection.ext, "latching", False)) or any(
        profile.durability.name == "TRANSIENT_LOCAL" for profile in profiles
    )
