"""Filters over whole recordings: ns per sample beside those that PyPI has, on the same arrays."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
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

RATE = 100.0  # Hz, of all three sensors
SAMPLES = 60_000
SHORT = 2_000  # samples for what runs in plain Python
IN_C = ("paper", "stateful")
QUICK = tuple(dict.fromkeys((*IN_C, FILTER)))
# Contraction, because both are compiled with it in Python (`fused` in compiled.py).
C_FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-ffp-contract=fast", "-shared", "-fPIC")


def tumbling(count: int = SAMPLES) -> Samples:
    """A sensor that turns about changing axes, with its noise."""
    random = np.random.default_rng(3)
    t = np.arange(count) / RATE
    gyro = np.stack([1.5 * np.sin(0.7 * t), 1.2 * np.sin(0.43 * t + 1), 0.9 * np.cos(t)], axis=1)
    rotor: Rotor = (1.0, 0.0, 0.0, 0.0)
    accel, mag = np.empty((count, 3)), np.empty((count, 3))
    for i, rate in enumerate(gyro.tolist()):
        back = conjugate(rotor)
        accel[i] = rotate(back, (0.0, 0.0, 9.81))
        mag[i] = rotate(back, (20e-6, 0.0, -40e-6))
        rotor = unit(product(rotor, from_rate(rate, 1.0 / RATE)))
    noise = random.normal(size=(3, count, 3))
    stamps = 10**18 + np.rint(t * 1e9).astype(np.int64)
    return Samples(stamps, gyro + 0.002 * noise[0], accel + 0.08 * noise[1], mag + 6e-7 * noise[2])


def eventful(samples: Samples) -> Samples:
    """The same with a weak first field, a rest, glitches, rates lost, and then another field."""
    gyro, accel, mag = (part.copy() for part in (samples.gyro, samples.accel, samples.mag))
    gyro[:1000] *= 0.002
    accel[:1000], mag[:1000] = accel[:1], mag[:1]
    gyro[2000], accel[2100], mag[2200] = 30.0, 100.0, 1e-3
    gyro[3000:3050] = np.nan
    mag[0] *= 0.01
    mag[len(mag) // 2 :] *= 1.3
    stamps = samples.stamps.copy()
    stamps[len(stamps) // 2 :] += 200_000_000
    return Samples(stamps, gyro, accel, mag)


def measure(quick: bool, seconds: float) -> dict[str, Any]:
    """ns per sample of each, and its ratio to VQF's: medians of rounds in which all take turns."""
    samples = tumbling()
    names = QUICK if quick else tuple(filters.FILTERS)
    runs: dict[str, tuple[int, Callable[[], object]]] = {}
    for name in names:
        filter_ = filters.make(name)
        if _numba() is None:
            part = first(samples, SHORT)
            runs[name] = len(part), lambda f=filter_, s=part: f.run(s)
        else:
            runs[name] = len(samples), lambda f=filter_: f.run(samples)
    runs |= peers(samples)
    in_c = IN_C if shutil.which("cc") else ()
    for name in in_c:
        for same in (eventful(samples), samples) if name == "stateful" else (samples,):
            twin = c_filter(name, same)
            off = float(np.abs(twin() - filters.make(name).run(same)).max())
            assert off < 1e-6, f"{name} in C is another filter: {off}"
        runs[f"{name} in C"] = len(samples), twin
    for _, run in runs.values():
        run()  # compiles
    took: dict[str, list[float]] = {name: [] for name in runs}
    end, rounds = time.monotonic() + seconds, 0
    while rounds < 5 or time.monotonic() < end:
        rounds += 1
        for name, (count, run) in runs.items():
            begin = time.perf_counter()
            run()
            took[name].append((time.perf_counter() - begin) * 1e9 / count)
    found: dict[str, Any] = {
        name: {
            "ns": median(own),
            "of_vqf": median(a / b for a, b in zip(own, took["vqf"], strict=True)),
        }
        for name, own in took.items()
    }
    for name in in_c:
        ratios = (a / b for a, b in zip(took[name], took[f"{name} in C"], strict=True))
        found[name]["of_c"] = median(ratios)
    remarks = [] if in_c else ["No comparison with C: there is no compiler (cc) here."]
    return {"filters": found, "rounds": rounds, "remarks": remarks}


def first(samples: Samples, count: int) -> Samples:
    """The first so many samples."""
    return Samples(*(getattr(samples, n)[:count] for n in ("stamps", "gyro", "accel", "mag")))


def peers(samples: Samples) -> dict[str, tuple[int, Callable[[], object]]]:
    """What PyPI has, each by its way for whole recordings, with its defaults."""
    import ahrs
    import imufusion
    from vqf import VQF

    gyro, accel, mag = samples.gyro, samples.accel, samples.mag
    few = first(samples, SHORT)
    degrees, g = np.degrees(few.gyro), few.accel / 9.81
    microtesla = few.mag * 1e6

    def fusion() -> None:
        filter_ = imufusion.Ahrs()
        filter_.set_sample_period(1.0 / RATE)
        for i in range(SHORT):
            filter_.update(degrees[i], g[i], microtesla[i])

    def of_ahrs(kind: Any) -> Callable[[], object]:
        return lambda: kind(gyr=few.gyro, acc=few.accel, mag=few.mag * 1e3, frequency=RATE)

    return {
        "vqf": (len(samples), lambda: VQF(1.0 / RATE).updateBatch(gyro, accel, mag)),
        "imufusion": (SHORT, fusion),
        "ahrs madgwick": (SHORT, of_ahrs(ahrs.filters.Madgwick)),
        "ahrs mahony": (SHORT, of_ahrs(ahrs.filters.Mahony)),
        "ahrs ekf": (SHORT, of_ahrs(ahrs.filters.EKF)),
    }


def c_filter(name: str, samples: Samples) -> Callable[[], Array]:
    """The filter of that name written in C, over these samples."""
    library = Path(tempfile.mkdtemp(prefix="stateful_ahrs_bench")) / f"{name}.so"
    source = Path(__file__).with_name(f"{name}.c")
    subprocess.run(["cc", *C_FLAGS, "-o", library, source, "-lm"], check=True)
    run = ctypes.CDLL(str(library)).run
    arrays = [samples.gyro, samples.accel, samples.mag, steps(samples.stamps)]
    rotors = np.empty((len(samples), 4))
    pointers = [ctypes.c_void_p(array.ctypes.data) for array in (*arrays, rotors)]

    def call() -> Array:
        run(
            ctypes.c_long(len(samples)),
            ctypes.c_double(DEFAULTS.alpha),
            ctypes.c_double(DEFAULTS.alpha_rate),
            *pointers,
        )
        return rotors

    call.arrays = arrays  # type: ignore[attr-defined]  # kept alive
    return call
