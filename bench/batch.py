"""Filters over whole recordings: ns per sample beside those that PyPI has, on the same arrays.

All take turns in many rounds, but for what is slow, which sits most of them out. What is told is
the best of each, because what else happens on the machine only adds; medians stand beside it.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from stateful_ahrs import filters
from stateful_ahrs.filters.compiled import _numba
from stateful_ahrs.filters.samples import Array, Samples
from stateful_ahrs.filters.settings import DEFAULTS
from stateful_ahrs.filters.stamps import steps
from stateful_ahrs.rotor import Rotor, conjugate, from_rate, product, rotate, unit

from .live import FILTER

RATE = 200.0  # Hz, of all three sensors: the driver's default
RATES = (25.0, 50.0, 100.0, 200.0, 400.0, 1000.0)  # Hz, for what depends on it
JITTER = 100_000  # ns: so far are stamps off, as where a host makes them
SAMPLES = 60_000
OF_VQF = 15_000  # of them for VQF, which takes four times as long: a longer run is disturbed more
SHORT = 2_000  # for what runs in plain Python
SLOW, FEW = 0.05, 5  # s: what takes longer takes part in so many rounds
IN_C = ("paper", "stateful")

Runs = dict[str, tuple[int, Callable[[], object]]]  # over how many samples, and how
# Contraction, because both are compiled with it in Python (`fused` in compiled.py).
C_FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-ffp-contract=fast", "-shared", "-fPIC")


def tumbling(rate: float = RATE, count: int = SAMPLES) -> Samples:
    """A sensor that turns about changing axes, with its noise; stamps jitter."""
    random = np.random.default_rng(3)
    t = np.arange(count) / rate
    gyro = np.stack([1.5 * np.sin(0.7 * t), 1.2 * np.sin(0.43 * t + 1), 0.9 * np.cos(t)], axis=1)
    rotor: Rotor = (1.0, 0.0, 0.0, 0.0)
    accel, mag = np.empty((count, 3)), np.empty((count, 3))
    for i, rates in enumerate(gyro.tolist()):
        back = conjugate(rotor)
        accel[i] = rotate(back, (0.0, 0.0, 9.81))
        mag[i] = rotate(back, (20e-6, 0.0, -40e-6))
        rotor = unit(product(rotor, from_rate(rates, 1.0 / rate)))
    noise = random.normal(size=(3, count, 3))
    stamps = 10**18 + np.rint(t * 1e9).astype(np.int64) + random.integers(-JITTER, JITTER, count)
    return Samples(stamps, gyro + 0.002 * noise[0], accel + 0.08 * noise[1], mag + 6e-7 * noise[2])


def eventful(samples: Samples) -> Samples:
    """The same, if of 100 Hz, with what happens seldom: to compare filters that should be alike."""
    gyro, accel, mag = (part.copy() for part in (samples.gyro, samples.accel, samples.mag))
    for rows, rate in ((slice(1000), 0.0), (slice(4000, 5000), 0.02)):  # a rest, a slow turn
        gyro[rows] = gyro[rows] * 0.002 + rate
        accel[rows], mag[rows] = accel[rows][:1], mag[rows][:1]
    accel[0], mag[0] = accel[0][::-1], 0.01 * mag[0]  # a start that is none
    mag[2] = mag[2][::-1]  # what the first heading is given up for, and is given up itself
    gyro[10] = 5.0  # a glitch in the start
    accel[199] = 100.0  # a glitch as the start's mean is full
    gyro[2000], accel[2100], mag[2200] = 30.0, 100.0, 1e-3  # glitches
    gyro[3000:3050] = np.nan
    mag[3500:3600] *= 20.0
    gyro[[5540, 5550, 5580]], accel[5570] = [[30.0], [5.0], [5.0]], 30.0  # where steps are long
    accel[5581], mag[5581] = np.nan, 0.0  # nothing to tell the second by
    after = 8000 + 200 * np.arange(6)  # gaps, and what is bad beside them
    gyro[after[0]], gyro[after[1] - 1], gyro[after[2] + 1] = 20.0, 20.0, 3.0
    accel[after[3]], mag[after[4] : after[4] + 2] = 100.0, 2e-4
    gyro[after[5] - 100 : after[5] + 100] *= 0.02  # slow enough to be known after it
    often = 9300 + 20 * np.arange(40)  # packets, and what is bad in them
    gyro[often[2]], gyro[often[6] - 1], gyro[often[10] + 1] = 20.0, 20.0, 20.0
    accel[often[14]], accel[often[18] + 1], accel[often[22]] = 100.0, 100.0, np.nan
    mag[often[26]], mag[often[30] + 1], mag[often[34]] = 2e-4, 2e-4, 0.0
    gyro[often[38]] = np.nan
    quarter = len(samples) // 4
    mag[2 * quarter : 3 * quarter] *= 1.3  # another field, and back
    mag[3 * quarter : 3 * quarter + 100] = 0.0
    stamps = samples.stamps.copy()
    stamps[5500:] += 15_000_000 * np.minimum(np.arange(len(stamps) - 5500), 100)
    lost_before = [5, 10, 10, 10, 20, 40, *20 * [10, 20], 80]
    for row, lost in zip([*after, *often, quarter], lost_before, strict=True):
        stamps[row:] += lost * 10_000_000
    stamps[3 * quarter :] += 2_000_000_000  # a new start, without a field
    return Samples(stamps, gyro, accel, mag)


def measure(quick: bool, seconds: float) -> dict[str, Any]:
    """ns per sample of each filter, and what that is of VQF's; of some, for each of `RATES`."""
    samples = tumbling()
    names = IN_C if quick else tuple(filters.FILTERS)
    runs = {name: ours(name, samples) for name in names} | peers(samples)
    in_c = IN_C if shutil.which("cc") else ()
    for name in in_c:
        twin = c_filter(name)
        alike = [samples]
        if name == FILTER:
            alike.append(eventful(tumbling(100.0)))
        for same in alike:
            off = float(np.abs(twin(same)() - filters.make(name).run(same)).max())
            assert off < 1e-6, f"{name} in C is another filter: {off}"
        runs[f"{name} in C"] = len(samples), twin(samples)
    took = in_turns(runs, seconds)
    found = beside_vqf(took)
    for name in in_c:
        found[name]["of_c"] = min(took[name]) / min(took[f"{name} in C"])
    by_rate = {}
    for rate in RATES:
        samples = tumbling(rate)
        runs = {name: ours(name, samples) for name in IN_C}
        runs["vqf"] = peers(samples, rate)["vqf"]
        by_rate[f"{rate:g}"] = beside_vqf(in_turns(runs, seconds / len(RATES)))
    remarks = [] if in_c else ["No comparison with C: there is no compiler (cc) here."]
    return {"filters": found, "by_rate": by_rate, "remarks": remarks}


