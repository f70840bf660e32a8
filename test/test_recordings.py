"""Bags and tables in, bags out."""

from __future__ import annotations

import dataclasses
import sys

import numpy as np
import pytest
from recorded import START, Bag, recording

from stateful_ahrs.errors import AhrsError, RecordingError, TopicError
from stateful_ahrs.recordings import Recording, load, samples, wire, write

pytest.importorskip("rosbags")

STEP = 5_000_000  # ns


def same(found: Recording, expected: Recording) -> bool:
    """Equal bit for bit in every stream, in the rows where the reference is known."""
    assert expected.reference is not None and expected.reference_stamps is not None
    known = ~np.isnan(expected.reference).any(axis=1)
    pairs = [
        (found.stamps, expected.stamps),
        (found.gyro, expected.gyro),
        (found.accel, expected.accel),
        (found.mag_stamps, expected.mag_stamps),
        (found.mag, expected.mag),
        (found.reference_stamps, expected.reference_stamps[known]),
        (found.reference, expected.reference[known]),
        (found.movement, expected.movement[known]),
    ]
    return all(np.array_equal(a, b, equal_nan=a.dtype == float) for a, b in pairs)


# Out and in again


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_what_is_written_is_loaded_bit_for_bit(tmp_path, storage):
    out = recording(20_000)  # more than a block of messages, more than a chunk of mcap
    out.mag[5] = np.nan
    write(out, tmp_path / "noise", storage)
    found = load(tmp_path / "noise")
    assert same(found, out)
    assert found.name == "noise"
    assert found.left_out == ()


@pytest.mark.parametrize(("storage", "file"), [("mcap", "noise.mcap"), ("sqlite3", "noise.db3")])
def test_the_file_of_a_bag_is_read_without_its_folder(tmp_path, storage, file):
    write(recording(), tmp_path / "noise", storage)
    (tmp_path / "noise" / file).rename(tmp_path / file)
    assert same(load(tmp_path / file), recording())


def test_a_recording_of_six_axes_without_truth_comes_back_as_such(tmp_path):
    out = dataclasses.replace(
        recording(truth=False), mag_stamps=np.empty(0, np.int64), mag=np.empty((0, 3))
    )
    write(out, tmp_path / "six")
    found = load(tmp_path / "six")
    assert found.mag.shape == (0, 3)
    assert found.reference is None and found.movement is None
    assert np.isnan(samples(found).mag).all()


def test_a_looped_recording_comes_back_in_the_order_received(tmp_path):
    once = recording(40)
    n, k = len(once), len(once.mag)
    span = n * STEP
    looped = Recording(
        name="looped",
        stamps=np.tile(once.stamps, 3),
        gyro=np.arange(9.0 * n).reshape(-1, 3),
        accel=np.zeros((3 * n, 3)),
        mag_stamps=np.tile(once.mag_stamps, 3),
        mag=np.arange(9.0 * k).reshape(-1, 3),
        received=np.concatenate([once.stamps + lap * span for lap in range(3)]),
        mag_received=np.concatenate([once.mag_stamps + lap * span for lap in range(3)]),
    )
    write(looped, tmp_path / "looped")
    found = load(tmp_path / "looped")
    assert np.array_equal(found.stamps, looped.stamps)
    assert np.array_equal(found.gyro, looped.gyro)
    assert np.array_equal(found.mag, looped.mag)
    paired = samples(found).mag.reshape(3, n, 3)
    for lap in range(3):
        assert np.array_equal(np.isnan(paired[lap]), np.isnan(paired[0]))
    assert np.isnan(paired[0]).any(axis=1).sum() == n - k


