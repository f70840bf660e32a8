"""ROS bags in: rosbag2 (a folder, .mcap, .db3) and ROS 1 (.bag)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import takewhile
from operator import eq
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import RecordingError, TopicError
from ..filters.samples import Array, Stamps
from ..words import counted
from .opening import damage_told, is_ros1, reader
from .recording import Progress, Recording
from .wire import BOOL, IMU, MAGNETIC_FIELD, ROTORS, decode, decode_bool

if TYPE_CHECKING:
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

BLOCK = 8192  # messages held undecoded
ESTIMATE = "estimate "  # begins the role of an orientation that was asked for


class Topic(NamedTuple):
    """A topic's name and type, listed as the user reads it."""

    name: str
    kind: str

    def __str__(self) -> str:
        return f"{self.name} ({self.kind})"


def load_bag(
    path: Path,
    name: str,
    reference: str | None = None,
    progress: Progress | None = None,
    estimates: Sequence[str] = (),
) -> Recording:
    """Read the inertial, the magnetometer and the reference topic of a bag, in received order.

    Of several Imu topics the first that ends in ``data_raw`` is taken, else the first; of several
    MagneticField topics the one whose name shares most with it. ``reference`` is a topic of a type
    in `wire.ROTORS`; without it, the first named ``ground_truth`` is taken if there is one. The
    ``estimates`` are topics of these types too. A header stamp of zero is replaced by the time of
    reception. What has a covariance that begins with -1 is not reported (REP-145): NaN. A damaged
    bag is refused, even where a part of it could be read.
    """
    with damage_told(path), reader(path) as opened:
        return _read(opened, is_ros1(path), path.name, name, reference, progress, estimates)


class _Stream:
    """The messages on one topic, decoded a block at a time."""

    def __init__(self, topic: Topic, decode: Callable[[list[bytes]], tuple[Stamps, Array]]) -> None:
        self.topic = topic
        self._decode = decode
        self._received: list[int] = []
        self._messages: list[bytes] = []
        self._blocks: list[tuple[Stamps, Array]] = []

    def add(self, received: int, message: bytes) -> None:
        self._received.append(received)
        self._messages.append(message)
        if len(self._messages) == BLOCK:
            self._decode_block()

    def _decode_block(self) -> None:
        self._blocks.append(self._decode(self._messages))
        self._messages = []

    def finish(self) -> None:
        """Decode the rest and join all: when received, stamps and values."""
        self._decode_block()
        stamps, values = (np.concatenate(part) for part in zip(*self._blocks, strict=True))
        self.received = np.maximum.accumulate(np.array(self._received, dtype=np.int64))
        self.stamps = np.where(stamps == 0, self.received, stamps)
        self.values = values


def _read(
    opened: Reader1 | Reader2,
    ros1: bool,
    file: str,
    name: str,
    reference: str | None,
    progress: Progress | None,
    estimates: Sequence[str],
) -> Recording:
    topics: dict[Topic, int] = {}
    for c in opened.connections:
        topic = Topic(c.topic, c.msgtype)
        topics[topic] = topics.get(topic, 0) + c.msgcount
    roles = choose(file, topics, reference, estimates)
    streams = {
        role: _Stream(topic, _decoder(role, topic, file, ros1)) for role, topic in roles.items()
    }
    takers = {
        c.id: [s for s in streams.values() if s.topic == (c.topic, c.msgtype)]
        for c in opened.connections
    }
    wanted = [c for c in opened.connections if takers[c.id]]
    promised = sum(c.msgcount for c in wanted)
    found = 0
    for connection, received, message in opened.messages(connections=wanted):
        for stream in takers[connection.id]:
            stream.add(received, message)
        found += 1
        if progress and found % BLOCK == 0:
            progress(found / max(found, promised))
    if found < promised:
        raise RecordingError(
            f"{file} is cut short: its index promises {counted(promised, 'message')} "
            f"and it has {found}."
        )
    for stream in streams.values():
        stream.finish()

    imu, mag, truth = streams["imu"], streams.get("mag"), streams.get("reference")
    return Recording(
        name=name,
        stamps=imu.stamps,
        gyro=imu.values[:, :3],
        accel=imu.values[:, 3:],
        mag_stamps=mag.stamps if mag else np.empty(0, np.int64),
        mag=mag.values if mag else np.empty((0, 3)),
        reference_stamps=truth.stamps if truth else None,
        reference=truth.values if truth else None,
        movement=_held(streams["movement"], truth) if truth and "movement" in streams else None,
        received=imu.received,
        mag_received=mag.received if mag else np.empty(0, np.int64),
        reference_received=truth.received if truth else None,
        left_out=tuple(str(topic) for topic in topics if topic not in roles.values()),
        choices=tuple(_choices(topics, roles)),
        estimates={
            estimate: (streams[ESTIMATE + estimate].stamps, streams[ESTIMATE + estimate].values)
            for estimate in estimates
        },
    )


