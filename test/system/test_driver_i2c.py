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
from edge import ERROR, OK, WARN, Health, Simulator, shim
from graph import Graph, nanoseconds, until
from samples import lost_and_torn
from sensor_msgs.msg import Imu, MagneticField

__all__ = ["shim"]

SECONDS = float(os.environ.get("ENDURANCE", "2"))  # of reading without a loss
RANGES = (1000.0, 4.0)  # °/s and g, the driver's defaults


@pytest.fixture
def simulator(shim: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Simulator]:
    with edge.i2c(shim, tmp_path, monkeypatch) as simulator:
        yield simulator


def in_order(messages: list[Imu]) -> bool:
    stamps = [nanoseconds(message) for message in messages]
    return all(a < b for a, b in pairwise(stamps))


SLOW = "samples were lost before they were read. Set fifo to true"


@pytest.mark.parametrize(
    ("rate", "fifo", "latency", "sentence"),
    [(200.0, False, 0.008, SLOW), (1000.0, True, 0.03, "The FIFO overflowed")],
    ids=["poll at 200 Hz", "fifo at 1 kHz"],
)
def test_samples_are_published_once_whole_and_in_order_and_what_a_slow_bus_costs_is_counted(
    simulator: Simulator, tmp_path: Path, rate: float, fifo: bool, latency: float, sentence: str
):
    with Graph() as graph:
        imu, mag = graph.hear(Imu, "imu/data_raw"), graph.hear(MagneticField, "imu/mag")
        health = Health(graph)
        driver = graph.start("imu_driver", transport="i2c", rate=rate, fifo=fifo)
        health.until(OK)
        enough = len(imu) + SECONDS * rate
        until(lambda: len(imu) >= enough, "samples", 20.0 + 3.0 * SECONDS)
        published = imu[:]
        values = health.until(OK)  # a second without a loss
        simulator.do("log")
        lost, torn = lost_and_torn(published, tmp_path / "log", RANGES)
        assert torn == 0
        # a machine that stops for longer than the chip can wait loses samples, and then counts them
        assert lost <= int(values["missed"]) < 0.5 * enough
        simulator.do("latency", latency)
        health.until(WARN, sentence)
        simulator.do("latency", 0)
        values = health.until(OK)
        assert (int(values["fifo_overflows"]) > 0) == fifo
        published = imu[:]
        simulator.do("log")
        assert driver.end(signal.SIGINT) == 0
        assert "Traceback" not in driver.said
    lost, torn = lost_and_torn(published, tmp_path / "log", RANGES)
    assert torn == 0
    assert int(values["missed"]) == pytest.approx(lost, rel=0.2, abs=3)
    assert in_order(published)
    stamps = {nanoseconds(message) for message in imu}
    assert all(nanoseconds(message) in stamps for message in mag[5:-5])
    assert imu[-1].header.frame_id == mag[-1].header.frame_id == "imu_link"
    assert imu[-1].orientation_covariance[0] == -1.0
    at_rest(imu[-1], mag[-1])


def at_rest(imu: Imu, mag: MagneticField) -> None:
    """Gravity points up, and the field north and down."""
    assert imu.linear_acceleration.z == pytest.approx(9.81, abs=0.5)  # noise of 8 mg rms
    assert mag.magnetic_field.x == pytest.approx(25e-6, abs=4e-6)
    assert mag.magnetic_field.z == pytest.approx(-43e-6, abs=4e-6)


def test_bypass_reads_the_magnetometer_on_the_bus(simulator: Simulator):
    with Graph() as graph:
        imu, mag = graph.hear(Imu, "imu/data_raw"), graph.hear(MagneticField, "imu/mag")
        graph.start("imu_driver", transport="i2c", bypass=True)
        until(lambda: len(imu) > 20 and len(mag) > 20, "measurements")
    at_rest(imu[-1], mag[-1])


FAULTS = {  # what is done to the chip, what it takes to mend it, and what is said of it
    "unplug": ("plug", "no device answers at address 0x68"),
    "power": ("heal", ""),
    "stuck 1": ("stuck 0", "every byte reads as 0xFF"),
    "frozen 1": ("frozen 0", "the same counts again and again"),
    "hold 1": ("hold 0", "the bus is busy"),
    "remove": ("insert", "/dev/i2c-1: there is no such bus"),
}


