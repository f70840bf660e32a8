"""Takes what comes on a topic of several namespaces, and tells when asked.

A line on stdin is a namespace; the answer is a list, for each sample since the last time: ns from
its sending (see `source`) to its arrival, and its stamp in ns.
"""

from __future__ import annotations

import json
import struct
import sys
import threading
import time
from collections.abc import Callable

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Imu

from stateful_ahrs.nodes import cdr
from stateful_ahrs.nodes.life import fastest_executor

SENT = struct.Struct("<d")  # the last element of the gyroscope's covariance ...
BEHIND = 104  # ... and so many bytes from there to the end
DEPTH = QoSProfile(depth=20_000)


def taker(heard: list[tuple[int, bytes]]) -> Callable[[bytes], None]:
    """A callback that keeps a message and when it came."""

    def take(data: bytes) -> None:
        heard.append((time.monotonic_ns(), data))

    return take


def main() -> None:
    """Listen until stdin ends."""
    topic, *namespaces = sys.argv[1:]
    rclpy.init()
    node = Node("sink", start_parameter_services=False)
    heard: dict[str, list[tuple[int, bytes]]] = {n: [] for n in namespaces}
    for n in namespaces:
        node.create_subscription(Imu, f"/{n}/{topic}", taker(heard[n]), DEPTH, raw=True)
    executor, _ = fastest_executor()
    executor.add_node(node)
    ended = threading.Event()

    def answer() -> None:
        for line in sys.stdin:
            taken = heard[line.strip()][:]
            del heard[line.strip()][: len(taken)]
            rows = [
                (
                    arrival - int(SENT.unpack_from(data, len(data) - BEHIND)[0]),
                    cdr.inertial(data)[0],
                )
                for arrival, data in taken
            ]
            print(json.dumps(rows), flush=True)
        ended.set()

    threading.Thread(target=answer, daemon=True).start()
    print("ready", flush=True)
    while not ended.is_set():
        executor.spin_once(timeout_sec=0.1)


if __name__ == "__main__":
    main()
