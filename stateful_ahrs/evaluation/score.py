"""One filter over one recording: what it costs and how far it is from the truth."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from .. import filters
from ..errors import RecordingError
from ..filters.frames import WorldFrame
from ..filters.samples import Array, Samples, Stamps
from ..filters.stamps import steps
from ..filters.stateful import Settings
from ..recordings import Recording, samples
from .metrics import LONGEST_GAP, Rmse, Truth, passes, rmse_deg, sign_flips, truth_at

REPEATS = 5  # of a run that is timed; the fastest counts, the others met other processes
LONG_ENOUGH = 0.05  # s; no further repeat beyond


@dataclass(frozen=True, eq=False)
class Trial:
    """A recording made ready for any number of filters."""

    name: str
    samples: Samples
    truth: Truth | None  # at the stamps of the samples
    has_mag: bool


@dataclass(frozen=True)
class Result:
    """One row of the table."""

    recording: str
    filter: str
    alpha: float
    time_constant: float  # s
    samples: int
    rmse: Rmse | None  # without a reference
    sign_flips: int
    ns_per_sample: float


def prepare(recording: Recording) -> Trial:
    """Pair the samples and bring the reference to their stamps.

    Raises RecordingError where no filter could start, or a reference has nothing to say.
    """
    name = recording.name
    paired = samples(recording)
    # Kernels are compiled for one layout: contiguous and writeable.
    gyro, accel, mag = (
        np.array(part, dtype=np.float64, order="C")
        for part in (paired.gyro, paired.accel, paired.mag)
    )
    if not (np.isfinite(gyro).all(axis=1) & np.isfinite(accel).all(axis=1)).any():
        raise RecordingError(
            f"{name}: none of its {len(paired)} IMU samples has finite rates and accelerations."
        )
    truth = None
    if recording.reference is not None and recording.reference_stamps is not None:
        truth = _truth(recording, recording.reference_stamps, recording.reference)
    has_mag = bool(np.isfinite(mag).any())
    return Trial(name, replace(paired, gyro=gyro, accel=accel, mag=mag), truth, has_mag)


def estimate(trial: Trial, filter_: filters.Filter) -> Array:
    """The filter's rotors (n, 4), sensor → earth (ENU)."""
    return WorldFrame("enu").all(filter_.run(trial.samples))


def score(trial: Trial, name: str, settings: Settings) -> Result:
    """Run the filter of that name and compare; the cost is that of the filter alone, warm."""
    filter_ = filters.make(name, settings)
    filter_.run(_first(trial.samples))  # compiles it
    best, spent = math.inf, 0.0
    for _ in range(REPEATS):
        start = time.perf_counter()
        rotors = filter_.run(trial.samples)
        took = time.perf_counter() - start
        best, spent = min(best, took), spent + took
        if spent > LONG_ENOUGH:
            break
    rotors = WorldFrame("enu").all(rotors)
    return Result(
        recording=trial.name,
        filter=name,
        alpha=settings.alpha,
        time_constant=time_constant(settings, trial.samples),
        samples=len(trial.samples),
        rmse=rmse_deg(rotors, trial.truth) if trial.truth else None,
        sign_flips=sign_flips(rotors),
        ns_per_sample=1e9 * best / len(trial.samples),
    )


def time_constant(settings: Settings, samples: Samples) -> float:
    """Seconds in which α leaves 1/e to the gyroscope path; at the usual step if α is per sample."""
    if settings.alpha_rate > 0.0:
        return settings.time_constant
    taken = steps(samples.stamps)
    taken = taken[taken > 0.0]
    if not len(taken):
        return math.nan
    return replace(settings, alpha_rate=1.0 / float(np.median(taken))).time_constant


def _first(samples: Samples) -> Samples:
    return Samples(samples.stamps[:1], samples.gyro[:1], samples.accel[:1], samples.mag[:1])


def _truth(recording: Recording, its_stamps: Stamps, reference: Array) -> Truth:
    stamps = recording.stamps
    loops, its_loops = (int(passes(s).max(initial=0)) for s in (stamps, its_stamps))
    if loops != its_loops:
        raise RecordingError(
            f"{recording.name}: IMU stamps jump back {loops} times and those of the reference "
            f"{its_loops} times, so it is unknown which belong together; cut the recording "
            "at the jumps."
        )
    truth = truth_at(stamps, its_stamps, reference, recording.movement)
    used = ~np.isnan(steps(stamps))  # a skipped sample has no estimate of its own
    truth = truth._replace(counts=truth.counts & used)
    if not truth.counts.any():
        raise RecordingError(f"{recording.name}: {_why(recording, its_stamps, reference)}")
    return truth


def _why(recording: Recording, its_stamps: Stamps, reference: Array) -> str:
    """Why nothing can be scored."""
    known = np.isfinite(reference).all(axis=1) & reference.any(axis=1)
    if not known.any():
        return f"none of the {len(known)} rotors of its reference is finite."
    if recording.movement is not None and not (recording.movement & known).any():
        return "its reference is unknown in all the phases that count (its movement)."
    first, last = recording.stamps.min() * 1e-9, recording.stamps.max() * 1e-9
    return (
        f"no IMU sample has a reference: rotors at most {LONGEST_GAP * 1e-9:g} s apart around it; "
        f"the samples are from {first:.3f} to {last:.3f} s and the {len(known)} of the "
        f"reference from {its_stamps.min() * 1e-9:.3f} to {its_stamps.max() * 1e-9:.3f} s."
    )
