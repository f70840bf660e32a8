"""Run everything, print a table in Markdown and write it as JSON.

`python -m bench [--json FILE] [--minutes N] [--quick]`, or `make bench`.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from stateful_ahrs.nodes.children import own_domain

from . import batch, live, table


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(prog="bench", description=__doc__.split("\n")[0])
    parser.add_argument("--json", type=Path, default=Path("bench.json"), metavar="FILE")
    parser.add_argument("--minutes", type=float, default=10.0, help="of the look at memory")
    parser.add_argument("--quick", action="store_true", help="five minutes instead of nineteen")
    options = parser.parse_args()
    quick = options.quick
    seconds, rounds = (1.5, 3) if quick else (1.5, 5)
    own_domain()
    parts = {
        "batch": lambda: batch.measure(quick, 5.0 if quick else 30.0),
        "rates": lambda: live.rates(seconds, rounds),
        "driver": lambda: live.driver(2.0 * seconds, rounds),
        "many": lambda: live.many(seconds),
        "start_up": lambda: live.start_up(rounds),
        "memory": lambda: live.memory(30.0 if quick else 60.0 * options.minutes),
    }
    found: dict[str, Any] = {"machine": machine(), "fusion_filter": live.FILTER, "quick": quick}
    for name, measure in parts.items():
        begin = time.monotonic()
        found[name] = measure()
        load = os.getloadavg()[0]
        print(
            f"{name}: {time.monotonic() - begin:.0f} s, load {load:.1f}",
            file=sys.stderr,
            flush=True,
        )
        found[name]["load"] = load  # of the machine, by others as well
        options.json.write_text(json.dumps(found, indent=1) + "\n")
    print(table.markdown(found))


def machine() -> dict[str, object]:
    """Where it was measured."""
    return {
        "cpu": next(_lines("/proc/cpuinfo", "model name"), platform.machine()),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "load_before": os.getloadavg()[0],
    }


def _lines(file: str, key: str) -> Iterator[str]:
    for line in Path(file).read_text().splitlines():
        if line.startswith(key):
            yield line.partition(":")[2].strip()


if __name__ == "__main__":
    main()
