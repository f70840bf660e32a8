"""Processes that are watched: their CPU and their memory, as the kernel counts them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any


class Process:
    """A module run by this interpreter, with pipes if ``speaks``."""

    def __init__(self, module: str, *arguments: str, speaks: bool = False) -> None:
        self._log = tempfile.TemporaryFile("w+")  # noqa: SIM115 (the process has it)
        pipe = subprocess.PIPE if speaks else subprocess.DEVNULL
        self._process = subprocess.Popen(
            [sys.executable, "-m", module, *arguments],
            stdin=pipe,
            stdout=pipe,
            stderr=self._log,
            text=True,
        )
        if speaks:
            self._line()

    def await_word(self, word: str) -> None:
        """Wait until it has logged a line with the word."""
        while word not in os.pread(self._log.fileno(), 1 << 16, 0).decode():
            assert self._process.poll() is None, f"{self._process.args} ended"
            time.sleep(0.002)

    def ask(self, question: object) -> Any:
        """Write a line, as JSON if it is no string; the answer."""
        stdin = self._process.stdin
        assert stdin is not None
        print(
            question if isinstance(question, str) else json.dumps(question), file=stdin, flush=True
        )
        return json.loads(self._line())

    def _line(self) -> str:
        stdout: IO[str] | None = self._process.stdout
        assert stdout is not None
        line = stdout.readline()
        assert line, f"{self._process.args} ended"
        return line

    @property
    def _proc(self) -> Path:
        return Path("/proc", str(self._process.pid))

    @property
    def cpu(self) -> float:
        """s of CPU so far, of all threads that live."""
        total = 0
        for task in (self._proc / "task").iterdir():
            total += int((task / "schedstat").read_text().split()[0])
        return total * 1e-9

    @property
    def rss(self) -> float:
        """Resident memory in MB."""
        pages = int((self._proc / "statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / 1e6

    def stop(self) -> None:
        """Hold it where it is, until `go`."""
        self._process.send_signal(signal.SIGSTOP)

    def go(self) -> None:
        """Let it go on."""
        self._process.send_signal(signal.SIGCONT)

    def end(self) -> None:
        """End it."""
        self.go()
        if self._process.stdin:
            self._process.stdin.close()
        self._process.send_signal(signal.SIGINT)
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


@contextmanager
def ending(*processes: Process) -> Iterator[None]:
    """End them after the block, whatever happens."""
    try:
        yield
    finally:
        for process in processes:
            process.end()


def node(name: str, namespace: str, module: str = "", **parameters: object) -> Process:
    """A node in a namespace; one of the package unless ``module`` says otherwise."""
    arguments = ["--ros-args", "-r", f"__ns:=/{namespace}"]
    for key, value in parameters.items():
        arguments += ["-p", f"{key}:={str(value).lower() if isinstance(value, bool) else value}"]
    return Process(module or f"stateful_ahrs.nodes.{name}", *arguments)
