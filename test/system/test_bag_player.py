"""The running bag_player: every message, in order, in time."""

from __future__ import annotations

import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="bags need rosbags: pip install 'stateful_ahrs[bags]'")

from geometry_msgs.msg import QuaternionStamped
from graph import Graph, interrupt, nanoseconds, until
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, MagneticField

from stateful_ahrs.nodes import bag_player
from stateful_ahrs.nodes.qos import SENSOR_SUBSCRIBER
from stateful_ahrs.recordings import Recording, load, write

BAGS = Path(__file__).parents[1] / "bags"
SHORT = BAGS / "short"  # 1.98 s at 100 Hz
SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def dense(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds at 1 kHz, with a field at each sample."""
    folder = tmp_path_factory.mktemp("bags") / "dense"
    stamps = SECOND + np.arange(2000) * (SECOND // 1000)
    level = np.tile([0.0, 0.0, 9.81], (2000, 1))
    write(Recording("dense", stamps, 0.0 * level, level, stamps, 1e-5 * level), folder)
    return folder


def test_at_1_khz_none_is_lost_and_the_time_does_not_drift(graph: Graph, dense: Path):
    heard, late = [], []

    def on_imu(message: Imu) -> None:
        heard.append(nanoseconds(message))
        late.append(time.monotonic_ns() - heard[-1])

    graph.node.create_subscription(Imu, "/imu/data_raw", on_imu, SENSOR_SUBSCRIBER)
    field = []
    graph.node.create_subscription(MagneticField, "/imu/mag", field.append, SENSOR_SUBSCRIBER)
    assert graph.start("bag_player", str(dense)).wait() == 0
    stamps = load(dense).stamps.tolist()
    until(lambda: len(heard) == len(field) == len(stamps), "all samples")
    assert heard == [nanoseconds(message) for message in field] == stamps
    # Sleeping from message to message would add 0.1 ms each, 100 ms in a half. The least delay
    # of a half is free of the machine's hiccups.
    assert abs(min(late[1000:]) - min(late[:1000])) < 20_000_000


def test_a_loop_jumps_back_with_its_clock_and_sigint_ends_it(graph: Graph):
    clock: list[Clock] = []
    profile = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)  # of use_sim_time
    graph.node.create_subscription(Clock, "/clock", clock.append, profile)
    heard = graph.hear(Imu, "/imu/data_raw")
    player = graph.start("bag_player", "--loop", "--rate", "4", str(SHORT), "--clock", "200")
    stamps = load(SHORT).stamps.tolist()
    until(lambda: len(heard) > 2 * len(stamps), "the third pass")
    before = time.monotonic()
    assert player.end(signal.SIGINT) == 0
    assert time.monotonic() - before < 1.0
    assert "Traceback" not in player.said
    passes = [nanoseconds(message) for message in heard]
    assert passes[: 2 * len(stamps) + 1] == [*stamps, *stamps, stamps[0]]

    ticks = np.array([tick.clock.sec * SECOND + tick.clock.nanosec for tick in clock])
    steps = np.diff(ticks)
    assert np.count_nonzero(steps < 0) == 2
    # 200 Hz of the wall's time at four times the speed
    assert np.median(steps[steps > 0]) == pytest.approx(0.02 * SECOND)
    received = load(SHORT).received
    assert received[0] - 0.1 * SECOND < ticks.min() <= ticks.max() <= received[-1]


def test_topics_can_be_moved_and_what_was_played_outlasts_the_player(graph: Graph):
    heard = graph.hear(Imu, "/robot/raw")
    field = graph.hear(MagneticField, "/imu/mag")
    truth = graph.hear(QuaternionStamped, "/ground_truth")
    player = graph.start(
        "bag_player", str(SHORT), "--rate", "10", "--ros-args", "-r", "/imu/data_raw:=/robot/raw",
        "-r", "__ns:=/robot",
    )  # fmt: skip
    until(lambda: heard, "the first sample")
    first = time.monotonic()
    assert player.wait() == 0
    assert time.monotonic() - first < 1.5  # of 1.98 s
    count = len(load(SHORT))
    until(lambda: len(heard) == len(field) == len(truth) == count, "all messages")


def test_a_type_that_is_not_installed_is_named_and_the_rest_is_played(graph: Graph, tmp_path: Path):
    types = get_typestore(Stores.ROS2_JAZZY)
    types.register(get_types_from_msg("float64 knots", "sail_msgs/msg/Wind"))
    wind = types.types["sail_msgs/msg/Wind"](knots=5.0)
    clock = types.types["builtin_interfaces/msg/Time"](sec=1, nanosec=2)
    with Writer(tmp_path / "sail", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        to_wind = writer.add_connection("/wind", "sail_msgs/msg/Wind", typestore=types)
        to_time = writer.add_connection("/time", "builtin_interfaces/msg/Time", typestore=types)
        for at in range(3):
            writer.write(to_wind, at, types.serialize_cdr(wind, "sail_msgs/msg/Wind"))
        writer.write(to_time, at, types.serialize_cdr(clock, "builtin_interfaces/msg/Time"))

    from builtin_interfaces.msg import Time

    heard = graph.hear(Time, "/time")
    player = graph.start("bag_player", str(tmp_path / "sail"))
    assert player.wait() == 0
    until(lambda: heard == [Time(sec=1, nanosec=2)], "the time")
    assert player.said.count("/wind (sail_msgs/msg/Wind)") == 1
    assert "its 3 messages left out: its type is not installed here." in player.said


@pytest.mark.parametrize("step", ["_advertise", "_await_subscribers"])
def test_ctrl_c_amid_the_start_plays_nothing_and_is_no_error(
    step: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
):
    interrupt(monkeypatch, bag_player.Player, step)
    monkeypatch.setattr("sys.argv", ["bag_player", str(SHORT)])
    with pytest.raises(SystemExit, match=r"^0$"):
        bag_player.main()
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (["gone"], 1, "gone: no such file or folder."),
        (["notes.txt"], 1, "notes.txt: unknown suffix '.txt', expected a rosbag2 folder, .mcap"),
        (["broken.mcap"], 1, "broken.mcap is damaged or not a bag"),
        (["bare"], 1, "bare is a folder without metadata.yaml"),
        ([], 2, "the following arguments are required: BAG"),
        (["short", "--rate", "0"], 2, "--rate: must be between 0.001 and 1000, got '0'"),
        (["short", "--rate", "nan"], 2, "--rate: must be between 0.001 and 1000, got 'nan'"),
        (["--clock", "short"], 2, "--clock: must be between 0.1 and 10000, got 'short'"),
        (["short", "--ros-args", "-r", "nonsense"], 2, "the ROS arguments cannot be used"),
    ],
)
def test_bad_input_gets_one_sentence(
    arguments: list[str],
    code: int,
    sentence: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
):
    (tmp_path / "notes.txt").write_text("words")
    (tmp_path / "broken.mcap").write_bytes((BAGS / "turns" / "turns.mcap").read_bytes()[:50_000])
    (tmp_path / "bare").mkdir()
    (tmp_path / "short").symlink_to(SHORT)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["bag_player", *arguments])
    with pytest.raises(SystemExit) as ended:
        bag_player.main()
    said = capfd.readouterr().err
    assert ended.value.code == code
    assert said.startswith("bag_player: ") and said.count("\n") == 1 and sentence in said
