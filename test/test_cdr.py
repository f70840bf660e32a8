"""The fast lane against ROS's own serialisation, byte for byte."""

from __future__ import annotations

import math
import random
import struct

import pytest
from recorded import START, Bag

from stateful_ahrs.nodes import cdr

pytest.importorskip("rclpy", reason="ROS 2 is neither sourced nor installed from PyPI")

from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Imu, MagneticField

from stateful_ahrs.nodes.lane import FastLane, Lane

MESSAGES = 3000
FRAMES = 70  # lengths: every alignment, and more than any name
ODD = (0.0, -0.0, -1.0, math.inf, -math.inf, 5e-324, 1e308)


def numbers(source, count):
    return [
        source.choice(ODD) if source.random() < 0.2 else source.uniform(-1e3, 1e3)
        for _ in range(count)
    ]


def arguments(source, lane):
    """What a random Imu is written of."""
    covariances = [lane.covariance(numbers(source, 9)) for _ in range(3)]
    vectors = [tuple(numbers(source, count)) for count in (4, 3, 3)]
    parts = (part for pair in zip(vectors, covariances, strict=True) for part in pair)
    return (source.randrange(-(2**60), 2**60), lane.frame("é" * source.randrange(FRAMES)), *parts)


def serialized(message):
    """ROS's bytes, with zeros where it leaves what was in its memory: behind the frame's NUL."""
    data = bytearray(serialize_message(message))
    end = 16 + struct.unpack_from("<I", data, 12)[0]
    start = end + (4 - end) % 8
    data[end:start] = bytes(start - end)
    return bytes(data)


@pytest.mark.parametrize("method", ["imu", "magnetic_field", "vector"])
def test_what_is_written_is_what_ros_writes(method):
    fast, slow = FastLane(), Lane()
    for seed in range(MESSAGES):
        ours, theirs = (arguments(random.Random(seed), lane) for lane in (fast, slow))
        if method == "magnetic_field":
            ours, theirs = ours[:2] + ours[4:6], theirs[:2] + theirs[4:6]
        elif method == "vector":
            ours, theirs = ours[:2] + ours[4:5], theirs[:2] + theirs[4:5]
        assert getattr(fast, method)(*ours) == serialized(getattr(slow, method)(*theirs)), seed


@pytest.mark.parametrize("value", ODD)
def test_a_number_is_what_ros_writes(value):
    assert FastLane().number(value) == serialize_message(Lane().number(value))


def test_what_ros_writes_is_read():
    fast, slow = FastLane(), Lane()
    for seed in range(MESSAGES):
        source = random.Random(seed)
        message = slow.imu(*arguments(source, slow))
        field = slow.magnetic_field(
            source.randrange(2**60), "f" * source.randrange(FRAMES), (1.0, 2.0, 3.0),
            numbers(source, 9),
        )  # fmt: skip
        *ours, passed_on = fast.inertial(serialized(message))
        *theirs, _ = slow.inertial(message)
        assert repr(ours) == repr(theirs)
        assert fast.frame_of(passed_on) == fast.frame(slow.frame_of(message))
        assert repr(fast.magnetic(serialize_message(field))) == repr(slow.magnetic(field))
    assert (fast.slow, fast.malformed) == (0, 0)


@pytest.mark.parametrize("other", ["", "stamped", "without_rates", "without_force"])
def test_what_is_passed_on_is_what_ros_writes(other):
    fast, slow = FastLane(), Lane()
    for seed in range(MESSAGES):
        source = random.Random(seed)
        theirs = slow.imu(*arguments(source, slow))
        *_, ours = fast.inertial(serialized(theirs) + bytes(seed % 3))  # bytes behind it stay out
        if other:
            new = (source.randrange(2**60),) if other == "stamped" else ()
            ours, theirs = (
                getattr(lane, other)(each, *new) for lane, each in ((fast, ours), (slow, theirs))
            )
        rotor, gyro = tuple(numbers(source, 4)), tuple(numbers(source, 3))
        covariance = numbers(source, 9)
        ours = fast.oriented(ours, rotor, fast.covariance(covariance), gyro)
        assert ours == serialized(slow.oriented(theirs, rotor, covariance, gyro)), seed


@pytest.mark.parametrize("name", ["", "map", "imu_link"])
def test_a_frame_keeps_its_name(name):
    assert cdr.name(cdr.frame(name)) == name


def test_a_message_cut_short_anywhere_is_refused():
    whole = serialize_message(Lane().imu(*arguments(random.Random(1), Lane())))
    for read, size in ((cdr.inertial, len(whole)), (cdr.magnetic, len(whole) - 25 * 8)):
        for length in range(size):
            with pytest.raises(cdr.ForeignError):
                read(whole[:length])
    read(whole[:size])


@pytest.mark.parametrize("length", [2**31, 2**32 - 1])
def test_a_name_longer_than_the_message_is_refused(length):
    data = b"\x00\x01\x00\x00" + struct.pack("<iII", 1, 2, length) + bytes(400)
    with pytest.raises(cdr.ForeignError):
        cdr.inertial(data)


def other_encodings(tmp_path):
    """The bytes of a message and how they are to be read, by encoding."""
    pytest.importorskip("rosbags")
    bag = Bag(tmp_path / "bag", big_endian=True)
    imu, mag = bag.imu(START, frame="map"), bag.mag(START)
    yield Imu, bag.bytes(imu), "big-endian"
    yield MagneticField, bag.bytes(mag), "big-endian"
    message = Imu()
    message.header.frame_id = "map"  # with which XCDR2, aligned to four bytes, looks the same
    yield Imu, b"\x00\x07" + serialize_message(message)[2:], "XCDR2"


def test_another_encoding_leaves_the_fast_lane_and_is_counted(tmp_path):
    fast, slow = FastLane(), Lane()
    for kind, data, encoding in other_encodings(tmp_path):
        read = "inertial" if kind is Imu else "magnetic"
        with pytest.raises(cdr.ForeignError):
            getattr(cdr, read)(data)
        before = fast.slow
        found = getattr(fast, read)(data)
        expected = getattr(slow, read)(deserialize_message(data, kind))
        assert found[:2] == expected[:2], encoding  # stamp, and rates or field
        assert (fast.slow, fast.malformed) == (before + 1, 0)


def test_nanoseconds_beyond_a_second_are_malformed():
    data = bytearray(serialize_message(Lane().imu(*arguments(random.Random(1), Lane()))))
    struct.pack_into("<iI", data, 4, 2**31 - 1, 2**32 - 1)
    fast = FastLane()
    assert fast.inertial(bytes(data)) is None
    assert fast.magnetic(bytes(data)) is None
    assert (fast.slow, fast.malformed) == (0, 2)
    slow, imu, mag = Lane(), Imu(), MagneticField()
    imu.header.stamp.nanosec = mag.header.stamp.nanosec = 1_000_000_000
    assert slow.inertial(imu) is None
    assert slow.magnetic(mag) is None
    assert slow.malformed == 2


@pytest.mark.parametrize("data", [b"", b"\x00\x01", b"\x00\x01\x00\x00" + bytes(50)])
def test_what_nobody_can_read_is_none_and_counted(data):
    fast = FastLane()
    assert fast.inertial(data) is None
    assert fast.magnetic(data) is None
    assert (fast.malformed, fast.slow) == (2, 0)