def test_stamps_that_jump_back_need_times_of_reception():
    with pytest.raises(ValueError, match="in the order received"):
        dataclasses.replace(recording(), stamps=recording().stamps[::-1])


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_what_belongs_to_an_imu_message_comes_before_it(tmp_path, storage):
    from rosbags.rosbag2 import Reader

    write(recording(mag_every=1), tmp_path / "noise", storage)
    last: dict[int, list[str]] = {}
    with Reader(tmp_path / "noise") as reader:
        received = []
        for connection, time, _ in reader.messages(connections=reader.connections):
            received.append(time)
            last.setdefault(time, []).append(connection.topic)
    assert received == sorted(received)
    assert all(topics[-2:] == ["/imu/mag", "/imu/data_raw"] for topics in last.values())
    assert last[START][0] == "/ground_truth/movement"


def test_a_bag_says_what_jazzy_reads(tmp_path):
    from rosbags.interfaces import QosDurability, QosReliability
    from rosbags.rosbag2 import Reader
    from ruamel.yaml import YAML

    write(recording(), tmp_path / "noise")
    metadata = YAML(typ="safe").load((tmp_path / "noise" / "metadata.yaml").read_text())
    metadata = metadata["rosbag2_bagfile_information"]
    assert metadata["version"] == 9
    assert metadata["storage_identifier"] == "mcap"
    assert metadata["message_count"] == 50 + 25 + 45 + 4
    with Reader(tmp_path / "noise") as reader:
        topics = {c.topic: c for c in reader.connections}
    assert {name: c.msgtype for name, c in topics.items()} == {
        "/imu/data_raw": "sensor_msgs/msg/Imu",
        "/imu/mag": "sensor_msgs/msg/MagneticField",
        "/ground_truth": "geometry_msgs/msg/QuaternionStamped",
        "/ground_truth/movement": "std_msgs/msg/Bool",
    }
    for name, connection in topics.items():
        assert connection.digest.startswith("RIHS01_")
        assert connection.msgdef.data
        (qos,) = connection.ext.offered_qos_profiles
        assert qos.reliability is QosReliability.RELIABLE
        latched = name == "/ground_truth/movement"
        assert (qos.durability is QosDurability.TRANSIENT_LOCAL) == latched


def test_an_existing_folder_is_refused_and_kept(tmp_path):
    write(recording(), tmp_path / "noise")
    with pytest.raises(RecordingError, match="noise exists already; --overwrite replaces it"):
        write(recording(30), tmp_path / "noise")
    assert len(load(tmp_path / "noise")) == 50
    write(recording(30), tmp_path / "noise", overwrite=True)
    assert len(load(tmp_path / "noise")) == 30


def test_a_folder_that_is_no_bag_is_never_replaced(tmp_path):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "one.jpg").write_bytes(b"dear")
    with pytest.raises(RecordingError, match="not a rosbag2 folder: not replaced"):
        write(recording(), tmp_path / "photos", overwrite=True)
    assert (tmp_path / "photos" / "one.jpg").read_bytes() == b"dear"


def test_writing_that_fails_leaves_nothing_and_keeps_what_was(tmp_path):
    def interrupt(_: float) -> None:
        raise KeyboardInterrupt

    write(recording(30), tmp_path / "noise")
    with pytest.raises(KeyboardInterrupt):
        write(recording(), tmp_path / "noise", overwrite=True, progress=interrupt)
    assert [path.name for path in tmp_path.iterdir()] == ["noise"]
    assert len(load(tmp_path / "noise")) == 30


def test_a_folder_that_cannot_be_made_is_a_sentence(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match="cannot be written: "):
        write(recording(), tmp_path / "file" / "bag")


# Which topics


@pytest.fixture(params=["bag", "bag.bag"], ids=["ROS 2", "ROS 1"])
def bag(request, tmp_path):
    return Bag(tmp_path / request.param)


def load_bag(bag: Bag, reference: str | None = None) -> Recording:
    return load(bag.writer.path, reference)


