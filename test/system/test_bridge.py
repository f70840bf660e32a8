"""The sketch for the bridge, compiled for this machine, on the simulated registers."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import edge
import pytest
from boards import FUSES
from edge import ROOT, shim
from sensor import read_log

from stateful_ahrs.mpu9250.frame import FrameParser, meaning
from stateful_ahrs.mpu9250.protocols import Record

__all__ = ["shim"]

SKETCH = ROOT / "firmware" / "mpu9250_bridge"
WRAP = 1000 << 32  # ns
ARDUINO = ROOT / "test" / "arduino"


@pytest.fixture(scope="module")
def bridge(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sketch as a program; skips where there is no compiler."""
    compiler = shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        pytest.skip("no C++ compiler for the sketch")
    program = tmp_path_factory.mktemp("bridge") / "bridge"
    flags = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-O1", "-x", "c++"]
    places = ["-include", ARDUINO / "Arduino.h", "-I", ARDUINO, "-I", SKETCH]
    subprocess.run(
        [compiler, *flags, *places, SKETCH / "mpu9250_bridge.ino", "-o", program], check=True
    )
    return program


class Running:
    """The bridge's serial port."""

    def __init__(self, program: Path) -> None:
        self._process = subprocess.Popen([program], stdout=subprocess.PIPE, bufsize=0)
        assert self._process.stdout is not None
        self._port = self._process.stdout
        os.set_blocking(self._port.fileno(), False)
        self.parser = FrameParser()
        self.records: list[Record] = []

    def until(self, condition: Callable[[], object]) -> None:
        end = time.monotonic() + 20.0
        while not condition():
            assert time.monotonic() < end, (len(self.records), self.parser.complaint)
            self.records += self.parser.feed(self._port.read() or b"")
            time.sleep(0.01)

    def more(self, count: int) -> None:
        enough = len(self.records) + count
        self.until(lambda: len(self.records) >= enough)

    def end(self) -> None:
        self._process.kill()
        self._process.wait()


def rows(records: list[Record]) -> list[tuple[int, ...]]:
    """The six axes as the chip had them, at ±4 g and ±1000 °/s."""
    a, g = 32768 / (4 * 9.80665), 32768 / (1000 * 0.017453292519943295)
    return [
        (
            *(round(n * a) for n in record.reading.accel),
            *(round(n * g) for n in record.reading.gyro),
        )
        for record in records
    ]


def test_the_sketch_sends_what_the_chip_measures(
    bridge: Path, shim: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    with edge.i2c(shim, tmp_path, monkeypatch) as simulator:
        running = Running(bridge)
        running.more(800)
        running.end()
        simulator.do("log")
    records, parser = running.records, running.parser
    taken = {row: stamp for stamp, row in read_log(tmp_path / "log")}
    stamps = [taken[row] for row in rows(records)]  # each is a sample of the chip: none is torn
    assert stamps == sorted(set(stamps))
    assert parser.discarded == 1  # the zero at the start
    # its clock is that of this machine, which stamps the simulator's log too; it wraps
    late = [
        ((record.clock or 0) - stamp + WRAP // 2) % WRAP - WRAP // 2
        for record, stamp in zip(records, stamps, strict=True)
    ]
    # a busy machine reads late, now and then even late by much, but never only late
    assert min(map(abs, late)) < 1_000_000
    mags = [record.reading.mag for record in records if record.reading.mag]
    assert len(records) / 20 < len(mags) < len(records)  # a tenth; more where samples were missed
    assert mags[-1] == pytest.approx((25e-6, 0.0, -43e-6), abs=4e-6)
    assert meaning(0x71, 0x06, bytes(FUSES)).size == 23


def test_the_sketch_starts_a_chip_anew_that_failed(
    bridge: Path, shim: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    with edge.i2c(shim, tmp_path, monkeypatch) as simulator:
        running = Running(bridge)
        records, parser = running.records, running.parser
        for fault, mended in [("power", "heal"), ("unplug", "plug"), ("stuck 1", "stuck 0")]:
            running.more(200)
            parser.complaint = ""
            simulator.do(*fault.split())
            running.until(lambda: parser.complaint)
            assert "nobody drives the bus" in parser.complaint
            simulator.do(*mended.split())
            begin = len(records)
            running.more(200)
            after = records[begin + 100 :]
            assert all(r.reading.accel[2] == pytest.approx(9.81, abs=0.5) for r in after)
            assert any(r.reading.mag for r in after)
        running.end()


def test_a_chip_that_is_none_of_ours_is_named_to_the_host(
    bridge: Path, shim: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    with edge.i2c(shim, tmp_path, monkeypatch, 0x68):
        running = Running(bridge)
        running.until(lambda: running.parser.complaint)
        running.end()
    assert running.records == []
    assert "0x68 (MPU-6050 or MPU-9150) to WHO_AM_I" in running.parser.complaint
