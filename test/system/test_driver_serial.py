"""The real executable on boards at a serial port: a process writes each protocol into a tty."""

from __future__ import annotations

import os
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is neither sourced nor installed from PyPI")

import edge
from diagnostic_msgs.srv import SelfTest
from edge import ERROR, OK, Health
from graph import Graph, nanoseconds, until
from samples import lost_and_torn
from sensor_msgs.msg import Imu, MagneticField, Temperature

SECONDS = float(os.environ.get("ENDURANCE", "2"))  # of reading without a loss
LOST = "samples were lost before they were read"
DISCARDED = "bytes were no samples and were discarded"


def in_order(messages: list[Imu]) -> bool:
    stamps = [nanoseconds(message) for message in messages]
    return all(a < b for a, b in pairwise(stamps))


def test_our_frame_brings_every_sample_at_1_khz_once_whole_and_in_order(tmp_path: Path):
    with edge.board(tmp_path, "frame", "tumble", drift=50e-6) as board, Graph() as graph:
        imu, health = graph.hear(Imu, "imu/data_raw"), Health(graph)
        driver = graph.start(
            "imu_driver", transport="serial", port=tmp_path / "tty", protocol="frame"
        )
        health.until(OK)
        enough = len(imu) + 1000 * (SECONDS + 1)
        until(lambda: len(imu) >= enough, "samples", 20.0 + 3.0 * SECONDS)
        published = imu[:]
        values = health.until(OK)
        board.do("log")
        assert driver.end(signal.SIGINT) == 0
        lost, torn = lost_and_torn(published, tmp_path / "log", (1000.0, 4.0))
    assert (lost, torn) == (0, 0)
    assert values["missed"] == "0"
    assert in_order(published)
    stamps = [nanoseconds(message) for message in published]
    steps = [b - a for a, b in pairwise(stamps[1000:])]
    # by the board's clock; times of arrival are those of whole bursts
    assert sum(0.9e6 <= step <= 1.1e6 for step in steps) > 0.9 * len(steps)


BOARDS = {  # and the low rate at which our frame is no load
    "razor": {},
    "rt_usb text": {},
    "rt_usb binary": {},
    "frame": {"rate": 200},
}
FAULTS = {
    "razor": {
        "reply": (DISCARDED, "bytes_discarded"),
        "magnet 4900e-6": ("magnetometer samples overflowed", "mag_overflows"),
    },
    "rt_usb text": {"drop 7": (f"7 {LOST}", "missed")},
    "rt_usb binary": {"temperature 120": ("not plausible", "temperature_implausible")},
    "frame": {
        "drop 7": (f"7 {LOST}", "missed"),
        "garbage 500": (DISCARDED, "bytes_discarded"),
        "spin 40": ("samples saturated (gyro x)", "saturated"),
    },
}


class Desk:
    """A board, the driver that reads it, and what that publishes."""

    def __init__(self, graph: Graph, stack: ExitStack, folder: Path, kind: str) -> None:
        self.kind = kind
        self.space = kind.replace(" ", "_")
        folder = folder / self.space
        folder.mkdir()
        self.board = stack.enter_context(edge.board(folder, kind, **BOARDS[kind]))
        self.imu = graph.hear(Imu, f"{self.space}/imu/data_raw")
        self.mag = graph.hear(MagneticField, f"{self.space}/imu/mag")
        self.warm = graph.hear(Temperature, f"{self.space}/imu/temperature")
        self.health = Health(graph, f"{self.space}/imu_driver")
        self.driver = graph.start(
            "imu_driver",
            *("--ros-args", "-r", f"__ns:=/{self.space}"),
            transport="serial",
            port=folder / "tty",
        )

    def check_units(self) -> None:
        until(lambda: len(self.imu) > 50 and len(self.mag) > 20, "samples")
        accel, field = self.imu[-1].linear_acceleration, self.mag[-1].magnetic_field
        assert (accel.x, accel.y, accel.z) == pytest.approx((0.0, 0.0, 9.81), abs=0.5)
        assert (field.x, field.y, field.z) == pytest.approx((25e-6, 0.0, -43.3e-6), abs=4e-6)
        rate = self.imu[-1].angular_velocity
        assert (rate.x, rate.y, rate.z) == pytest.approx((0.0, 0.0, 0.0), abs=0.02)
        assert bool(self.warm) == (self.kind != "razor")

    def check_time(self) -> None:
        assert in_order(self.imu)
        assert nanoseconds(self.imu[-1]) * 1e-9 == pytest.approx(time.time(), abs=0.5)

    def live(self) -> None:
        """Be detected and read, suffer what is no loss, get lost and be found again."""
        self.health.until(OK, f"({self.kind})")
        self.check_units()
        self.health.suffers(self.board, FAULTS[self.kind])
        self.board.do("unplug")
        self.health.until(ERROR, "tty")
        self.board.do("plug")
        values = self.health.until(OK)
        assert values["losses"] == "1", self.driver.said
        self.check_time()
        assert len([line for line in self.driver.said.splitlines() if "Plug" in line]) == 1


