"""The real executable on a chip behind /dev/i2c-1: it reads every sample, and survives its bus."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is neither sourced nor installed from PyPI")

import edge
from diagnostic_msgs.msg import DiagnosticArray
from edge import Health, Simulator, shim
from graph import Graph, nanoseconds, until
from samples import lost_and_torn
from sensor_msgs.msg import Imu, MagneticField

__all__ = ["shim"]

SECONDS = float(os.environ.get("ENDURANCE", "4"))  # of reading without a loss
OK, WARN, ERROR = 0, 1, 2
RANGES = (1000.0, 4.0)  # °/s and g, the driver's defaults


@pytest.fixture
def simulator(shim: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Simulator]:
    with edge.i2c(shim, tmp_path, monkeypatch) as simulator:
        yield simulator


def in_order(messages: list[Imu]) -> bool:
    stamps = [nanoseconds(message) for message in messages]
    return all(a < b for a, b in pairwise(stamps))


@pytest.mark.parametrize(
    ("rate", "fifo"), [(200.0, False), (1000.0, True)], ids=["poll at 200 Hz", "fifo at 1 kHz"]
)
def test_every_sample_of_the_chip_is_published_once_whole_and_in_order(
    simulator: Simulator, tmp_path: Path, rate: float, fifo: bool
):
    with Graph() as graph:
        imu, health = graph.hear(Imu, "imu/data_raw"), Health(graph)
        graph.start("imu_driver", transport="i2c", rate=rate, fifo=fifo)
        health.until(OK)
        enough = len(imu) + SECONDS * rate
        until(lambda: len(imu) >= enough, "samples", 20.0 + 3.0 * SECONDS)
        published = imu[:]
        health.until(OK, count=2)
        values = health.reports[-1][2]
    simulator.do("log")
    lost, torn = lost_and_torn(published, tmp_path / "log", RANGES)
    assert torn == 0
    assert in_order(published)
    # a machine that stops for longer than the chip can wait loses samples, and then counts them
    assert lost <= int(values["missed"])
    assert lost < 0.1 * len(published)  # polls of a busy machine are late; FIFO is not


def test_the_magnetometer_has_the_stamp_of_its_sample_and_gravity_points_up(simulator: Simulator):
    with Graph() as graph:
        imu = graph.hear(Imu, "imu/data_raw")
        mag = graph.hear(MagneticField, "imu/mag")
        graph.start("imu_driver", transport="i2c", rate=100.0)
        until(lambda: len(mag) >= 20 and len(imu) >= 30, "samples")
    stamps = {nanoseconds(message) for message in imu}
    assert all(nanoseconds(message) in stamps for message in mag[5:15])
    assert imu[-1].linear_acceleration.z == pytest.approx(9.81, abs=0.5)  # noise of 8 mg rms
    assert mag[-1].magnetic_field.x == pytest.approx(25e-6, abs=4e-6)
    assert mag[-1].magnetic_field.z == pytest.approx(-43e-6, abs=4e-6)
    assert imu[-1].header.frame_id == mag[-1].header.frame_id == "imu_link"
    assert imu[-1].orientation_covariance[0] == -1.0


def test_bypass_reads_the_magnetometer_on_the_bus(simulator: Simulator):
    with Graph() as graph:
        mag, health = graph.hear(MagneticField, "imu/mag"), Health(graph)
        graph.start("imu_driver", transport="i2c", bypass=True)
        until(lambda: len(mag) >= 100, "a hundred measurements")
        assert float(health.until(OK)["mag_rate_hz"]) == pytest.approx(100.0, abs=10.0)


FAULTS = {
    "unplug": ("unplug", "plug", "no device answers at address 0x68"),
    "stuck": ("stuck 1", "stuck 0", "every byte reads as 0xFF"),
    "frozen": ("frozen 1", "frozen 0", "the same counts again and again"),
    "busy": ("hold 1", "hold 0", "the bus is busy"),
    "adapter": ("remove", "insert", "/dev/i2c-1: there is no such bus"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_lost_chip_is_an_error_until_it_is_back_and_stamps_go_on(
    simulator: Simulator, fault: str
):
    begin, end, sentence = FAULTS[fault]
    with Graph() as graph:
        imu, health = graph.hear(Imu, "imu/data_raw"), Health(graph)
        driver = graph.start("imu_driver", transport="i2c")
        health.until(OK)
        simulator.do(*begin.split())
        health.until(ERROR, sentence)
        before = len(imu)
        simulator.do(*end.split())
        values = health.until(OK)
        after = imu[before:]
        assert values["losses"] == "1", driver.said
        assert in_order(imu)
        assert nanoseconds(imu[-1]) * 1e-9 == pytest.approx(time.time(), abs=0.5)
        assert all(abs(m.linear_acceleration.z - 9.81) < 0.5 for m in after)  # configured anew
        assert len([line for line in driver.said.splitlines() if sentence in line]) == 1


def test_a_chip_whose_supply_dropped_is_configured_anew(simulator: Simulator):
    with Graph() as graph:
        imu, health = graph.hear(Imu, "imu/data_raw"), Health(graph)
        mag = graph.hear(MagneticField, "imu/mag")
        driver = graph.start("imu_driver", transport="i2c")
        health.until(OK)
        simulator.do("power")
        health.until(ERROR)
        fresh = len(mag)
        values = health.until(OK)
        assert values["losses"] == "1", driver.said
        until(lambda: len(mag) > fresh + 50, "the magnetometer again")
        assert in_order(imu)
        assert all(abs(m.linear_acceleration.z - 9.81) < 0.5 for m in imu)  # never in ±2 g


def test_what_is_not_a_loss_is_a_warning_while_it_lasts(simulator: Simulator):
    with Graph() as graph:
        health = Health(graph)
        graph.start("imu_driver", transport="i2c")
        health.until(OK)
        for fault, sentence, count in [
            ("nack 2", "transactions failed", "bus_errors"),
            ("magnet 4900e-6", "magnetometer samples overflowed", "mag_overflows"),
            ("spin 40", "samples saturated (gyro x)", "saturated"),
            ("temperature 110", "110 °C is not plausible", "temperature_implausible"),
        ]:
            simulator.do(*fault.split())
            assert int(health.until(WARN, sentence)[count]) > 0
            simulator.do("heal")
            health.until(OK)
        assert health.reports[-1][2]["losses"] == "0"


def test_a_slow_bus_loses_samples_and_says_what_helps(simulator: Simulator):
    with Graph() as graph:
        health = Health(graph)
        graph.start("imu_driver", transport="i2c")
        health.until(OK)
        simulator.do("latency", 0.008)
        health.until(WARN, "samples were lost before they were read. Set fifo to true")
        simulator.do("latency", 0)
        health.until(OK)


def test_a_fifo_that_overflows_is_counted_and_emptied(simulator: Simulator, tmp_path: Path):
    with Graph() as graph:
        imu, health = graph.hear(Imu, "imu/data_raw"), Health(graph)
        graph.start("imu_driver", transport="i2c", rate=1000.0, fifo=True)
        health.until(OK)
        simulator.do("latency", 0.03)
        health.until(WARN, "The FIFO overflowed")
        simulator.do("latency", 0)
        values = health.until(OK)
        assert int(values["fifo_overflows"]) > 0
        published = imu[:]
        simulator.do("log")
    lost, torn = lost_and_torn(published, tmp_path / "log", RANGES)
    assert torn == 0
    assert int(values["missed"]) == pytest.approx(lost, rel=0.2, abs=3)
    assert in_order(published)


# --- what cannot be started ----------------------------------------------------------------------


def ended(graph: Graph) -> str:
    """What a driver said that ended by itself, as it must: with exit code 1 and a sentence."""
    driver = graph.start("imu_driver", transport="i2c")
    assert driver.wait() == 1
    said = driver.said.strip().splitlines()
    assert len(said) == 1, said
    return said[0]


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        ("unplug", "imu_driver: /dev/i2c-1: no device answers at address 0x68. `i2cdetect -y 1`"),
        ("deny", "imu_driver: /dev/i2c-1: permission denied. Add your user to the group i2c"),
        ("hold", "imu_driver: /dev/i2c-1: the bus is busy (Connection timed out): something holds"),
        ("remove", "imu_driver: /dev/i2c-1: there is no such bus, there is no bus at all. Switch"),
        ("stuck", "imu_driver: every byte reads as 0xFF: nobody drives the bus. Check the wires"),
    ],
)
def test_what_cannot_be_read_ends_with_one_sentence(
    simulator: Simulator, command: str, sentence: str
):
    simulator.do(command)
    with Graph() as graph:
        assert sentence in ended(graph)


@pytest.mark.parametrize(
    ("who", "name"), [(0x68, "MPU-6050 or MPU-9150"), (0x75, "unknown"), (0x78, "MPU-6880")]
)
def test_another_chip_is_named_and_refused(
    shim: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, who: int, name: str
):
    with edge.i2c(shim, tmp_path, monkeypatch, who), Graph() as graph:
        assert f"answers 0x{who:02X} ({name}) to WHO_AM_I" in ended(graph)


def test_an_mpu_6500_runs_on_six_axes_and_says_so(
    shim: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    with edge.i2c(shim, tmp_path, monkeypatch, 0x70), Graph() as graph:
        imu, mag = graph.hear(Imu, "imu/data_raw"), graph.hear(MagneticField, "imu/mag")
        health = Health(graph)
        driver = graph.start("imu_driver", transport="i2c")
        health.until(OK, "MPU-6500 at 0x68 (no magnetometer)")
        assert "MPU-6500 at 0x68 (no magnetometer)" in driver.said
        assert imu
        assert not mag


# --- ending, and the shim itself -----------------------------------------------------------------


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("state", ["well", "lost"])
def test_a_signal_ends_it_within_a_second_with_exit_code_0(
    simulator: Simulator, by: signal.Signals, state: str
):
    with Graph() as graph:
        heard = graph.hear(DiagnosticArray, "/diagnostics")
        driver = graph.start("imu_driver", transport="i2c")
        until(lambda: heard, "diagnostics")
        if state == "lost":
            simulator.do("unplug")
            until(lambda: "no device answers" in driver.said, "the loss")
        begin = time.monotonic()
        assert driver.end(by) == 0
        assert time.monotonic() - begin < 1.0
        assert "Traceback" not in driver.said


def test_other_programs_see_the_same_chip_through_smbus_calls(simulator: Simulator):
    program = """
import smbus2
with smbus2.SMBus(1) as bus:
    print(bus.read_byte_data(0x68, 0x75))
    bus.write_byte_data(0x68, 0x1B, 0x18)
    bus.write_i2c_block_data(0x68, 0x1C, [0x10, 0x03])
    print(bus.read_i2c_block_data(0x68, 0x1B, 3))
    print(hex(bus.read_word_data(0x68, 0x1C)))
    try:
        bus.read_byte(0x50)
    except OSError as error:
        print(error.errno)
"""
    found = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=20.0
    )
    assert found.stdout.split("\n")[:4] == ["113", "[24, 16, 3]", "0x310", "121"], found.stderr
