"""The real executables: calibrate on bags and live topics, and the driver with what it wrote."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is neither sourced nor installed from PyPI")
pytest.importorskip("yaml", reason="PyYAML is not installed")
pytest.importorskip("scipy", reason="scipy is not installed")

import edge
import numpy as np
from diagnostic_msgs.srv import SelfTest
from edge import Health, shim
from graph import Graph, interrupt, nanoseconds, until
from sensor_msgs.msg import Imu, MagneticField
from std_srvs.srv import Trigger

sys.path.insert(0, str(Path(__file__).parents[1]))

from simulated import simulated
from uncalibrated import HARD, RAW

from stateful_ahrs.mpu9250.burst import AXES
from stateful_ahrs.mpu9250.calibration import Calibration, Correction
from stateful_ahrs.mpu9250.calibration_file import load, save
from stateful_ahrs.mpu9250.world import Errors
from stateful_ahrs.nodes import calibrate as program
from stateful_ahrs.recordings import write

BAGS = Path(__file__).parents[1] / "bags"
OK = 0

__all__ = ["shim"]
DAY = "2026-03-01T10:00:00+00:00"


@pytest.fixture(scope="module")
def tumble(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag in which an uncalibrated sensor tumbles and then rests."""
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    folder = tmp_path_factory.mktemp("bags") / "tumble"
    write(simulated("sphere", 36.0, errors=RAW), folder)
    return folder


