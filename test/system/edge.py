"""Simulators at the hardware's edge: processes behind a device file, with faults on request."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from graph import Graph, until

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(HERE.parent))  # for `sensor` and the boards it carries
SHIM_SOURCE = HERE / "i2c_shim.c"
OK, WARN, ERROR = 0, 1, 2


class Simulator:
    """A process that obeys lines."""

    def __init__(self, script: str, *arguments: object) -> None:
        path = os.pathsep.join([str(ROOT), str(HERE.parent), os.environ.get("PYTHONPATH", "")])
        environment = {**os.environ, "PYTHONPATH": path}
        environment.pop("LD_PRELOAD", None)
        self._process = subprocess.Popen(
            [sys.executable, str(HERE / script), *map(str, arguments)],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._answer("ready")

    def do(self, command: str, value: object = "") -> None:
        """Switch a fault; returns when it is done."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{command} {value}\n")
        self._process.stdin.flush()
        self._answer("done")

    def _answer(self, expected: str) -> None:
        assert self._process.stdout is not None
        assert self._process.stdout.readline().strip() == expected

    def end(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(10.0)


@pytest.fixture(scope="session")
def shim(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """i2c_shim.c, compiled; skips where there is no compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None or sys.platform != "linux":
        pytest.skip("no C compiler for the simulated device file")
    library = tmp_path_factory.mktemp("shim") / "i2c_shim.so"
    compiled = subprocess.run(
        [compiler, "-shared", "-fPIC", "-O1", "-o", str(library), str(SHIM_SOURCE), "-ldl"],
        capture_output=True,
        text=True,
    )
    if compiled.returncode:
        pytest.skip(f"the C compiler cannot make the simulated device file: {compiled.stderr}")
    return library


@contextmanager
def i2c(
    shim: Path,
    folder: Path,
    patched: pytest.MonkeyPatch,
    who_am_i: int = 0x71,
    moving: str = "rest",
) -> Iterator[Simulator]:
    """A chip on the bus /dev/i2c-1 of every process that is started meanwhile."""
    pytest.importorskip("smbus2", reason="smbus2 is not installed")
    simulator = Simulator("i2c_simulator.py", folder, 1, folder / "log", who_am_i, moving)
    patched.setenv("LD_PRELOAD", str(shim))
    patched.setenv("I2C_SIMULATOR", str(folder))
    try:
        yield simulator
    finally:
        patched.delenv("LD_PRELOAD")
        patched.delenv("I2C_SIMULATOR")
        simulator.end()


@contextmanager
def board(folder: Path, kind: str, moving: str = "rest", **options: float) -> Iterator[Simulator]:
    """A board at the port ``folder``/tty."""
    pytest.importorskip("serial", reason="pyserial is not installed")
    pairs = [f"{name}={float(value)}" for name, value in options.items()]
    simulator = Simulator("serial_board.py", folder / "tty", folder / "log", kind, moving, *pairs)
    try:
        yield simulator
    finally:
        simulator.end()


class Health:
    """What the imu_driver ``node``, with its namespace, says of itself on /diagnostics."""

    def __init__(self, graph: Graph, node: str = "imu_driver") -> None:
        from diagnostic_msgs.msg import DiagnosticArray

        self._name = f"{node}: sensor"
        self._heard: list[Any] = graph.hear(DiagnosticArray, "/diagnostics")

    @property
    def reports(self) -> list[tuple[int, str, dict[str, str]]]:
        """Level, sentence and values of each report, oldest first."""
        return [
            (status.level[0], status.message, {v.key: v.value for v in status.values})
            for array in self._heard
            for status in array.status
            if status.name == self._name
        ]

    def until(self, level: int, sentence: str = "", count: int = 1) -> dict[str, str]:
        """Wait for reports of this level, from now on; the values of the last."""
        begin = len(self.reports)

        def good() -> bool:
            reports = self.reports[begin:]
            return sum(r[0] == level and sentence in r[1] for r in reports) >= count

        try:
            until(good, f"level {level} {sentence!r}")
        except AssertionError as error:
            raise AssertionError(f"{error}; said was {[r[:2] for r in self.reports]}") from None
        return next(r[2] for r in reversed(self.reports) if r[0] == level and sentence in r[1])

    def suffers(self, device: Simulator, faults: dict[str, tuple[str, str]]) -> None:
        """One after the other: a warning that is counted, and well again. No sample's loss more.

        ``faults``: what is done to the device → sentence, and the count that goes up.
        """
        for fault, (sentence, count) in faults.items():
            device.do(*fault.split())
            assert int(self.until(WARN, sentence)[count]) > 0
            device.do("heal")
            assert self.until(OK)["losses"] == "0"
