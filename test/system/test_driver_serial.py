"""The real executable on boards at a serial port: a process writes each protocol into a tty."""

from __future__ import annotations

import os
import signal
import time
from itertools import pairwise
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is neither sourced nor installed from PyPI")

import edge
from edge import Health
from graph import Graph, nanoseconds, until
from samples import lost_and_torn
from sensor_msgs.msg import Imu, MagneticField, Temperature

SECONDS = float(os.environ.get("ENDURANCE", "4"))  # of reading without a loss
OK, WARN, ERROR = 0, 1, 2
KINDS = ["frame", "razor", "rt_usb text", "rt_usb binary"]


def in_order(messages: list[Imu]) -> bool:
    stamps = [nanoseconds(message) for message in messages]
    return all(a < b for a, b in pairwise(stamps))


def test_our_frame_brings_every_sample_at_1_khz_once_whole_and_in_order(tmp_path: Path):
    with edge.board(tmp_path, "frame", "tumble", drift=50e-6) as board, Graph() as graph:
        imu, health = graph.hear(Imu, "imu/data_raw"), Health(graph)
        graph.start("imu_driver", transport="serial", port=tmp_path / "tty", protocol="frame")
        health.until(OK)
        enough = len(imu) + 1000 * SECONDS
        until(lambda: len(imu) >= enough, "samples", 20.0 + 3.0 * SECONDS)
        published = imu[:]
        values = health.until(OK)
        board.do("log")
        lost, torn = lost_and_torn(published, tmp_path / "log", (1000.0, 4.0))
    assert (lost, torn) == (0, 0)
    assert values["missed"] == "0"
    assert in_order(published)
    stamps = [nanoseconds(message) for message in published]
    steps = [b - a for a, b in pairwise(stamps[1000:])]
    # by the board's clock; times of arrival jump by the whole burst of a busy machine
    assert min(steps) >= 0.5e6
    assert max(steps) <= 1.5e6
    assert (stamps[-1] - stamps[1000]) / len(steps) == pytest.approx(1e6, rel=1e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_every_board_is_detected_and_read_in_the_same_units(tmp_path: Path, kind: str):
    with edge.board(tmp_path, kind), Graph() as graph:
        imu = graph.hear(Imu, "imu/data_raw")
        mag = graph.hear(MagneticField, "imu/mag")
        warm = graph.hear(Temperature, "imu/temperature")
        health = Health(graph)
        graph.start("imu_driver", transport="serial", port=tmp_path / "tty")
        health.until(OK, f"({kind})")
        until(lambda: len(imu) > 50 and len(mag) > 20, "samples")
        assert bool(warm) == (kind != "razor")
    accel, field = imu[-1].linear_acceleration, mag[-1].magnetic_field
    assert (accel.x, accel.y, accel.z) == pytest.approx((0.0, 0.0, 9.81), abs=0.5)
    assert (field.x, field.y, field.z) == pytest.approx((25e-6, 0.0, -43.3e-6), abs=4e-6)
    rate = imu[-1].angular_velocity
    assert (rate.x, rate.y, rate.z) == pytest.approx((0.0, 0.0, 0.0), abs=0.02)
    assert in_order(imu)


@pytest.mark.parametrize("kind", KINDS)
def test_a_board_that_is_unplugged_is_an_error_until_it_is_back_and_stamps_go_on(
    tmp_path: Path, kind: str
):
    with edge.board(tmp_path, kind) as board, Graph() as graph:
        imu, health = graph.hear(Imu, "imu/data_raw"), Health(graph)
        driver = graph.start("imu_driver", transport="serial", port=tmp_path / "tty")
        health.until(OK)
        board.do("unplug")
        health.until(ERROR, "tty")
        board.do("plug")
        values = health.until(OK)
        assert values["losses"] == "1", driver.said
        assert in_order(imu)
        assert nanoseconds(imu[-1]) * 1e-9 == pytest.approx(time.time(), abs=0.5)
        assert len([line for line in driver.said.splitlines() if "Plug" in line]) == 1


def test_a_bridge_that_restarts_goes_on_and_its_clock_is_mapped_anew(tmp_path: Path):
    with edge.board(tmp_path, "frame", rate=200) as board, Graph() as graph:
        imu, health = graph.hear(Imu, "imu/data_raw"), Health(graph)
        graph.start("imu_driver", transport="serial", port=tmp_path / "tty")
        health.until(OK)
        board.do("restart")
        values = health.until(OK, count=2)
        assert values["device_clock_restarts"] == "1"
        assert values["losses"] == "0"
        assert in_order(imu)
        assert nanoseconds(imu[-1]) * 1e-9 == pytest.approx(time.time(), abs=0.5)


def test_a_board_that_falls_silent_is_an_error_until_it_speaks(tmp_path: Path):
    with edge.board(tmp_path, "razor") as board, Graph() as graph:
        health = Health(graph)
        graph.start("imu_driver", transport="serial", port=tmp_path / "tty")
        health.until(OK)
        board.do("silent", 1)
        health.until(ERROR, "sends nothing. Check that the board has power")
        board.do("silent", 0)
        health.until(OK)


@pytest.mark.parametrize(
    ("kind", "fault", "sentence", "count"),
    [
        ("frame", "drop 7", "7 samples were lost before they were read", "missed"),
        ("rt_usb text", "drop 7", "7 samples were lost before they were read", "missed"),
        ("frame", "garbage 500", "bytes were no samples and were discarded", "bytes_discarded"),
        ("razor", "reply", "bytes were no samples and were discarded", "bytes_discarded"),
        ("razor", "magnet 4900e-6", "magnetometer samples overflowed", "mag_overflows"),
        ("frame", "spin 40", "samples saturated (gyro x)", "saturated"),
        ("rt_usb binary", "temperature 120", "not plausible", "temperature_implausible"),
    ],
)
def test_what_is_not_a_loss_is_a_warning_while_it_lasts(
    tmp_path: Path, kind: str, fault: str, sentence: str, count: str
):
    with edge.board(tmp_path, kind) as board, Graph() as graph:
        health = Health(graph)
        graph.start("imu_driver", transport="serial", port=tmp_path / "tty")
        health.until(OK)
        board.do(*fault.split())
        assert int(health.until(WARN, sentence)[count]) > 0
        board.do("heal")
        assert health.until(OK)["losses"] == "0"


def test_frozen_counts_are_an_error_until_they_change(tmp_path: Path):
    with edge.board(tmp_path, "frame", rate=200) as board, Graph() as graph:
        health = Health(graph)
        graph.start("imu_driver", transport="serial", port=tmp_path / "tty")
        health.until(OK)
        board.do("frozen", 1)
        assert int(health.until(ERROR, "the same counts")["frozen"]) > 0
        board.do("frozen", 0)
        health.until(OK)


# --- what cannot be started, and ending ----------------------------------------------------------


@pytest.mark.parametrize(
    ("parameters", "code", "sentence"),
    [
        ({"port": "/dev/nosuchport"}, 1, "/dev/nosuchport: there is no such port, there is"),
        ({"protocol": "nmea"}, 2, "protocol must be one of auto, frame, razor, rt_usb"),
        ({"fifo": True}, 2, "fifo is for transport i2c"),
        ({"baudrate": 0}, 2, "baudrate must be between 1 and 12000000, got 0"),
        ({"port": ""}, 2, "the ROS arguments cannot be used: "),
    ],
)
def test_what_cannot_be_read_ends_with_one_sentence(
    parameters: dict[str, object], code: int, sentence: str
):
    with Graph() as graph:
        driver = graph.start("imu_driver", transport="serial", **parameters)
        assert driver.wait() == code
        said = driver.said.strip().splitlines()
        assert len(said) == 1
        assert f"imu_driver: {sentence}" in said[0]


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("state", ["well", "lost"])
def test_a_signal_ends_it_within_a_second_with_exit_code_0(
    tmp_path: Path, by: signal.Signals, state: str
):
    with edge.board(tmp_path, "frame") as board, Graph() as graph:
        health = Health(graph)
        driver = graph.start("imu_driver", transport="serial", port=tmp_path / "tty")
        health.until(OK)
        if state == "lost":
            board.do("unplug")
            until(lambda: "Plug" in driver.said, "the loss")
        begin = time.monotonic()
        assert driver.end(by) == 0
        assert time.monotonic() - begin < 1.0
        assert "Traceback" not in driver.said
