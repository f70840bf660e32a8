"""A ROS graph of its own for each test: real processes, real DDS, nothing from outside."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest
import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

from stateful_ahrs.nodes.children import free_domain

TIMEOUT = 60.0  # s; a loaded machine is slow to discover, and seldom a second without a hitch


class Graph:
    """Executables of the package, and a node of the test among them.

    ``domain`` joins an existing graph, as one that was launched; without it a free one is taken.
    """

    def __init__(self, domain: int | None = None) -> None:
        self.domain = free_domain() if domain is None else domain
        self._environment = {
            **os.environ,
            "ROS_DOMAIN_ID": str(self.domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        self._processes: list[Process] = []

    def __enter__(self) -> Graph:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=self.domain)
        self.node = Node("test", context=self.context)
        self._executor = EventsExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._ending = False
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()
        return self

    def _spin(self) -> None:
        while not self._ending:
            self._executor.spin_once(timeout_sec=0.1)

    def __exit__(self, *_: object) -> None:
        for process in self._processes:
            process.end()
        self._ending = True
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()

    def start(self, name: str, *arguments: str, **parameters: object) -> Process:
        """Start a node; it ends with the graph."""
        ros = ["--ros-args"] if parameters else []
        for key, value in parameters.items():
            ros += ["-p", f"{key}:={str(value).lower() if isinstance(value, bool) else value}"]
        process = Process(name, [*arguments, *ros], self._environment)
        self._processes.append(process)
        return process

    def hear(self, kind: type, topic: str) -> list[Any]:
        """A list that grows by each message on the topic."""
        heard: list[Any] = []
        self.node.create_subscription(kind, topic, heard.append, QoSProfile(depth=5000))
        return heard

    def speak(self, kind: type, topic: str, listeners: int = 1) -> Any:
        """A publisher that is heard."""
        publisher = self.node.create_publisher(kind, topic, QoSProfile(depth=5000))
        if listeners:
            until(lambda: publisher.get_subscription_count() >= listeners, f"a listener on {topic}")
        return publisher

    def until_published(self, topic: str) -> None:
        """Wait until somebody publishes the topic."""
        until(lambda: self.node.count_publishers(topic) > 0, f"a publisher of {topic}")

    def call(self, kind: type, service: str, request: Any = None) -> Any:
        """Call a service; its response."""
        client = self.node.create_client(kind, service)
        assert client.wait_for_service(TIMEOUT), f"no service {service}"
        future = client.call_async(kind.Request() if request is None else request)
        until(future.done, f"an answer of {service}")
        return future.result()

    def set_parameter(self, node: str, name: str, value: object) -> Any:
        """What `ros2 param set` does; the result with its reason."""
        request = SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]
        )
        return self.call(SetParameters, f"{node}/set_parameters", request).results[0]


class Process:
    """A node of the package, run by the interpreter of the test."""

    def __init__(self, name: str, arguments: list[str], environment: dict[str, str]) -> None:
        self.name = name
        self._process = subprocess.Popen(
            [sys.executable, "-m", f"stateful_ahrs.nodes.{name}", *arguments],
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._lines: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stderr is not None
        self._lines.extend(iter(self._process.stderr.readline, ""))

    @property
    def said(self) -> str:
        """All that it wrote to stderr, where ROS logs to."""
        return "".join(self._lines)

    def wait(self, timeout: float = TIMEOUT) -> int:
        """Its exit code when it has ended by itself."""
        code = self._process.wait(timeout)
        self._reader.join()
        return code

    def end(self, by: signal.Signals = signal.SIGINT, timeout: float = 5.0) -> int:
        """Tell it to end; its exit code."""
        if self._process.poll() is None:
            self._process.send_signal(by)
        try:
            return self.wait(timeout)
        except subprocess.TimeoutExpired:
            self._process.kill()
            raise AssertionError(f"{self.name} did not end within {timeout} s") from None


def interrupt(patched: pytest.MonkeyPatch, where: Any, step: str) -> None:
    """Have Ctrl-C pressed as a program that runs in the test comes to a ``step`` of its own."""
    original = getattr(where, step)

    def interrupted(*arguments: Any) -> Any:
        rclpy.try_shutdown()  # what Ctrl-C does
        return original(*arguments)

    patched.setattr(where, step, interrupted)
    patched.setattr(signal, "signal", lambda *_: None)  # Ctrl-C stays the test's own
    patched.setenv("ROS_DOMAIN_ID", str(free_domain()))


def until(condition: Callable[[], object], what: str, timeout: float = TIMEOUT) -> None:
    """Wait for a condition; AssertionError naming ``what`` after the timeout."""
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end, f"waited {timeout} s in vain for {what}"
        time.sleep(0.005)


def nanoseconds(message: Any) -> int:
    """A message's stamp in ns."""
    stamp = message.header.stamp
    return stamp.sec * 1_000_000_000 + stamp.nanosec