def test_the_raw_of_several_imu_topics_is_taken_with_the_nearest_magnetometer(bag):
    with bag:
        bag.add("/b/imu/data", bag.imu(START, gyro=(9.0, 9.0, 9.0)), START)
        bag.add("/b/imu/data_raw", bag.imu(START), START)
        bag.add("/a/imu/mag", bag.mag(START, (9.0, 9.0, 9.0)), START)
        bag.add("/b/imu/mag", bag.mag(START), START)
    found = load_bag(bag)
    assert found.gyro.tolist() == [[0.1, 0.2, 0.3]]
    assert found.accel.tolist() == [[1.0, 2.0, 9.0]]
    assert found.mag.tolist() == [[1e-5, 2e-5, 3e-5]]
    assert set(found.left_out) == {
        "/b/imu/data (sensor_msgs/msg/Imu)",
        "/a/imu/mag (sensor_msgs/msg/MagneticField)",
    }


def test_the_only_imu_topic_is_taken_whatever_its_name(bag):
    with bag:
        bag.add("/chip", bag.imu(START), START)
    assert len(load_bag(bag)) == 1


def test_a_bag_without_an_imu_topic_says_what_it_has(bag):
    odometry = "nav_msgs/msg/Odometry"
    with bag:
        bag.add("/odom", bag.truth(odometry, START, (1.0, 0.0, 0.0, 0.0)), START)
        bag.add("/imu/mag", bag.mag(START), START)
    with pytest.raises(TopicError) as error:
        load_bag(bag)
    assert str(error.value) == (
        f"{bag.writer.path.name} has no sensor_msgs/msg/Imu topic. It has: "
        "/odom (nav_msgs/msg/Odometry), /imu/mag (sensor_msgs/msg/MagneticField)."
    )


def test_a_bag_without_topics_says_so(tmp_path):
    with Bag(tmp_path / "bag"):
        pass
    with pytest.raises(TopicError, match=r"bag has no sensor_msgs/msg/Imu topic. It has no topics"):
        load(tmp_path / "bag")


def test_an_imu_topic_without_messages_says_so(tmp_path):
    with Bag(tmp_path / "bag") as bag:
        bag.topic("/imu/data_raw", wire.IMU)
        bag.add("/imu/mag", bag.mag(START), START)
    with pytest.raises(RecordingError, match="bag has no message on /imu/data_raw"):
        load(tmp_path / "bag")


@pytest.mark.parametrize("kind", wire.ROTORS)
def test_a_reference_of_any_type_is_read(bag, kind):
    rotor = (0.5, -0.5, 0.1, 0.7)
    with bag:
        bag.add("/imu/data_raw", bag.imu(START), START)
        bag.add("/truth/of/it", bag.truth(kind, START + 3, rotor), START)
    assert load_bag(bag).reference is None
    for topic in ("/truth/of/it", "truth/of/it"):
        found = load_bag(bag, topic)
        assert found.reference.tolist() == [list(rotor)]
        assert found.reference_stamps.tolist() == [START + 3]


def test_ground_truth_is_found_in_any_namespace(bag):
    with bag:
        bag.add("/robot/imu/data_raw", bag.imu(START), START)
        truth = bag.truth(wire.QUATERNION, START, (0.0, 1.0, 0.0, 0.0))
        bag.add("/robot/ground_truth", truth, START)
    assert load_bag(bag).reference.tolist() == [[0.0, 1.0, 0.0, 0.0]]


def test_a_reference_topic_that_is_not_there_or_has_no_orientation_is_refused(bag):
    with bag:
        bag.add("/imu/data_raw", bag.imu(START), START)
        bag.add("/imu/mag", bag.mag(START), START)
    with pytest.raises(TopicError, match=r"has no topic /mocap\. It has: /imu/data_raw \("):
        load_bag(bag, "/mocap")
    with pytest.raises(TopicError, match=r"/imu/mag \(.*MagneticField\) has no orientation; a ref"):
        load_bag(bag, "/imu/mag")


def test_movement_holds_from_one_message_to_the_next(bag):
    rotor = (1.0, 0.0, 0.0, 0.0)
    with bag:
        bag.add("/imu/data_raw", bag.imu(START), START)
        for n in range(6):
            if n in (1, 4):
                bag.add("/ground_truth/movement", bag.bool(n == 1), START + n)
            bag.add("/ground_truth", bag.truth(wire.QUATERNION, START + n, rotor), START + n)
    assert load_bag(bag).movement.tolist() == [False, True, True, True, False, False]


