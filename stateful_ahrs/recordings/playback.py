"""A bag as it is played: messages as they lie in it, each with the time when it is due."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..errors import RecordingError
from .bag import Topic, opened
from .wire import BOOL, IMU, LAYOUTS

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

ROS1_KINDS = (*LAYOUTS, BOOL)  # the same in ROS 1 and ROS 2, but for the header's seq


class Event(NamedTuple):
    """A message, or without a topic a tick of the clock."""

    due: int  # ns after the beginning
    time: int  # ns, when it was received by the recorder
    topic: Topic | None
    message: bytes  # CDR


class Bag:
    """The messages of an open bag, in the order received."""

    def __init__(self, reader: Reader1 | Reader2, file: str) -> None:
        self.file = file
        self.seconds = reader.duration * 1e-9
        self.topics: dict[Topic, int] = {}  # with how many messages each has
        self.latched: set[Topic] = set()  # kept by their publisher for those who join late
        self.foreign: set[Topic] = set()  # not in the form that ROS 2 has them in
        self._reader = reader
        self._ros1 = file.endswith(".bag")
        for connection in reader.connections:
            topic = Topic(connection.topic, connection.msgtype)
            self.topics[topic] = self.topics.get(topic, 0) + connection.msgcount
            if self._is_latched(connection):
                self.latched.add(topic)
            if self._is_foreign(connection):
                self.foreign.add(topic)

    def events(
        self, topics: Collection[Topic], rate: float = 1.0, clock: float = 0.0
    ) -> Iterator[Event]:
        """What is due when, at ``rate`` times the speed of the recording.

        ``clock`` (Hz) adds ticks, from the beginning on; 0: none. Raises RecordingError where
        the bag turns out to be cut short.
        """
        start, ticks = -1, 0
        for received, topic, message in self._messages(topics):
            if start < 0:
                start = received
            due = round((received - start) / rate)
            while clock and (at := round(ticks * 1e9 / clock)) <= due:
                yield Event(at, start + round(at * rate), None, b"")
                ticks += 1
            yield Event(due, received, topic, message)

    def _messages(self, topics: Collection[Topic]) -> Iterator[tuple[int, Topic, bytes]]:
        """Of messages received at the same time the Imu is the last, as `write` has it."""
        wanted = {c.id: Topic(c.topic, c.msgtype) for c in self._reader.connections}
        connections = [c for c in self._reader.connections if wanted[c.id] in topics]
        if not connections:  # to rosbags that would mean all
            return
        convert = self._converter()
        stream = (
            (received, wanted[connection.id], convert(message, connection.msgtype))
            for connection, received, message in self._reader.messages(connections=connections)
        )
        found = 0
        for _, together in groupby(stream, key=itemgetter(0)):
            for item in sorted(together, key=lambda item: item[1].kind == IMU):
                yield item
                found += 1
        promised = sum(connection.msgcount for connection in connections)
        if found < promised:
            raise RecordingError(
                f"{self.file} is cut short: its index promises {promised} messages "
                f"and it has {found}."
            )

    def _converter(self) -> Callable[[bytes, str], bytes]:
        if not self._ros1:
            return lambda message, _: bytes(message)
        from rosbags.typesys import Stores, get_typestore

        types = get_typestore(Stores.ROS2_JAZZY)
        return lambda message, kind: bytes(types.ros1_to_cdr(message, kind))

    def _is_latched(self, connection: Connection) -> bool:
        if self._ros1:
            return bool(connection.ext.latching)
        offered = connection.ext.offered_qos_profiles
        return any(profile.durability.name == "TRANSIENT_LOCAL" for profile in offered)

    def _is_foreign(self, connection: Connection) -> bool:
        if self._ros1:
            return connection.msgtype not in ROS1_KINDS
        return connection.ext.serialization_format != "cdr"


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open a rosbag2 folder, an .mcap, a .db3 or a ROS 1 .bag to play it.

    Raises RecordingError for what is missing, damaged or without messages.
    """
    with opened(path) as reader:
        bag = Bag(reader, path.name)
        if not any(bag.topics.values()):
            raise RecordingError(f"{path.name} has no messages.")
        yield bag
