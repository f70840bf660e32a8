"""A recording: the sensors' streams as they were received, and the truth where it is known."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..filters.samples import Array, Samples, Stamps, pair

Progress = Callable[[float], None]  # called now and then with the part that is done, 0 to 1

START = 1_000_000_000  # ns; where a source has no clock: a stamp of zero means "unset" in ROS


@dataclass(frozen=True, eq=False)
class Recording:
    """Streams in the order received; stamps in ns, which may jump back (a looped recording).

    Rotors are (w, x, y, z), sensor → earth (ENU). NaN stands for what a sensor did not report.
    A ``received`` array, ns, is None where the source knows no times but its stamps; these then
    must not jump back.
    """

    name: str
    stamps: Stamps  # (n,)
    gyro: Array  # (n, 3) rad/s
    accel: Array  # (n, 3) m/s², specific force: +g up at rest
    mag_stamps: Stamps  # (k,); k = 0 without a magnetometer
    mag: Array  # (k, 3) tesla
    reference_stamps: Stamps | None = None  # (r,)
    reference: Array | None = None  # (r, 4); a row of NaN where unknown
    movement: NDArray[np.bool_] | None = None  # (r,) the phases that count for BROAD's metric
    received: Stamps | None = None  # (n,) never decreases
    mag_received: Stamps | None = None  # (k,) never decreases
    reference_received: Stamps | None = None  # (r,) never decreases
    left_out: tuple[str, ...] = ()  # topics or columns of the source that are not in here
    choices: tuple[str, ...] = ()  # sentences, where the source had more than one of a kind
    # Orientations that were asked for by topic: stamps (e,) and rotors (e, 4), NaN where unknown.
    estimates: Mapping[str, tuple[Stamps, Array]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raise ValueError if times of reception decrease."""
        for received, stamps in (
            (self.received, self.stamps),
            (self.mag_received, self.mag_stamps),
            (self.reference_received, self.reference_stamps),
        ):
            if stamps is not None and (np.diff(times(received, stamps)) < 0).any():
                raise ValueError(f"{self.name}: samples must be in the order received")

    def __len__(self) -> int:
        return len(self.stamps)


def samples(recording: Recording) -> Samples:
    """The recording as a filter takes it: one row for each inertial sample."""
    before = np.searchsorted(
        times(recording.received, recording.stamps),
        times(recording.mag_received, recording.mag_stamps),
    )
    return pair(
        recording.stamps,
        recording.gyro,
        recording.accel,
        recording.mag_stamps,
        recording.mag,
        before,
    )


def times(received: Stamps | None, stamps: Stamps) -> Stamps:
    """When each sample was received, ns; by its stamp where nothing else is known."""
    return stamps if received is None else received