def in_turns(runs: Runs, seconds: float) -> dict[str, list[float]]:
    """ns per sample of each, in rounds; what is slow is in the first alone."""
    for _, run in runs.values():
        run()  # compiles
    took: dict[str, list[float]] = {name: [] for name in runs}
    end, rounds = time.monotonic() + seconds, 0
    while rounds < FEW or time.monotonic() < end:
        rounds += 1
        for name, (count, run) in runs.items():
            if rounds > FEW and took[name][0] * count > SLOW * 1e9:
                continue
            begin = time.perf_counter()
            run()
            took[name].append((time.perf_counter() - begin) * 1e9 / count)
    return took


def beside_vqf(took: Mapping[str, list[float]]) -> dict[str, dict[str, float]]:
    """The best of each, what it is of VQF's best, and the medians of both over common rounds."""
    return {
        name: {
            "ns": min(own),
            "of_vqf": min(own) / min(took["vqf"]),
            "median_ns": median(own),
            "median_of_vqf": median(a / b for a, b in zip(own, took["vqf"], strict=False)),
            "rounds": len(own),
        }
        for name, own in took.items()
    }


def ours(name: str, samples: Samples) -> tuple[int, Callable[[], object]]:
    """A filter of this package; over a part of the samples if nothing can be compiled."""
    filter_ = filters.make(name)
    if _numba() is None:
        samples = first(samples, SHORT)
    return len(samples), lambda: filter_.run(samples)


def first(samples: Samples, count: int) -> Samples:
    """The first so many samples."""
    return Samples(*(getattr(samples, n)[:count] for n in ("stamps", "gyro", "accel", "mag")))


def peers(samples: Samples, rate: float = RATE) -> Runs:
    """What PyPI has, each by its way for whole recordings, with its defaults."""
    import ahrs
    import imufusion
    from vqf import VQF

    most, few = first(samples, OF_VQF), first(samples, SHORT)
    degrees, g = np.degrees(few.gyro), few.accel / 9.81
    microtesla = few.mag * 1e6

    def fusion() -> None:
        filter_ = imufusion.Ahrs()
        filter_.set_sample_period(1.0 / rate)
        for i in range(SHORT):
            filter_.update(degrees[i], g[i], microtesla[i])

    def of_ahrs(kind: Any) -> Callable[[], object]:
        return lambda: kind(gyr=few.gyro, acc=few.accel, mag=few.mag * 1e3, frequency=rate)

    return {
        "vqf": (
            len(most),
            lambda: VQF(1.0 / rate).updateBatch(most.gyro, most.accel, most.mag),
        ),
        "imufusion": (SHORT, fusion),
        "ahrs madgwick": (SHORT, of_ahrs(ahrs.filters.Madgwick)),
        "ahrs mahony": (SHORT, of_ahrs(ahrs.filters.Mahony)),
        "ahrs ekf": (SHORT, of_ahrs(ahrs.filters.EKF)),
    }


def c_filter(name: str) -> Callable[[Samples], Callable[[], Array]]:
    """The filter of that name written in C, as a function of the samples to run it over."""
    with tempfile.TemporaryDirectory(prefix="stateful_ahrs_bench") as folder:
        library = Path(folder) / f"{name}.so"
        source = Path(__file__).with_name(f"{name}.c")
        subprocess.run(["cc", *C_FLAGS, "-o", library, source, "-lm"], check=True)
        run = ctypes.CDLL(str(library)).run

    def over(samples: Samples) -> Callable[[], Array]:
        arrays = [samples.gyro, samples.accel, samples.mag, steps(samples.stamps)]
        rotors = np.empty((len(samples), 4))
        alpha, rate = ctypes.c_double(DEFAULTS.alpha), ctypes.c_double(DEFAULTS.alpha_rate)

        def call() -> Array:
            pointers = [ctypes.c_void_p(array.ctypes.data) for array in (*arrays, rotors)]
            run(ctypes.c_long(len(samples)), alpha, rate, *pointers)
            return rotors

        return call

    return over