# What the numbers mean


def test_a_field_that_is_not_reported_is_nan(bag):
    with bag:
        bag.add("/imu/data_raw", bag.imu(START, unreported="angular_velocity"), START)
        bag.add("/imu/data_raw", bag.imu(START, unreported="linear_acceleration"), START)
        bag.add("/imu/mag", bag.mag(START, variance=-1.0), START)
    found = load_bag(bag)
    assert np.isnan(found.gyro).all(axis=1).tolist() == [True, False]
    assert np.isnan(found.accel).all(axis=1).tolist() == [False, True]
    assert np.isnan(found.mag).all()


def test_an_orientation_that_is_not_reported_or_zero_is_no_reference(bag):
    with bag:
        for n, name in enumerate(["orientation", "nothing"]):
            message = bag.imu(START + n, rotor=(0.0, 1.0, 0.0, 0.0), unreported=name)
            bag.add("/imu/data", message, START + n)
        zero = bag.imu(START + 2, rotor=(0.0, 0.0, 0.0, 0.0), unreported="")
        bag.add("/imu/data", zero, START + 2)
    found = load_bag(bag, "/imu/data").reference
    assert np.isnan(found).all(axis=1).tolist() == [True, False, True]


def test_a_stamp_of_zero_is_replaced_by_the_time_of_reception(bag):
    with bag:
        bag.add("/imu/data_raw", bag.imu(0), START)
        bag.add("/imu/data_raw", bag.imu(START), START + STEP)
    found = load_bag(bag)
    assert found.stamps.tolist() == [START, START]
    assert found.received.tolist() == [START, START + STEP]


def test_samples_stand_in_the_order_received_not_of_their_stamps(bag):
    stamps = [START + STEP * n for n in (0, 2, 1, 3)]
    with bag:
        for n, stamp in enumerate(stamps):
            bag.add("/imu/data_raw", bag.imu(stamp), START + n)
    assert load_bag(bag).stamps.tolist() == stamps


