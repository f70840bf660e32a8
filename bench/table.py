"""What was found, as Markdown."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from .live import STEPS

# What is aimed at: what, where it stands, the limit, and whether more is better.
AIMS: list[tuple[str, Any, float, bool]] = [
    ("fusion's CPU at 1 kHz, of the relay's", lambda f: _at(f)["cpu_ratio"], 1.25, False),
    ("its p99 less 1.25 of the relay's, µs", lambda f: _at(f)["p99_excess_us"], 50.0, False),
    ("samples lost at 1 kHz", lambda f: _at(f)["lost"], 0.0, False),
    (
        "highest rate without loss, Hz",
        lambda f: f["rates"]["highest_lossless_hz"]["fusion"],
        10_000,
        True,
    ),
    *(
        (
            f"`{name}` at {rate} Hz, of VQF's time{which}",
            lambda f, name=name, rate=rate, key=key: f["batch"]["by_rate"][rate][name][key],
            limit,
            False,
        )
        for name, limit in (("paper", 0.15), ("stateful", 0.25))
        for rate in ("200", "100")
        for which, key in (("", "of_vqf"), (", medians", "median_of_vqf"))
    ),
    ("`paper`, of its time in C", lambda f: _filter(f, "paper").get("of_c"), 1.3, False),
    ("`stateful`, of its time in C", lambda f: _filter(f, "stateful").get("of_c"), 1.3, False),
    (
        "driver's CPU at 1 kHz beyond the chip's, % of a core",
        lambda f: f["driver"]["beyond_the_chip_percent"],
        15.0,
        False,
    ),
    ("jitter of its stamps, p99, µs", lambda f: f["driver"]["jitter_p99_us"], 200.0, False),
    (
        "fusion's memory beyond the relay's, MB",
        lambda f: f["memory"]["fusion"]["end"] - f["memory"]["relay"]["end"],
        15.0,
        False,
    ),
    (
        "growth of fusion's memory at 1 kHz, MB",
        lambda f: f["memory"]["fusion"]["end"] - f["memory"]["fusion"]["warm"],
        0.5,
        False,
    ),
    ("fusion's start, s", lambda f: f["start_up"]["fusion"], 1.0, False),
    ("the driver's start, s", lambda f: f["start_up"]["imu_driver"], 1.0, False),
]


def _at(found: dict[str, Any]) -> dict[str, Any]:
    row: dict[str, Any] = found["rates"]["1000"]["fusion"]
    return row


def _filter(found: dict[str, Any], name: str) -> dict[str, Any]:
    row: dict[str, Any] = found["batch"]["filters"][name]
    return row


def markdown(found: dict[str, Any]) -> str:
    """All tables."""
    return "\n\n".join(
        (
            f"{found['machine']['cpu']}, {found['machine']['cores']} cores, Python "
            f"{found['machine']['python']}{', QUICK' * found['quick']}; "
            "load of the machine during the parts "
            + ", ".join(f"{part['load']:.1f}" for part in found.values() if _loaded(part)),
            _table(("aim", "at most", "measured", ""), _aims(found)),
            "### Nodes beside the relay\n\n"
            + _table(
                ("Hz", "node", "CPU %", "of the relay's", "p50 µs", "p99 µs", "p99.9 µs", "lost"),
                _rates(found["rates"]),
            ),
            "Highest rate without loss in one of two tries: "
            + ", ".join(
                f"{name} {f'{hz} Hz' if hz else f'below {STEPS[0]} Hz'}"
                for name, hz in found["rates"]["highest_lossless_hz"].items()
            )
            + ".",
            _driver_and_memory(found),
            "### Several IMUs at 200 Hz, a node each\n\n"
            + _table(
                ("IMUs", "relays' CPU %", "fusions' CPU %", "ratio", "lost"),
                ((n, *row.values()) for n, row in found["many"].items() if n != "load"),
            ),
            "### Filters over a recording of 200 Hz\n\n"
            + _table(
                ("filter", "ns a sample", "of VQF's", "of C's", "median ns", "median of VQF's"),
                (
                    (name, row["ns"], row["of_vqf"], row.get("of_c", ""), *_medians(row))
                    for name, row in sorted(
                        found["batch"]["filters"].items(), key=lambda item: item[1]["ns"]
                    )
                ),
            ),
            "### By the rate of all three sensors\n\n"
            + _table(
                ("Hz", "filter", "ns a sample", "of VQF's", "median ns", "median of VQF's"),
                (
                    (rate, name, row["ns"], row["of_vqf"], *_medians(row))
                    for rate, rows in found["batch"]["by_rate"].items()
                    for name, row in rows.items()
                ),
            ),
            *found["batch"]["remarks"],
        )
    )


def _loaded(part: Any) -> bool:
    return isinstance(part, dict) and "load" in part


def _driver_and_memory(found: dict[str, Any]) -> str:
    driver, memory = found["driver"], found["memory"]
    return (
        f"Driver at 1 kHz: {driver['driver_cpu_percent']:.1f} % of a core, the chip alone "
        f"{driver['chip_cpu_percent']:.1f}; {driver['samples']} steps of 1 ms, "
        f"{driver['missed']} missed. Memory in MB after the start, warm, and after "
        f"{memory['fusion']['seconds']:g} s: "
        + ", ".join(
            f"{name} {own['start']:.1f}, {own['warm']:.1f}, {own['end']:.1f}"
            for name, own in memory.items()
            if name != "load"
        )
        + "."
    )


def _medians(row: dict[str, float]) -> tuple[float, float]:
    return row["median_ns"], row["median_of_vqf"]


def _aims(found: dict[str, Any]) -> Iterable[tuple[object, ...]]:
    for what, measured, limit, more in AIMS:
        value = measured(found)
        if value is None:
            continue
        met = value >= limit if more else value <= limit
        yield what, f"{'≥ ' * more}{limit:g}", value, "" if met else "missed"


def _rates(rates: dict[str, Any]) -> Iterable[tuple[object, ...]]:
    for rate, nodes in rates.items():
        if rate in ("load", "highest_lossless_hz"):
            continue
        for name, row in nodes.items():
            numbers = (row[key] for key in ("cpu_percent", "cpu_ratio", "p50_us", "p99_us"))
            yield rate, name, *numbers, row["p99.9_us"], f"{row['lost']} of {row['sent']}"


def _table(head: tuple[str, ...], rows: Iterable[tuple[object, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join(f"| {' | '.join(map(_text, line))} |" for line in lines)


def _text(value: object) -> str:
    if not isinstance(value, float):
        return str(value)
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"