def test_every_board_is_detected_read_in_the_same_units_warned_of_lost_and_found_again(
    tmp_path: Path,
):
    with ExitStack() as stack, Graph() as graph, ThreadPoolExecutor() as pool:
        desks = [Desk(graph, stack, tmp_path, kind) for kind in BOARDS]
        assert len(list(pool.map(Desk.live, desks))) == len(BOARDS)  # raises what one raised
        desks[0].board.do("unplug")
        desks[0].health.until(ERROR, "tty")
        assert desks[0].driver.end(signal.SIGINT) == 0  # lost
        assert desks[1].driver.end(signal.SIGTERM) == 0  # well
        assert all("Traceback" not in desk.driver.said for desk in desks)


def test_a_board_that_falls_silent_freezes_or_restarts_goes_on(tmp_path: Path):
    with ExitStack() as stack, Graph() as graph:
        desk = Desk(graph, stack, tmp_path, "frame")
        desk.health.until(OK)
        for fault, sentence in [("silent", "Check that the board has power"), ("frozen", "same")]:
            desk.board.do(fault, 1)
            values = desk.health.until(ERROR, sentence)
            desk.board.do(fault, 0)
            desk.health.until(OK)
        assert int(values["frozen"]) > 0
        assert values["losses"] == "2"
        before = int(values["device_clock_restarts"])
        desk.board.do("restart")
        values = desk.health.until(OK, count=2)
        assert int(values["device_clock_restarts"]) == before + 1  # mapped anew
        assert values["losses"] == "2"
        desk.check_time()
        refused = graph.call(SelfTest, f"{desk.space}/imu_driver/self_test")
        assert refused.passed == b"\x00"
        assert "needs transport i2c" in refused.status[0].message
        assert desk.health.until(OK, count=2)["losses"] == "2"


# --- what cannot be started ----------------------------------------------------------------------

REFUSED = [
    ({"port": "/dev/nosuchport"}, 1, "/dev/nosuchport: there is no such port, there is"),
    ({"port": "/dev/null"}, 1, "/dev/null: cannot be opened"),
    ({"port": ""}, 2, "the ROS arguments cannot be used: "),
    ({"protocol": "nmea"}, 2, "protocol must be one of auto, frame, razor, rt_usb"),
    ({"fifo": True}, 2, "fifo is for transport i2c"),
    ({"baudrate": 0}, 2, "baudrate must be between 1 and 12000000, got 0"),
]


def test_what_cannot_be_read_ends_with_one_sentence():
    with Graph() as graph:
        drivers = [graph.start("imu_driver", transport="serial", **wrong) for wrong, *_ in REFUSED]
        for driver, (_, code, sentence) in zip(drivers, REFUSED, strict=True):
            assert driver.wait() == code
            said = driver.said.strip().splitlines()
            assert len(said) == 1
            assert f"imu_driver: {sentence}" in said[0]