def test_frame_names_may_change_within_a_topic(bag):
    with bag:
        for n in range(12):
            message = bag.imu(START + n, gyro=(n, 0.0, 0.0), frame="f" * (n // 3))
            bag.add("/imu/data_raw", message, START + n)
    assert load_bag(bag).gyro[:, 0].tolist() == list(range(12))


# Tables


HEADER = "stamp_ns,gx,gy,gz,ax,ay,az,mx,my,mz,qw,qx,qy,qz"


def load_csv(tmp_path, text: str) -> Recording:
    (tmp_path / "walk.csv").write_text(text)
    return load(tmp_path / "walk.csv")


def test_a_table_is_read_to_the_nanosecond(tmp_path):
    found = load_csv(
        tmp_path,
        f"{HEADER}\n{START},1,2,3,4,5,6,1e-5,2e-5,3e-5,1,0,0,0\n"
        f"{START + 1},1,2,3,4,5,,,,,,,,\n\n{START + 2},1,2,3,4,5,6,nan,,3e-5,0,1,0,0\n",
    )
    assert found.name == "walk"
    assert found.stamps.tolist() == [START, START + 1, START + 2]
    assert found.gyro.tolist() == [[1.0, 2.0, 3.0]] * 3
    assert np.isnan(found.accel).tolist() == [[False] * 3, [False, False, True], [False] * 3]
    assert found.mag_stamps.tolist() == [START, START + 2]
    assert np.isnan(found.mag[1]).tolist() == [True, True, False]
    assert found.reference_stamps.tolist() == [START, START + 2]
    assert found.reference.tolist() == [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]


def test_a_table_in_seconds_keeps_its_decimals_and_begins_above_zero(tmp_path):
    row = "0,0,0,0,0,9.8"
    header = "az,ay,ax,gz,gy,gx,temperature,t\n".replace("az,ay,ax,gz,gy,gx", "gx,gy,gz,ax,ay,az")
    found = load_csv(tmp_path, f"{header}{row},20,1700000000.123456789\n{row},20,1700000001\n")
    assert found.stamps.tolist() == [START, 1_700_000_001_000_000_000]
    assert found.left_out == ("temperature",)
    assert found.mag.shape == (0, 3) and found.reference is None
    found = load_csv(tmp_path, f"{header}{row},20,-0.5\n{row},20,0.25\n")
    assert found.stamps.tolist() == [1_000_000_000, 1_750_000_000]


def test_a_looped_table_keeps_its_rows(tmp_path):
    rows = [f"{stamp},0,0,0,0,0,9.8,{n},0,0,,,," for n, stamp in enumerate([1, 2, 3, 1, 2, 3])]
    found = load_csv(tmp_path, "\n".join([HEADER, *rows]))
    assert found.stamps.tolist() == [1, 2, 3, 1, 2, 3]
    write(found, tmp_path / "bag")
    assert load(tmp_path / "bag").mag[:, 0].tolist() == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("\n", r"walk.csv lacks stamp_ns or t, gx, gy, gz, ax, ay, az; its header is 'empty', exp"),
        ("t;gx;gy\n", r"walk.csv lacks .*; its header is 't;gx;gy', expected stamp_ns or t, gx"),
        ("t,gx,gy,gz,ax,ay,az,mx\n", r"walk.csv lacks my, mz; its header"),
        (f"{HEADER}\n", r"walk.csv has a header and no rows"),
        (f"{HEADER}\n1,2,3\n", r"walk.csv, line 2: 3 cells, expected 14"),
        (f"{HEADER}\n1,x,3,4,5,6,7,8,9,0,,,,\n", r"walk.csv, line 2: gx is 'x', expected a number"),
        (f"{HEADER}\n1.5,1,3,4,5,6,7,,,,,,,\n", r"line 2: stamp_ns is '1.5', expected a whole"),
        (f"{HEADER}\n0,1,3,4,5,6,7,,,,,,,\n", r"walk.csv: stamp_ns must be above zero, got 0"),
        (f"{HEADER}\n{2**64},1,3,4,5,6,7,,,,,,,\n", r"line 2: stamp_ns is '18.*', which is no"),
        ("t,gx,gy,gz,ax,ay,az\nnan,1,2,3,4,5,6\n", r"line 2: t is 'nan', which is no time"),
        ("t,gx,gy,gz,ax,ay,az\n,1,2,3,4,5,6\n", r"line 2: t is '', expected a number"),
    ],
)
def test_a_table_that_is_not_one_is_refused_in_a_sentence(tmp_path, text, sentence):
    with pytest.raises(RecordingError, match=sentence):
        load_csv(tmp_path, text)


def test_a_binary_file_is_no_table(tmp_path):
    (tmp_path / "walk.csv").write_bytes(bytes(range(256)))
    with pytest.raises(RecordingError, match=r"walk.csv is not comma-separated text"):
        load(tmp_path / "walk.csv")


# The doors


def test_progress_grows_to_the_whole_and_not_beyond(tmp_path):
    seen: list[float] = []
    write(recording(20_000), tmp_path / "noise", progress=seen.append)
    assert len(seen) > 3 and seen == sorted(seen) and seen[0] >= 0.0 and seen[-1] <= 1.0
    seen.clear()
    load(tmp_path / "noise", progress=seen.append)
    assert len(seen) > 3 and seen == sorted(seen) and seen[0] > 0.0 and seen[-1] <= 1.0


@pytest.mark.parametrize(
    ("package", "file"), [("rosbags.rosbag1", "x.mcap"), ("rosbags.rosbag2", "x.bag")]
)
def test_a_missing_library_is_a_sentence_that_says_what_to_install(
    tmp_path, monkeypatch, package, file
):
    (tmp_path / file).write_bytes(b"x")
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(AhrsError, match=r"needs the Python package rosbags: pip install rosbags"):
        load(tmp_path / file)
