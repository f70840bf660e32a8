"""Bags as they are played: order, times, and what cannot be played."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rosbags", reason="bags need rosbags: pip install 'stateful_ahrs[bags]'")

from recorded import START, Bag

from stateful_ahrs.errors import RecordingError
from stateful_ahrs.recordings.bag import Topic
from stateful_ahrs.recordings.playback import Event, open_bag
from stateful_ahrs.recordings.wire import IMU, MAGNETIC_FIELD

MS = 1_000_000  # ns
IMU_TOPIC = Topic("/imu/data_raw", IMU)
MAG_TOPIC = Topic("/imu/mag", MAGNETIC_FIELD)


def played(path: Path, **how: Any) -> list[Event]:
    with open_bag(path) as bag:
        return list(bag.events(set(bag.topics) - bag.foreign, **how))


def write(path: Path, samples: int = 5, **options: Any) -> Path:
    """Samples 10 ms apart, each Imu written before the field received at the same time."""
    with Bag(path, **options) as bag:
        for i in range(samples):
            at = START + 10 * i * MS
            bag.add(IMU_TOPIC.name, bag.imu(at), at)
            bag.add(MAG_TOPIC.name, bag.mag(at), at)
    return path


@pytest.mark.parametrize("storage", ["MCAP", "SQLITE3"])
def test_of_one_time_the_imu_is_the_last(tmp_path: Path, storage: str):
    events = played(write(tmp_path / "bag", storage=storage))
    assert [event.topic for event in events] == [MAG_TOPIC, IMU_TOPIC] * 5


def test_what_was_received_imu_first_stays_imu_first(tmp_path: Path):
    with Bag(tmp_path / "bag") as bag:
        bag.add(IMU_TOPIC.name, bag.imu(START), START)
        bag.add(MAG_TOPIC.name, bag.mag(START), START + 1)
    assert [event.topic for event in played(tmp_path / "bag")] == [IMU_TOPIC, MAG_TOPIC]


@pytest.mark.parametrize(("rate", "step"), [(1.0, 10 * MS), (4.0, 5 * MS // 2), (0.5, 20 * MS)])
def test_messages_are_due_when_they_were_received_divided_by_the_rate(
    tmp_path: Path, rate: float, step: int
):
    events = played(write(tmp_path / "bag"), rate=rate)
    assert [event.due for event in events[1::2]] == [i * step for i in range(5)]
    assert [event.time - START for event in events[1::2]] == [10 * i * MS for i in range(5)]


def test_the_clock_ticks_evenly_in_bag_time_and_before_what_is_due_with_it(tmp_path: Path):
    events = played(write(tmp_path / "bag"), rate=2.0, clock=1000.0)
    ticks = [event for event in events if event.topic is None]
    assert [tick.due for tick in ticks] == [i * MS for i in range(21)]  # 40 ms in 20 ms
    assert [tick.time - START for tick in ticks] == [2 * i * MS for i in range(21)]
    assert events[0].topic is None
    assert [event.due for event in events] == sorted(event.due for event in events)


def test_messages_of_ros1_come_out_as_those_of_ros2(tmp_path: Path):
    events = played(write(tmp_path / "one.bag"))
    assert events == played(write(tmp_path / "two"))


def test_types_that_ros2_changed_are_foreign_in_a_ros1_bag(tmp_path: Path):
    with Bag(tmp_path / "one.bag") as bag:
        bag.add("/imu", bag.imu(START), START)
        bag.topic("/power", "sensor_msgs/msg/BatteryState")  # ROS 2 added a temperature
    with open_bag(tmp_path / "one.bag") as bag:
        assert bag.foreign == {Topic("/power", "sensor_msgs/msg/BatteryState")}


def test_only_the_wanted_topics_are_played(tmp_path: Path):
    with open_bag(write(tmp_path / "bag")) as bag:
        assert {event.topic for event in bag.events([MAG_TOPIC])} == {MAG_TOPIC}


def test_a_damaged_part_is_told_when_it_is_reached(tmp_path: Path):
    path = write(tmp_path / "bag", samples=4000) / "bag.mcap"  # more than one chunk of 1 MiB
    data = bytearray(path.read_bytes())
    begin = len(data) * 3 // 4
    data[begin : begin + 4096] = bytes(4096)
    path.write_bytes(data)
    events = []
    with (
        open_bag(path.parent) as bag,
        pytest.raises(RecordingError, match=r"^bag is (damaged|cut short)"),
    ):
        for event in bag.events(bag.topics):
            events.append(event)
    assert 1000 < len(events) < 8000


def test_a_bag_without_messages_is_refused(tmp_path: Path):
    with Bag(tmp_path / "bag") as bag:
        bag.topic("/imu", IMU)
    with (
        pytest.raises(RecordingError, match=r"^bag has no messages\.$"),
        open_bag(tmp_path / "bag"),
    ):
        pass


def test_a_fault_of_the_one_who_plays_is_not_blamed_on_the_bag(tmp_path: Path):
    with pytest.raises(ZeroDivisionError), open_bag(write(tmp_path / "bag")) as bag:
        for _ in bag.events(bag.topics):
            raise ZeroDivisionError
