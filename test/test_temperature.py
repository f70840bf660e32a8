"""The temperature of a bag is the mean of what its sensor told."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags is not installed")

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from stateful_ahrs.errors import RecordingError
from stateful_ahrs.recordings.temperature import temperature
from stateful_ahrs.recordings.wire import TEMPERATURE, encode

TYPES = get_typestore(Stores.ROS2_JAZZY)


def bag(folder: Path, celsius: list[float]) -> Path:
    values = np.column_stack([celsius, np.zeros(len(celsius))])
    stamps = np.arange(1, len(celsius) + 1, dtype=np.int64)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/imu/temperature", TEMPERATURE, typestore=TYPES)
        for stamp, message in zip(stamps, encode(TEMPERATURE, "imu", stamps, values), strict=True):
            assert TYPES.deserialize_cdr(message, TEMPERATURE).header.frame_id == "imu"
            writer.write(topic, int(stamp), message)
    return folder


def test_it_is_the_mean_of_all_that_are_numbers(tmp_path: Path):
    assert temperature(bag(tmp_path / "b", [30.0, math.nan, 33.0])) == 31.5


def test_a_bag_without_one_tells_none(tmp_path: Path):
    assert temperature(Path(__file__).parent / "bags" / "turns") is None
    assert temperature(bag(tmp_path / "b", [math.nan])) is None


def test_a_file_that_is_no_bag_is_refused(tmp_path: Path):
    (tmp_path / "b.mcap").write_bytes(b"nothing")
    with pytest.raises(RecordingError, match=r"b\.mcap is damaged or not a bag"):
        temperature(tmp_path / "b.mcap")