def calibrate(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run the executable to its end."""
    return subprocess.run(
        [sys.executable, "-m", "stateful_ahrs.nodes.calibrate", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=60.0,
    )


@pytest.fixture
def here(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str]]:
    """Calls what the executable calls, where that joins no graph: exit code and stderr."""

    def call(*arguments: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["calibrate", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            program.main()
        return int(ended.value.code or 0), capsys.readouterr().err

    return call


def mean_rate(imu: list[Imu]) -> np.ndarray:
    rates = [m.angular_velocity for m in imu]
    return np.array([(r.x, r.y, r.z) for r in rates]).mean(axis=0)


# --- from a bag ----------------------------------------------------------------------------------


def test_a_bag_calibrates_all_three_sensors_into_one_file(tumble: Path, tmp_path: Path):
    path = tmp_path / "c.yaml"
    for kind in ("gyro", "accel", "mag"):
        ended = calibrate(kind, "--bag", tumble, "-o", path)
        assert (ended.returncode, ended.stderr) == (0, "")
        assert str(path) in ended.stdout
    found = load(path)
    assert found.sensor == "tumble"
    assert found.gyro.offset == pytest.approx(RAW.gyro_bias, abs=1e-3)
    assert found.accel.offset == pytest.approx(RAW.accel_offset, abs=0.03)
    assert np.array(found.accel.matrix) @ np.array(RAW.accel_scale) == pytest.approx(
        np.eye(3), abs=0.002
    )
    assert found.mag.offset == pytest.approx(HARD, abs=0.2e-6)
    for correction in (found.gyro, found.accel, found.mag):
        assert correction.date.startswith("20")
        assert correction.quality
    again = calibrate("mag", "--bag", tumble, "-o", path, "--sensor", "left foot")
    assert again.returncode == 0
    assert load(path).sensor == "left foot"
    assert (load(path).gyro, load(path).accel) == (found.gyro, found.accel)


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        ("gyro", "rested for"),
        ("accel", "Still to be held for 1 s: "),
        ("mag", "of the sphere, expected 50 or more"),
    ],
)
def test_a_bag_that_supports_no_fit_is_refused_and_nothing_is_written(
    tmp_path: Path, kind: str, sentence: str, here: Callable[..., tuple[int, str]]
):
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    code, said = here(kind, "--bag", BAGS / "turns", "-o", tmp_path / "c.yaml")
    assert code == 1
    assert sentence in said
    assert said.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


WRONG: list[tuple[list[str], int, str]] = [
    ([], 2, "gyro|accel|mag"),
    (["compass"], 2, "invalid choice: 'compass'"),
    (["mag", "--bag", "none.mcap"], 1, "none.mcap: no such file"),
    (["mag", "--bag", "x.mcap", "--mag", "/field"], 2, "--mag name live topics"),
    (["mag", "-o", "none/c.yaml"], 2, "none/c.yaml is no place for a file"),
    (["mag", "-o", "."], 2, ". is no place for a file"),
    (["accel", "--gravity", "1"], 2, "--gravity must be between 9.7 and 9.9"),
    (["accel", "--positions", "5"], 2, "--positions must be 6 or more"),
]


@pytest.mark.parametrize(("arguments", "code", "sentence"), WRONG)
def test_wrong_arguments_get_a_sentence(
    arguments: list[str], code: int, sentence: str, here: Callable[..., tuple[int, str]]
):
    ended = here(*arguments)
    assert ended[0] == code
    assert sentence in ended[1]


def test_a_topic_that_can_be_none_gets_a_sentence():
    ended = calibrate("mag", "--mag", "no topic")
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1)
    assert "'no topic' is no topic" in ended.stderr


def test_a_file_that_is_no_calibration_is_refused_before_the_work(tmp_path: Path):
    path = tmp_path / "c.yaml"
    path.write_text("gyro: 1")
    ended = calibrate("mag", "-o", path)  # live, and nobody publishes
    assert ended.returncode == 1
    assert "unknown key 'gyro'" in ended.stderr
    assert path.read_text() == "gyro: 1"


# --- live ----------------------------------------------------------------------------------------


def test_a_live_sensor_at_rest_gets_its_bias_and_temperature(graph: Graph, tmp_path: Path):
    path = tmp_path / "c.yaml"
    graph.start("imu_driver", sim_motion="rest")
    calibrating = graph.start("calibrate", "gyro", "-o", str(path))
    assert calibrating.wait(40.0) == 0, calibrating.said
    found = load(path)
    assert found.sensor == "imu_link"
    assert found.gyro.offset == pytest.approx(Errors().gyro_bias, abs=3e-4)
    assert found.gyro.temperature == pytest.approx(25.0, abs=0.1)


def test_a_live_tumble_ends_by_itself_when_it_is_enough(graph: Graph, tumble: Path, tmp_path: Path):
    path = tmp_path / "c.yaml"
    calibrating = graph.start("calibrate", "mag", "-o", str(path))
    until(lambda: graph.node.count_subscribers("/imu/mag") > 0, "calibrate")
    graph.start("bag_player", str(tumble), "--rate", "8", "--loop")  # a tumble in five seconds
    assert calibrating.wait(60.0) == 0, calibrating.said
    found = load(path).mag
    assert found.offset == pytest.approx(HARD, abs=0.3e-6)
    assert found.quality["coverage_percent"] >= 75.0


def test_ctrl_c_keeps_what_is_there(graph: Graph, tmp_path: Path):
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    path = tmp_path / "c.yaml"
    imu = graph.hear(Imu, "imu/data_raw")
    calibrating = graph.start("calibrate", "gyro", "-o", str(path))
    until(lambda: graph.node.count_subscribers("/imu/data_raw") > 1, "calibrate")
    write(simulated("tumble", 12.0), tmp_path / "bag")  # rests from 7.5 s to 11 s: never enough
    options = ("--rate", "2", "--wait", "20", "--subscribers", "2")  # calibrate, and the test
    player = graph.start("bag_player", str(tmp_path / "bag"), *options)
    until(lambda: len(imu) > 1150, "11.5 s of samples")
    assert player.wait(20.0) == 0  # calibrate may be late, if the machine is busy
    assert calibrating.end(signal.SIGINT) == 0, calibrating.said
    assert 2.0 <= load(path).gyro.quality["seconds"] < 4.5


def test_ctrl_c_too_early_says_what_is_missing(graph: Graph, tmp_path: Path):
    mag = graph.hear(MagneticField, "imu/mag")
    calibrating = graph.start("calibrate", "mag", "-o", str(tmp_path / "c.yaml"))
    until(lambda: graph.node.count_subscribers("/imu/mag") > 1, "calibrate")
    graph.start("imu_driver", sim_motion="rest")
    until(lambda: len(mag) > 10, "samples")
    assert calibrating.end(signal.SIGINT) == 1
    assert "calibrate: " in calibrating.said
    assert "expected" in calibrating.said or "no sample on" in calibrating.said
    assert not (tmp_path / "c.yaml").exists()


def test_ctrl_c_without_a_driver_says_that_nobody_publishes(graph: Graph, tmp_path: Path):
    calibrating = graph.start("calibrate", "mag", "-o", str(tmp_path / "c.yaml"))
    until(lambda: graph.node.count_subscribers("/imu/mag") > 0, "calibrate")
    assert calibrating.end(signal.SIGINT) == 1
    assert "no sample on /imu/mag (0 publishers). Start the driver" in calibrating.said


@pytest.mark.parametrize(
    ("where", "step"),
    [
        (program, "Listener"),
        (program.Listener, "_subscribe"),
        (program.Listener, "count_publishers"),
    ],
)
def test_ctrl_c_amid_the_start_says_the_same(
    where: object,
    step: str,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    tmp_path: Path,
):
    interrupt(monkeypatch, where, step)
    monkeypatch.setattr("sys.argv", ["calibrate", "mag", "-o", str(tmp_path / "c.yaml")])
    with pytest.raises(SystemExit, match=r"^1$"):
        program.main()
    said = capfd.readouterr().err
    assert "imu/mag (0 publishers). Start the driver" in said
    assert said.count("\n") == 1


def test_a_driver_that_corrects_already_is_refused(graph: Graph, tmp_path: Path):
    path = tmp_path / "c.yaml"
    save(Calibration(gyro=Correction((0.1, 0.0, 0.0))), path)
    graph.start("imu_driver", sim_motion="rest", calibration_file=path)
    calibrating = graph.start("calibrate", "gyro", "-o", str(path))
    assert calibrating.wait(30.0) == 1
    assert "/imu_driver corrects its data by" in calibrating.said
    assert "without calibration_file" in calibrating.said


def test_a_terminal_gets_a_map(tmp_path: Path):
    """Under a pseudo-terminal, as a user has it."""
    import pty

    if not hasattr(pty, "fork"):
        pytest.skip("no pseudo-terminals")
    with Graph() as graph:
        main, sub = pty.openpty()
        process = subprocess.Popen(
            [sys.executable, "-m", "stateful_ahrs.nodes.calibrate", "mag", "-o", "c.yaml"],
            cwd=tmp_path,
            stdout=sub,
            stderr=sub,
            env={
                **os.environ,
                "ROS_DOMAIN_ID": str(graph.domain),
                "TERM": "xterm",
                "COLUMNS": "100",
                "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[2]), *sys.path]),
            },
        )
        os.close(sub)
        graph.start("imu_driver", sim_motion="sphere")
        shown = b""
        end = time.monotonic() + 40.0
        while shown.count("██".encode()) < 2 and time.monotonic() < end:
            shown += os.read(main, 4096)
        process.send_signal(signal.SIGINT)
        try:
            while chunk := os.read(main, 4096):
                shown += chunk
        except OSError:  # the other end is closed
            pass
        assert process.wait(10.0) == 1
        os.close(main)
    text = shown.decode(errors="replace")
    assert "██" in text
    assert "+z" in text
    assert "Ctrl-C" in text
    assert "Traceback" not in text


# --- the driver ----------------------------------------------------------------------------------


def test_the_driver_applies_the_file_and_says_so(graph: Graph, tmp_path: Path):
    path = tmp_path / "c.yaml"
    double = ((2.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 2.0))
    save(
        Calibration(
            "board",
            gyro=Correction((0.5, 0.0, 0.0), date=DAY),
            accel=Correction((0.0, 0.0, 0.81), double, DAY),
            mag=Correction((25e-6, 0.0, 0.0), double, DAY),
        ),
        path,
    )
    imu, mag = graph.hear(Imu, "imu/data_raw"), graph.hear(MagneticField, "imu/mag")
    health = Health(graph)
    graph.start("imu_driver", sim_motion="rest", calibration_file=path)
    values = health.until(OK)
    until(lambda: len(imu) > 100 and len(mag) > 50, "samples")
    assert mean_rate(imu[:100]) == pytest.approx([-0.5, 0.0, 0.0], abs=5e-3)
    accel = np.mean([m.linear_acceleration.z for m in imu[:100]])
    assert accel == pytest.approx(2.0 * (9.81 - 0.81), abs=0.15)
    fields = [m.magnetic_field for m in mag[:50]]
    assert np.mean([f.x for f in fields]) == pytest.approx(0.0, abs=1.5e-6)
    assert np.mean([f.z for f in fields]) == pytest.approx(-2.0 * 43.3e-6, abs=1.5e-6)
    assert values["calibration_file"] == str(path)
    assert values["mag_calibrated"] == DAY


@pytest.mark.parametrize("text", ["", "gyroscope: {bias: [0, 0, .nan]}"])
def test_a_bad_file_is_no_driver(graph: Graph, tmp_path: Path, text: str):
    path = tmp_path / "c.yaml"
    path.write_text(text)
    driver = graph.start("imu_driver", calibration_file=path)
    assert driver.wait() == 1
    assert f"imu_driver: {path}" in driver.said
    assert "Traceback" not in driver.said


def test_calibrate_gyro_takes_the_bias_at_rest_and_keeps_it(graph: Graph, tmp_path: Path):
    path = tmp_path / "c.yaml"
    save(Calibration("board"), path)
    imu = graph.hear(Imu, "imu/data_raw")
    graph.start("imu_driver", sim_motion="rest", calibration_file=path)
    until(lambda: imu, "samples")
    refused = graph.call(Trigger, "imu_driver/calibrate_gyro")
    if not refused.success:  # unless the machine was slow
        assert "keep the sensor still" in refused.message
    until(lambda: len(imu) > 500, "2.5 s of samples")
    done = graph.call(Trigger, "imu_driver/calibrate_gyro")
    assert done.success, done.message
    begin = len(imu) + 20  # what was on its way
    until(lambda: len(imu) > begin + 200, "corrected samples")
    # 2 s of 0.1 °/s at 200 Hz give the bias to 0.09 mrad/s, and 1 s the mean to 0.12
    assert mean_rate(imu[begin:]) == pytest.approx([0.0, 0.0, 0.0], abs=7e-4)
    assert load(path).gyro.offset == pytest.approx(Errors().gyro_bias, abs=5e-4)
    assert load(path).sensor == "board"


def test_self_test_passes_axis_by_axis_and_the_samples_go_on(
    shim: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    with edge.i2c(shim, tmp_path, monkeypatch), Graph() as graph:
        imu, health = graph.hear(Imu, "imu/data_raw"), Health(graph)
        graph.start("imu_driver", transport="i2c", fifo=True)
        health.until(OK)
        response = graph.call(SelfTest, "imu_driver/self_test")
        assert [status.name for status in response.status] == list(AXES)
        assert all("pass" in status.message for status in response.status), response.status
        assert response.passed == b"\x01"
        assert "MPU-9250" in response.id
        values = health.until(OK, count=2)
        assert (values["losses"], values["missed"]) == ("0", "0")
        stamps = [nanoseconds(message) for message in imu]
        assert all(a < b for a, b in pairwise(stamps))
        accel = imu[-1].linear_acceleration
        assert (accel.x, accel.y, accel.z) == pytest.approx((0.0, 0.0, 9.81), abs=0.5)


def test_self_test_of_a_moving_sensor_says_to_keep_it_still(graph: Graph):
    imu = graph.hear(Imu, "imu/data_raw")
    graph.start("imu_driver", sim_motion="sphere")
    until(lambda: imu and imu[-1].angular_velocity.z > 0.5, "motion")
    response = graph.call(SelfTest, "imu_driver/self_test")
    assert response.passed == b"\x00"
    assert "keep it still" in response.status[0].message
    count = len(imu)
    until(lambda: len(imu) > count + 100, "samples again")