def test_a_lost_chip_is_an_error_until_it_is_back_configured_and_stamps_go_on(
    simulator: Simulator,
):
    with Graph() as graph:
        imu, mag = graph.hear(Imu, "imu/data_raw"), graph.hear(MagneticField, "imu/mag")
        health = Health(graph)
        driver = graph.start("imu_driver", transport="i2c")
        health.until(OK)
        for losses, (fault, (mended, sentence)) in enumerate(FAULTS.items(), 1):
            simulator.do(*fault.split())
            health.until(ERROR, sentence)
            before = len(mag)
            simulator.do(*mended.split())
            values = health.until(OK)
            assert values["losses"] == str(losses), driver.said
            assert len(mag) > before, fault
            assert nanoseconds(imu[-1]) * 1e-9 == pytest.approx(time.time(), abs=0.5)
            said = [line for line in driver.said.splitlines() if sentence in line]
            assert ["[ERROR]" in line for line in said] == [True] or not sentence
        assert in_order(imu)
        assert all(abs(m.linear_acceleration.z - 9.81) < 0.5 for m in imu)  # never in ±2 g
        simulator.do("unplug")
        health.until(ERROR)
        assert driver.end(signal.SIGTERM) == 0
        assert "Traceback" not in driver.said


def test_what_is_not_a_loss_is_a_warning_while_it_lasts(simulator: Simulator):
    with Graph() as graph:
        health = Health(graph)
        graph.start("imu_driver", transport="i2c")
        health.until(OK)
        health.suffers(
            simulator,
            {
                "nack 2": ("transactions failed", "bus_errors"),
                "magnet 4900e-6": ("magnetometer samples overflowed", "mag_overflows"),
                "spin 40": ("samples saturated (gyro x)", "saturated"),
                "temperature 110": ("110 °C is not plausible", "temperature_implausible"),
            },
        )


# --- what cannot be started ----------------------------------------------------------------------


def ended(graph: Graph) -> str:
    """What a driver said that ended by itself, as it must: with exit code 1 and a sentence."""
    driver = graph.start("imu_driver", transport="i2c")
    assert driver.wait() == 1
    said = driver.said.strip().splitlines()
    assert len(said) == 1, said
    return said[0]


SENTENCES = {
    "unplug": "imu_driver: /dev/i2c-1: no device answers at address 0x68. `i2cdetect -y 1`",
    "deny 1": "imu_driver: /dev/i2c-1: permission denied. Add your user to the group i2c",
    "hold 1": "imu_driver: /dev/i2c-1: the bus is busy (Connection timed out): something holds",
    "stuck 1": "imu_driver: every byte reads as 0xFF: nobody drives the bus. Check the wires",
    "remove": "imu_driver: /dev/i2c-1: there is no such bus, there is no bus at all. Switch",
}


def test_what_cannot_be_read_ends_with_one_sentence(simulator: Simulator):
    with Graph() as graph:
        for fault, sentence in SENTENCES.items():
            simulator.do(*fault.split())
            assert sentence in ended(graph)
            simulator.do(
                *{"unplug": "plug", "remove": "insert"}.get(fault, fault[:-1] + "0").split()
            )


def test_another_chip_is_named_and_refused(
    shim: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    with edge.i2c(shim, tmp_path, monkeypatch, 0x78), Graph() as graph:
        assert "answers 0x78 (MPU-6880) to WHO_AM_I" in ended(graph)


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


# --- the shim itself ------------------------------------------------------------------------------


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


def test_a_bus_that_is_closed_in_the_midst_of_a_sample_is_a_failed_transaction(
    simulator: Simulator,
):
    program = """
from stateful_ahrs.mpu9250.bus import BusError
from stateful_ahrs.mpu9250.i2c import I2cBus
bus = I2cBus(1)
bus.close()
try:
    bus.read(0x68, 0x75, 1)
except BusError as error:
    print(error)
"""
    found = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=20.0
    )
    assert found.stdout == "/dev/i2c-1 has been closed.\n", found.stderr
