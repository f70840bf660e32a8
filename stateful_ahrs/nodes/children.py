"""Nodes as processes of their own that end with the one that started them."""

from __future__ import annotations

import ctypes
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from functools import partial
from types import TracebackType
from typing import IO

from ..errors import AhrsError

INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
PATIENCE = 3.0  # s, from SIGINT to SIGKILL
LIBC = ctypes.CDLL(None)
PR_SET_PDEATHSIG = 1  # of linux/prctl.h


def own_domain() -> None:
    """Keep this process's ROS graph, and its children's, to itself, unless the user chose one."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(free_domain()))


def free_domain() -> int:
    """A domain that nobody on this machine speaks in, if there is one."""
    domains = random.sample(range(1, 101), 100)  # above 101 the ports are not safe on Linux
    return next(filter(_is_free, domains), domains[0])


def _is_free(domain: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", 7410 + 250 * domain))  # of the domain's first participant
        except OSError:
            return False
    return True


class Children:
    """Processes of `stateful_ahrs.nodes`, until the block ends.

    In the block SIGINT, SIGTERM and SIGHUP raise nothing, because an exception in the midst of
    rclpy's C++ comes out as another one: `ended` turns them into KeyboardInterrupt.
    """

    def __init__(self) -> None:
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._said: dict[str, IO[bytes]] = {}
        self._interrupted = False

    def __enter__(self) -> Children:
        for number in INTERRUPTS:
            signal.signal(number, self._on_interrupt)
        return self

    def _on_interrupt(self, *_: object) -> None:
        self._interrupted = True

    def start(self, name: str, *arguments: str) -> None:
        """Start an executable; a terminal's Ctrl-C does not reach it."""
        self._said[name] = tempfile.TemporaryFile()  # noqa: SIM115 (the process has it)
        self._running[name] = subprocess.Popen(
            [sys.executable, "-m", f"stateful_ahrs.nodes.{name}", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=self._said[name],
            stderr=subprocess.STDOUT,
            start_new_session=True,
            preexec_fn=partial(_end_with, os.getpid()),  # two calls: no harm beside DDS's threads
        )

    def ended(self, name: str) -> bool:
        """Whether it has ended well; `AhrsError` with its last words if it failed."""
        if self._interrupted:
            raise KeyboardInterrupt
        code = self._running[name].poll()
        if code:
            self._said[name].seek(0)
            words = self._said[name].read().decode(errors="replace").strip().splitlines()
            raise AhrsError(f"{name} ended with code {code}: {words[-1] if words else 'no word.'}")
        return code is not None

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for process in self._running.values():
            _signal(process, signal.SIGINT)
        end = time.monotonic() + PATIENCE
        for process in self._running.values():
            try:
                process.wait(max(0.0, end - time.monotonic()))
            except subprocess.TimeoutExpired:
                _signal(process, signal.SIGKILL)
                process.wait()


def _end_with(parent: int) -> None:
    """Let the kernel end this process should its parent be killed.

    By SIGKILL, because a SIGTERM in the midst of rclpy's start is lost.
    """
    LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it was, just before
        os._exit(1)


def _signal(process: subprocess.Popen[bytes], number: int) -> None:
    """Reach the process and all that it started."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, number)
