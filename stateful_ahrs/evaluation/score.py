"""One filter over one recording: what it costs and how far it is from the truth."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from .. import filters
from ..errors import RecordingError
from ..filters.frames import WorldFrame
from ..filters.samples import Array, Samples, Stamps
from ..filters.stamps import steps
from ..filters.stateful import Settings
from ..recordings import Recording, samples
from ..words import counted
from .consistency import snapshots_ahead
from .metrics import LONGEST_GAP, Mask, Rmse, Truth, passes, rmse_deg, sign_flips, truth_at

REPEATS = 5  # of a run that is timed; the fastest counts, the others met other processes
LONG_ENOUGH = 0.05  # s; no further repeat beyond


class Estimate(NamedTuple):
    """Orientations that the recording itself has."""

    stamps: Stamps  # (e,) ns
    rotors: Array  # (e, 4), sensor → earth (ENU), all of them known
    truth: Truth | None  # at these stamps


@dataclass(frozen=True, eq=False)
class Trial:
    """A recording made ready for any number of filters."""

    name: str
    samples: Samples
    truth: Truth | None  # at the stamps of the samples
    has_mag: bool
    choices: tuple[str, ...] = ()  # what the user should know of the recording's topics
    estimates: Mapping[str, Estimate] = field(default_factory=dict)


@dataclass(frozen=True)
class Result:
    """One row of the table; the settings are None where they play no role."""

    recording: str
    filter: str  # or the topic of an estimate
    alpha: float | None
    time_constant: float | None  # s
    samples: int
    rmse: Rmse | None  # without a reference
    sign_flips: int
    ns_per_sample: float | None
    innovation: float | None = None  # degrees, see `consistency`; in a sweep without a reference

    @property
    def error(self) -> float | None:
        """By what a sweep ranks α, in degrees: the total error where it is known."""
        return self.rmse.total if self.rmse else self.innovation


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
    used = ~np.isnan(steps(paired.stamps))  # a skipped sample has no estimate of its own
    truth = _truth(recording, paired.stamps, used, "the IMU")
    has_mag = bool(np.isfinite(mag).any())
    estimates = {topic: _estimate(recording, topic) for topic in recording.estimates}
    paired = replace(paired, gyro=gyro, accel=accel, mag=mag)
    return Trial(name, paired, truth, has_mag, recording.choices, estimates)


def estimate(trial: Trial, filter_: filters.Filter) -> Array:
    """The filter's rotors (n, 4), sensor → earth (ENU)."""
    return WorldFrame("enu").all(filter_.run(trial.samples))


def score(trial: Trial, name: str, settings: Settings) -> Result:
    """Run the filter of that name and compare; the cost is that of the filter alone, warm."""
    return _scored(trial, name, settings, REPEATS)


def scores(trial: Trial, name: str, settings: Sequence[Settings]) -> Iterator[Result]:
    """The same for each α, once compiled; without a reference, with the innovation.

    A filter in which α plays no role has one result, without α.
    """
    if len(settings) == 1:
        yield score(trial, name, settings[0])
        return
    if not filters.make(name, settings[0]).uses_alpha:
        settings = settings[:1]
    ahead = None if trial.truth else snapshots_ahead(trial.samples)
    for each in settings:
        yield _scored(trial, name, each, 1, ahead)


def score_estimate(trial: Trial, topic: str) -> Result:
    """Compare an orientation that the recording itself has, as it stands there."""
    _, rotors, truth = trial.estimates[topic]
    return Result(
        recording=trial.name,
        filter=topic,
        alpha=None,
        time_constant=None,
        samples=len(rotors),
        rmse=rmse_deg(rotors, truth) if truth else None,
        sign_flips=sign_flips(rotors),
        ns_per_sample=None,
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


def short_alpha(alpha: float) -> str:
    """As many digits as tell 1 − α to four."""
    digits = 3 - math.floor(math.log10(1.0 - alpha)) if alpha < 1.0 else 1
    return f"{alpha:.{digits}f}".rstrip("0").rstrip(".")


def _scored(
    trial: Trial, name: str, settings: Settings, repeats: int, ahead: Truth | None = None
) -> Result:
    filter_ = filters.make(name, settings)
    filter_.run(_first(trial.samples))  # compiles it
    best, spent = math.inf, 0.0
    for _ in range(repeats):
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
        alpha=settings.alpha if filter_.uses_alpha else None,
        time_constant=time_constant(settings, trial.samples) if filter_.uses_alpha else None,
        samples=len(trial.samples),
        rmse=rmse_deg(rotors, trial.truth) if trial.truth else None,
        sign_flips=sign_flips(rotors),
        ns_per_sample=1e9 * best / len(trial.samples),
        innovation=_innovation(rotors, ahead, trial.has_mag),
    )


def _innovation(rotors: Array, ahead: Truth | None, has_mag: bool) -> float | None:
    if ahead is None or not ahead.counts.any():
        return None
    found = rmse_deg(rotors, ahead)
    return found.total if has_mag else found.inclination


def _first(samples: Samples) -> Samples:
    return Samples(samples.stamps[:1], samples.gyro[:1], samples.accel[:1], samples.mag[:1])


def _estimate(recording: Recording, topic: str) -> Estimate:
    stamps, rotors = recording.estimates[topic]
    known = np.asarray(np.isfinite(rotors).all(axis=1))
    if not known.any():
        raise RecordingError(
            f"{recording.name}: none of the {len(known)} rotors on {topic} is finite."
        )
    stamps, rotors = stamps[known], rotors[known]
    every = np.ones(len(stamps), np.bool_)
    return Estimate(stamps, rotors, _truth(recording, stamps, every, topic))


def _truth(recording: Recording, stamps: Stamps, used: Mask, what: str) -> Truth | None:
    """The reference, if there is one, at these stamps (n,); ``what`` has these stamps."""
    its_stamps, reference = recording.reference_stamps, recording.reference
    if its_stamps is None or reference is None:
        return None
    loops, its_loops = (int(passes(s).max(initial=0)) for s in (stamps, its_stamps))
    if loops != its_loops:
        raise RecordingError(
            f"{recording.name}: stamps of {what} jump back {counted(loops, 'time')} and those of "
            f"the reference {counted(its_loops, 'time')}, so it is unknown which belong together; "
            "cut the recording at the jumps."
        )
    truth = truth_at(stamps, its_stamps, reference, recording.movement)
    truth = truth._replace(counts=truth.counts & used)
    if not truth.counts.any():
        raise RecordingError(f"{recording.name}: {_why(recording, stamps, what)}")
    return truth


def _why(recording: Recording, stamps: Stamps, what: str) -> str:
    """Why nothing can be scored."""
    its_stamps, reference = recording.reference_stamps, recording.reference
    assert its_stamps is not None and reference is not None
    known = np.asarray(np.isfinite(reference).all(axis=1) & reference.any(axis=1))
    if not known.any():
        return f"none of the {len(known)} rotors of its reference is finite."
    if recording.movement is not None and not (recording.movement & known).any():
        return "its reference is unknown in all the phases that count (its movement)."
    first, last = stamps.min() * 1e-9, stamps.max() * 1e-9
    return (
        f"no sample of {what} has a reference: rotors at most {LONGEST_GAP * 1e-9:g} s apart "
        f"around it; the samples are from {first:.3f} to {last:.3f} s and the {len(known)} of the "
        f"reference from {its_stamps.min() * 1e-9:.3f} to {its_stamps.max() * 1e-9:.3f} s."
    )
