"""What a user chooses of any filter."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..errors import UsageError
from ..rotor import Vector

NORTH: Vector = (1.0, 0.0, 0.0)


@dataclass(frozen=True)
class Known:
    """What an earlier run learned of the sensors; by default nothing.

    Angular rate is (1 + E)(measured − bias), the magnetic field measured − hard iron, and the
    magnetometer is late by its delay.
    """

    bias: Vector = (0.0, 0.0, 0.0)  # rad/s
    misalignment: tuple[Vector, Vector, Vector] = ((0.0, 0.0, 0.0),) * 3  # E, row by row
    mag_delay: float = 0.0  # s
    hard_iron: Vector = (0.0, 0.0, 0.0)  # in the magnetometer's unit


NOTHING = Known()


@dataclass(frozen=True)
class Settings:
    """What a user chooses. Times in seconds."""

    alpha: float = 0.9967  # weight of the gyroscope path over 1 / alpha_rate
    alpha_rate: float = 100.0  # Hz; 0: alpha applies to each sample, as in the paper
    alpha_heading: float = -1.0  # the same for heading; negative: as weigh_mag finds, or alpha
    # False: the snapshot keeps its own sign, the paper's baseline, without low_pass, despike,
    # alpha_heading
    stateful: bool = True
    use_mag: bool = True
    mag_timeout: float = 0.5  # older than this a magnetometer sample is stale
    north_at_start: Vector = NORTH  # sensor axis taken for north until a magnetometer tells
    # Not in the paper; of `stateful` alone, but for the second. All off is the paper's filter:
    normalise: bool = True  # after each blend, if stateful; one that is a turn needs it and has it
    average_start: bool = True  # in the first second or two a mean of all samples
    despike: bool = True  # a rate, force or field that no neighbour confirms is taken back
    low_pass: bool = True  # of up, in the earth frame
    learn_bias: bool = True  # the gyroscope's, at rest and on the way
    learn_misalignment: bool = True  # of the gyroscope's axes, and their scale
    learn_mag: bool = True  # the magnetometer's delay and the hard iron left over
    weigh_mag: bool = True  # the less the field is as it was, the less north is the measured one
    known: Known = NOTHING  # taken at the next reset; False above keeps it

    def __post_init__(self) -> None:
        """Refuse what makes no filter."""
        if not 0.0 <= self.alpha <= 1.0:
            raise UsageError(f"alpha must be between 0 and 1, got {self.alpha}.")
        if not -math.inf < self.alpha_heading <= 1.0:
            raise UsageError(
                f"alpha_heading must be between 0 and 1, or negative to leave it to the filter, "
                f"got {self.alpha_heading}."
            )
        if not 0.0 <= self.alpha_rate <= 1e6:
            raise UsageError(
                f"alpha_rate must be between 0 (alpha applies to each sample) and 1e6 Hz, "
                f"got {self.alpha_rate}."
            )
        if not self.mag_timeout >= 0.0:
            raise UsageError(f"mag_timeout must be 0 or more s, got {self.mag_timeout}.")
        if not any(self.north_at_start):
            raise UsageError("north_at_start must be a direction, got zero.")

    @property
    def time_constant(self) -> float:
        """Seconds in which the snapshot's weight grows to 1 − 1/e; nan if α is per sample."""
        if self.alpha_rate <= 0.0:
            return math.nan
        if self.alpha <= 0.0:
            return 0.0
        if self.alpha >= 1.0:
            return math.inf
        return -1.0 / (self.alpha_rate * math.log(self.alpha))

    @property
    def learns(self) -> bool:
        """Whether anything is learned of the sensors."""
        return self.learn_bias or self.learn_misalignment or self.learn_mag or self.weigh_mag

    @property
    def corrects(self) -> bool:
        """Whether samples are corrected by what is learned, or known from an earlier run."""
        return self.learns or self.known != NOTHING


DEFAULTS = Settings()