def choose(
    file: str, topics: Mapping[Topic, int], reference: str | None, estimates: Sequence[str] = ()
) -> dict[str, Topic]:
    """Which topic plays which role."""
    there = [topic for topic, count in topics.items() if count]
    inertial = [topic for topic in there if topic.kind == IMU]
    if not inertial:
        found = next((topic.name for topic in topics if topic.kind == IMU), None)
        if found:
            raise RecordingError(f"{file} has no message on {found}.")
        raise TopicError(f"{file} has no {IMU} topic. {_listed(topics)}")
    imu = next((topic for topic in inertial if topic.name.endswith("data_raw")), inertial[0])
    roles = {"imu": imu}

    fields = [topic for topic in there if topic.kind == MAGNETIC_FIELD]
    if fields:
        roles["mag"] = max(fields, key=lambda topic: _shared(topic.name, imu.name))

    for estimate in estimates:
        roles[ESTIMATE + estimate] = _orientation(file, topics, estimate, "an estimate")

    truths = (t for t in there if t.name.split("/")[-1] == "ground_truth" and t.kind in ROTORS)
    truth = next(truths, None)
    if reference is not None:
        truth = _orientation(file, topics, reference, "a reference")
    if truth:
        roles["reference"] = truth
        movement = Topic(f"{truth.name}/movement", BOOL)
        if movement in there:
            roles["movement"] = movement
    return roles


def _choices(topics: Mapping[Topic, int], roles: Mapping[str, Topic]) -> Iterator[str]:
    """What was taken where it was not the only one."""
    for role, what in (("imu", "Imu"), ("mag", "MagneticField")):
        taken = roles.get(role)
        others = [
            topic.name
            for topic, count in topics.items()
            if taken and count and topic.kind == taken.kind and topic not in roles.values()
        ]
        if taken and others:
            yield f"{taken.name} is the {what} topic that is taken, not {' or '.join(others)}."


def _orientation(file: str, topics: Mapping[Topic, int], name: str, what: str) -> Topic:
    """The topic of that name, which must have an orientation and messages."""
    named = [topic for topic in topics if topic.name.strip("/") == name.strip("/")]
    if not named:
        raise TopicError(f"{file} has no topic {name}. {_listed(topics)}")
    turning = [topic for topic in named if topic.kind in ROTORS]
    if not turning:
        raise TopicError(
            f"{file}: {named[0]} has no orientation; {what} is one of {', '.join(ROTORS)}."
        )
    told = [topic for topic in turning if topics[topic]]
    if not told:
        raise RecordingError(f"{file} has no message on {name}.")
    return told[0]


def _listed(topics: Mapping[Topic, int]) -> str:
    return f"It has: {', '.join(map(str, topics))}." if topics else "It has no topics."


def _shared(name: str, other: str) -> int:
    """How many parts from the root two topic names share."""
    return sum(takewhile(bool, map(eq, name.split("/"), other.split("/"))))


def _decoder(
    role: str, topic: Topic, file: str, ros1: bool
) -> Callable[[list[bytes]], tuple[Stamps, Array]]:
    """From messages to stamps and the columns that the role needs."""

    def columns(messages: list[bytes]) -> tuple[Stamps, Array]:
        try:
            if role == "movement":
                return decode_bool(messages, ros1=ros1)
            stamps, values = decode(topic.kind, messages, ros1=ros1)
        except RecordingError as error:
            raise RecordingError(f"{file}: {topic.name}: {error}") from None
        if role == "imu":
            rates = _reported(values[:, 13:16], values[:, 16])
            return stamps, np.hstack([rates, _reported(values[:, 25:28], values[:, 28])])
        if role == "mag":
            return stamps, _reported(values[:, :3], values[:, 3])
        x = ROTORS[topic.kind]
        rotors = values[:, [x + 3, x, x + 1, x + 2]]
        known = np.asarray(rotors.any(axis=1))
        if topic.kind == IMU:
            known &= values[:, 4] != -1.0
        return stamps, np.where(known[:, None], rotors, np.nan)

    return columns


def _reported(values: Array, covariance: Array) -> Array:
    return np.where(covariance[:, None] == -1.0, np.nan, values)


def _held(movement: _Stream, truth: _Stream) -> NDArray[np.bool_]:
    """The movement message that was last when each rotor of the reference was received."""
    last = np.searchsorted(movement.received, truth.received, side="right") - 1
    held: NDArray[np.bool_] = (last >= 0) & (movement.values[last, 0] > 0.0)
    return held
