"""Compiled times of several kernels in one run, in turn."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np

from ... import filters
from ...filters.compiled import bind, compiled, run_steps
from ...filters.samples import Array, Samples
from ...filters.stamps import steps

ROUNDS = 80


def fastest(runs: Mapping[str, Callable[[], Any]], rounds: int = ROUNDS) -> dict[str, float]:
    """Seconds of each run, the fastest of so many rounds in which each has its turn."""
    best = dict.fromkeys(runs, math.inf)
    for run in runs.values():
        run()
    for _ in range(rounds):
        for name, run in runs.items():
            start = time.perf_counter()
            run()
            best[name] = min(best[name], time.perf_counter() - start)
    return best


def of_filters(names: Iterable[str], samples: Samples) -> dict[str, float]:
    """Nanoseconds a sample of filters."""
    runs = {name: partial(filters.make(name).run, samples) for name in names}
    return {name: 1e9 * spent / len(samples) for name, spent in fastest(runs).items()}


def of_steps(
    kernels: Mapping[str, Callable[..., Any]], start: Any, samples: Samples
) -> dict[str, float]:
    """Nanoseconds a sample of the steps of filters, as `run_steps` takes them."""
    rotors = np.empty((len(samples), 4))
    given = (samples.gyro, samples.accel, samples.mag, steps(samples.stamps), rotors)
    runs = {name: partial(run_steps(step), start, None, *given) for name, step in kernels.items()}
    return {name: 1e9 * spent / len(samples) for name, spent in fastest(runs).items()}


def of_snapshots(
    snapshots: Mapping[str, Callable[..., Any]], accel: Array, mag: Array
) -> dict[str, float]:
    """Nanoseconds a sample of snapshots."""
    rotors = np.empty((len(accel), 4))
    runs = {
        name: partial(compiled(bind(_all, snapshot=kernel), inline=True), accel, mag, rotors)
        for name, kernel in snapshots.items()
    }
    return {name: 1e9 * spent / len(accel) for name, spent in fastest(runs).items()}


def snapshot(*_: Any) -> Any:
    """Stands for the one that is timed."""
    raise NotImplementedError


def _all(accel: Array, mag: Array, rotors: Array) -> None:
    for i in range(len(accel)):
        _, rotor = snapshot(
            (accel[i, 0], accel[i, 1], accel[i, 2]), (mag[i, 0], mag[i, 1], mag[i, 2])
        )
        rotors[i, 0], rotors[i, 1], rotors[i, 2], rotors[i, 3] = rotor
