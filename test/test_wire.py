"""The layouts of the messages, against the serialisers of rosbags and of ROS itself."""

from __future__ import annotations

import numpy as np
import pytest
from recorded import START, Bag

from stateful_ahrs.errors import RecordingError
from stateful_ahrs.recordings import wire

pytest.importorskip("rosbags")

ROTOR = (0.5, -0.5, 0.1, 0.7)
ENCODINGS = ["little-endian CDR", "big-endian CDR", "ROS 1"]


@pytest.fixture(params=ENCODINGS)
def bag(request, tmp_path):
    suffix = ".bag" if request.param == "ROS 1" else ""
    return Bag(tmp_path / f"bag{suffix}", big_endian=request.param == "big-endian CDR")


@pytest.mark.parametrize("kind", wire.ROTORS)
def test_rotor_and_stamp_are_found_behind_names_of_any_length(bag, kind):
    frames = ["f" * n for n in range(10)] + ["map", "map"]
    stamps = START + np.arange(len(frames))
    messages = [
        bag.bytes(bag.truth(kind, stamp, ROTOR, frame))
        for stamp, frame in zip(stamps.tolist(), frames, strict=True)
    ]
    found, values = wire.decode(kind, messages, ros1=bag.ros1)
    x = wire.ROTORS[kind]
    assert found.tolist() == stamps.tolist()
    assert values[:, [x + 3, x, x + 1, x + 2]].tolist() == [list(ROTOR)] * len(frames)


def test_every_number_of_an_imu_and_a_magnetic_field_is_found(bag):
    imu = bag.imu(START, (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), ROTOR)
    _, values = wire.decode(wire.IMU, [bag.bytes(imu)], ros1=bag.ros1)
    assert values.shape == (1, 37)
    assert values[0, 13:16].tolist() == [1.0, 2.0, 3.0]
    assert values[0, 25:28].tolist() == [4.0, 5.0, 6.0]
    assert values[0, [4, 16, 28]].tolist() == [-1.0, 0.0, 0.0]
    _, values = wire.decode(
        wire.MAGNETIC_FIELD, [bag.bytes(bag.mag(START, (7.0, 8.0, 9.0), 2.0))], ros1=bag.ros1
    )
    assert values[0, :4].tolist() == [7.0, 8.0, 9.0, 2.0]


def test_bools_are_found(bag):
    messages = [bag.bytes(bag.bool(value)) for value in (True, False)]
    assert wire.decode_bool(messages, ros1=bag.ros1)[1].tolist() == [[1.0], [0.0]]


def test_what_is_encoded_is_what_rosbags_serialises(tmp_path):
    bag = Bag(tmp_path / "bag")
    for frame in ("map", "imu_link", "a_frame"):
        imu = np.zeros((1, 37))
        imu[0, :5] = [*ROTOR[1:], ROTOR[0], -1.0]
        imu[0, 13:16], imu[0, 25:28] = (1.0, 2.0, 3.0), (4.0, 5.0, 6.0)
        message = bag.imu(START, (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), ROTOR, frame=frame)
        assert [*wire.encode(wire.IMU, frame, np.array([START]), imu)] == [bag.bytes(message)]
        rotor = np.array([[*ROTOR[1:], ROTOR[0]]])
        message = bag.truth(wire.QUATERNION, START, ROTOR, frame)
        found = [*wire.encode(wire.QUATERNION, frame, np.array([START]), rotor)]
        assert found == [bag.bytes(message)]
    assert wire.encode_bool(True) == bag.bytes(bag.bool(True))
    assert wire.encode_bool(False) == bag.bytes(bag.bool(False))


def test_what_is_encoded_is_what_ros_reads():
    serialization = pytest.importorskip("rclpy.serialization", reason="no ROS here")
    from sensor_msgs.msg import MagneticField

    values = np.arange(12.0)[None]
    (data,) = wire.encode(wire.MAGNETIC_FIELD, "imu_link", np.array([START]), values)
    message = serialization.deserialize_message(data, MagneticField)
    assert message.header.frame_id == "imu_link"
    assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == START
    assert [message.magnetic_field.x, message.magnetic_field.y] == [0.0, 1.0]
    assert message.magnetic_field_covariance.tolist() == [*range(3, 12)]
    assert len(serialization.serialize_message(message)) == len(data)


def test_a_message_cut_short_is_refused(bag):
    message = bag.bytes(bag.imu(START))
    with pytest.raises(RecordingError, match="too short for a sensor_msgs/msg/Imu"):
        wire.decode(wire.IMU, [message, message[:-1]], ros1=bag.ros1)


def test_a_message_that_is_no_cdr_is_refused(tmp_path):
    with pytest.raises(RecordingError, match=r"begins with 28b5: not a .*Imu in CDR"):
        wire.decode(wire.IMU, [b"\x28\xb5\x2f\xfd" + bytes(400)])
    with pytest.raises(RecordingError, match="begins with nothing"):
        wire.decode(wire.IMU, [b""])
