"""Nodes at work: what they cost beside the relay, in windows that take turns."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from .processes import Process, ending, node

FILTER = "stateful"  # of fusion: the default, and the most accurate
RATES = {100: 1, 400: 1, 1000: 3, 4000: 1}  # Hz, and how many times as many rounds are for it
STEPS = (5000, 6000, 8000, 10_000, 12_500, 15_000, 20_000)  # Hz, until samples are lost
DRAIN = 0.3  # s after a window, for what is under way
LATE = 1.0  # s after which what is still missing is lost
WARM = 1.0  # s
MANY, MANY_RATE = (1, 2, 4, 8), 200  # IMUs, and Hz of each


class Window(NamedTuple):
    """What a node did with the samples of some seconds."""

    cpu: float  # of one core
    sent: int
    latencies: list[float]  # µs from sending to arrival, of those that arrived

    def percentile(self, p: float) -> float:
        """Of the latencies, µs."""
        return float(np.percentile(self.latencies, p))


class Rig:
    """A source, a sink, and nodes between them, each in the namespace of its name."""

    def __init__(self, **nodes: Process) -> None:
        self.nodes = nodes
        self._source = Process("bench.source", *nodes, speaks=True)
        self._sink = Process("bench.sink", "imu/data", *nodes, speaks=True)

    @property
    def processes(self) -> list[Process]:
        """All of them."""
        return [self._source, self._sink, *self.nodes.values()]

    def warm_up(self) -> None:
        """Send until all nodes answer, and then a little longer."""
        silent = set(self.nodes)
        end = time.monotonic() + 30.0
        while silent:
            assert time.monotonic() < end, f"no answer from {silent}"
            self.send(sorted(silent), 100, 0.2)
            silent -= {name for name in silent if self.heard(name)}
        for name in self.nodes:
            self.send([name], 1000, WARM)
            self.heard(name)

    def send(self, names: Iterable[str], rate: float, seconds: float) -> int:
        """Send so many seconds of samples to each of the nodes; how many."""
        sent: int = self._source.ask({"to": list(names), "rate": rate, "seconds": seconds})
        time.sleep(DRAIN)
        return sent

    def heard(self, name: str) -> list[Any]:
        """What the node has answered since the last time: latency and stamp in ns, of each."""
        heard: list[Any] = self._sink.ask(name)
        return heard

    def window(self, name: str, rate: float, seconds: float) -> Window:
        """Some seconds of one node, while the others rest."""
        before = self.nodes[name].cpu
        sent = self.send([name], rate, seconds)
        cpu = self.nodes[name].cpu - before
        heard = self.heard(name)
        if len(heard) < sent:
            time.sleep(LATE)
            heard += self.heard(name)
        return Window(cpu / seconds, sent, [latency * 1e-3 for latency, _ in heard])


def in_turns(
    rig: Rig, names: Sequence[str], rate: float, seconds: float, rounds: int
) -> dict[str, dict[str, float]]:
    """CPU, latency and loss of each node, and the ratios to the first: medians over the rounds."""
    windows: dict[str, list[Window]] = {name: [] for name in names}
    for k in range(rounds):
        for name in names if k % 2 == 0 else reversed(names):
            windows[name].append(rig.window(name, rate, seconds))
    floor = [(w.cpu, w.percentile(99)) for w in windows[names[0]]]
    found = {}
    for name, own in windows.items():
        pairs = list(zip(own, floor, strict=True))
        found[name] = {
            "cpu_percent": 100.0 * median(w.cpu for w in own),
            "cpu_ratio": median(w.cpu / cpu for w, (cpu, _) in pairs),
            **{f"p{p}_us": median(w.percentile(p) for w in own) for p in (50, 99, 99.9)},
            "p99_excess_us": median(w.percentile(99) - 1.25 * p99 for w, (_, p99) in pairs),
            "lost": sum(w.sent - len(w.latencies) for w in own),
            "sent": sum(w.sent for w in own),
        }
    return found


def rates(seconds: float, rounds: int) -> dict[str, Any]:
    """Fusion beside the relay at each rate, and the highest rate at which nothing is lost."""
    rig = Rig(
        relay=node("relay", "relay", "bench.relay"),
        fusion=node("fusion", "fusion", filter=FILTER),
        messages=node("fusion", "messages", filter=FILTER, fast_lane=False),
    )
    with ending(*rig.processes):
        rig.warm_up()
        found: dict[str, Any] = {
            str(rate): in_turns(rig, ["relay", "fusion", "messages"], rate, seconds, times * rounds)
            for rate, times in RATES.items()
        }
        found["highest_lossless_hz"] = {name: highest(rig, name, seconds) for name in rig.nodes}
    return found


def highest(rig: Rig, name: str, seconds: float) -> int:
    """The highest of `STEPS` at which every sample is answered, in one of two tries."""
    best = 0
    for rate in STEPS:
        tries = (rig.window(name, rate, seconds) for _ in range(2))
        if not any(w.sent == len(w.latencies) for w in tries):
            break
        best = rate
    return best


def memory(seconds: float) -> dict[str, Any]:
    """Resident memory in MB of fusion and the relay: before the first sample, and at 1 kHz.

    ``warm`` is when the windows that look back some seconds are full.
    """
    rig = Rig(
        relay=node("relay", "relay", "bench.relay"), fusion=node("fusion", "fusion", filter=FILTER)
    )
    with ending(*rig.processes):
        time.sleep(3.0)
        rows = {name: [process.rss] for name, process in rig.nodes.items()}
        rig.warm_up()
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            for name, process in rig.nodes.items():
                rows[name].append(process.rss)
            rig.send(rig.nodes, 1000, min(10.0, seconds / 4))
            for name in rig.nodes:
                rig.heard(name)
    return {
        name: {"start": own[0], "warm": own[2], "end": own[-1], "seconds": seconds}
        for name, own in rows.items()
    }


def many(seconds: float) -> dict[str, Any]:
    """CPU of so many nodes together, each with an IMU of its own."""
    most = max(MANY)
    relays = {f"relay{i}": node("relay", f"relay{i}", "bench.relay") for i in range(most)}
    fusions = {f"fusion{i}": node("fusion", f"fusion{i}", filter=FILTER) for i in range(most)}
    rig = Rig(**relays, **fusions)
    found = {}
    with ending(*rig.processes):
        rig.warm_up()
        for count in MANY:
            cpu: dict[str, list[float]] = {"relay": [], "fusion": []}
            lost = 0
            for kind in ("relay", "fusion", "fusion", "relay"):
                names = [f"{kind}{i}" for i in range(count)]
                before = sum(rig.nodes[name].cpu for name in names)
                sent = rig.send(names, MANY_RATE, seconds)
                cpu[kind].append(sum(rig.nodes[name].cpu for name in names) - before)
                lost += sum(sent - len(rig.heard(name)) for name in names)
            relay, fusion = (100.0 * sum(own) / (2.0 * seconds) for own in cpu.values())
            found[str(count)] = {
                "relay_cpu_percent": relay,
                "fusion_cpu_percent": fusion,
                "cpu_ratio": fusion / relay,
                "lost": lost,
            }
    return found


def driver(seconds: float, rounds: int) -> dict[str, float]:
    """CPU of the driver at 1 kHz on the simulated chip beside that of the chip alone, and jitter.

    Jitter is how far the steps between stamps are from 1 ms.
    """
    name = "imu_driver"
    own = node(name, name, rate=1000.0, sim_motion="rest")
    chip = Process("bench.chip", speaks=True)
    sink = Process("bench.sink", "imu/data_raw", name, speaks=True)
    cpu: dict[str, list[float]] = {"driver": [], "chip": []}
    steps, missed = [], 0
    with ending(own, chip, sink):
        end = time.monotonic() + 30.0
        while not sink.ask(name):
            assert time.monotonic() < end, "the driver is silent"
        for _ in range(rounds):
            own.go()
            time.sleep(WARM)
            sink.ask(name)
            before, begin = own.cpu, time.monotonic()
            time.sleep(seconds)
            cpu["driver"].append((own.cpu - before) / (time.monotonic() - begin))
            stamps = np.array([stamp for _, stamp in sink.ask(name)])
            own.stop()
            between = np.diff(stamps) - 1e6
            steps.append(between[between < 0.5e6])
            missed += int(np.sum(np.rint(between[between >= 0.5e6] / 1e6)))
            before = chip.cpu
            chip.ask(seconds)
            cpu["chip"].append((chip.cpu - before) / seconds)
    jitter = np.abs(np.concatenate(steps)) * 1e-3
    beyond = median(d - c for d, c in zip(cpu["driver"], cpu["chip"], strict=True))
    return {
        **{f"{key}_cpu_percent": 100.0 * median(value) for key, value in cpu.items()},
        "beyond_the_chip_percent": 100.0 * beyond,
        "jitter_p50_us": float(np.percentile(jitter, 50)),
        "jitter_p99_us": float(np.percentile(jitter, 99)),
        "samples": sum(len(part) for part in steps),
        "missed": missed,
    }


def start_up(rounds: int) -> dict[str, float]:
    """s from the command until the node is made and takes samples, medians.

    The middleware then needs time to find the others, which is not counted.
    """
    modules = {"relay": "bench.relay", "fusion": "", "imu_driver": ""}
    took: dict[str, list[float]] = {name: [] for name in modules}
    for _ in range(rounds):
        for name, module in modules.items():
            begin = time.monotonic()
            process = node(name, name, module)
            with ending(process):
                process.await_word("executor")
                took[name].append(time.monotonic() - begin)
    return {name: median(own) for name, own in took.items()}
