"""The magnetic field against a reference, and against another that may be the right one.

A reference in which the sensor has turned is held: heading stays with the gyroscope while another
field is there, for minutes, until it is lost. One that was hardly tried gives way to a field that
stays as long. Which of two fields is right nothing tells, so the deviation of heading takes both in
until one has outlived the other.
"""

from __future__ import annotations

import math
from typing import NamedTuple

# The field: norm and sine of the dip, smoothed, against a reference.
FIELD_SMOOTH = 1.5  # s
NORM_SPREAD = 0.025  # of the norm
DIP_SPREAD = 0.05  # of the sine
SUDDEN = 0.25  # of the square of a deviation that is not smoothed, and twice as noisy
OFF = 10.0  # (standard deviations)²: a field further off is trusted less by the square of it
REFERENCE = 40.0  # s in which the reference follows an undisturbed field
YOUNG = 20.0  # s in which the reference is the mean of all
# Another field that stays while the sensor turns takes the place of the reference.
UNTRIED = 2.0  # s of motion in which a reference is hardly binding
CANDIDATE_SPREAD = 9.0  # (3 σ)²
CANDIDATE_FAR = 16.0  # (4 σ)²
NEARLY_FAR = 0.75 * CANDIDATE_FAR  # from here to there what it says counts less and less
CANDIDATE_AGE = 1.0  # s of motion, at least
OLDEST = 40.0  # s of motion
TRIED = 4.0  # rad that the reference turned in the sensor frame: from then on it is held
REPEATS = 4.0  # s of motion, after which a field that is far off says nothing new
LOST = math.radians(10.0)  # deviation, as it is told, of a heading not worth holding
AGREES = 16.0  # (4 σ)²
REST_COUNTS = 0.05  # of a second in motion
TURNS = 0.05  # rad/s
SURPRISE_TIME = 5.0  # s of motion
SURPRISE_SPREAD = math.radians(2.0)  # of heading, from place to place in a room


class Field(NamedTuple):
    """What is remembered of the magnetometer."""

    time: float = 0.0  # s with a magnetometer
    last: float = 0.0  # norm of the last window
    norm: float = 0.0  # smoothed
    dip: float = 0.0  # its sine, smoothed
    norm_reference: float = 0.0
    dip_reference: float = 0.0
    reference_age: float = 0.0  # s of motion in a field like it
    norm_candidate: float = 0.0
    dip_candidate: float = 0.0
    candidate_age: float = 0.0  # s of motion
    looks: float = 0.0  # rad that the trusted field turned in the sensor frame
    surprise: float = 0.0  # rad: mean of what it says of heading beyond what was known
    left: float = 0.0  # rad: what the one that was left said of heading
    left_age: float = 0.0  # s of motion
    rival: float = 0.0  # rad²: variance of heading, as another field may be the right one


UNSEEN = Field()


def compared(
    field: Field,
    norm: float,
    dip: float,
    north: float,
    held: float,
    turned: float,
    time: float,
    weigh: bool,
) -> tuple[Field, float, bool]:
    """Compare the field of a window of ``time`` s with the reference, and with another field.

    ``norm`` is in the magnetometer's unit, ``dip`` a sine, ``north`` (rad) what the field says of
    heading beyond what is known, ``held`` (rad²) the variance told of that, and ``turned`` (rad)
    how far the field turned in the sensor frame. With ``weigh`` off every field is trusted.

    Also returns how far the field can be trusted (0 to 1), and whether another has just taken the
    place of the reference. Ages count time in motion.
    """
    mag_time = field.time + time
    first = field.norm_reference == 0.0
    share = min(1.0, max(1.0 - math.exp(-time / FIELD_SMOOTH), time / mag_time))
    smooth_norm = field.norm + share * (norm - field.norm)
    smooth_dip = field.dip + share * (dip - field.dip)
    norm_reference = smooth_norm if first else field.norm_reference
    dip_reference = smooth_dip if first else field.dip_reference
    norm_candidate = smooth_norm if first else field.norm_candidate
    dip_candidate = smooth_dip if first else field.dip_candidate
    motion = min(turned, time) + REST_COUNTS * time
    candidate_age = field.candidate_age
    if apart(norm, dip, norm_candidate, dip_candidate) > CANDIDATE_SPREAD:
        norm_candidate, dip_candidate, candidate_age = norm, dip, 0.0
    candidate_age += motion
    share = motion / min(candidate_age, OLDEST)
    norm_candidate += share * (norm - norm_candidate)
    dip_candidate += share * (dip - dip_candidate)
    off = apart(smooth_norm, smooth_dip, norm_reference, dip_reference)
    now = apart(norm, dip, norm_reference, dip_reference)
    # A field that has stayed as long as a reference hardly tried is as likely the honest one.
    age = max(field.reference_age, 1e-3)
    untried = UNTRIED / age * (1.0 + min(1.0, candidate_age / age))
    trust, alike = 1.0, 1.0
    if weigh:
        off_now = max(off, SUDDEN * now)
        alike = 1.0 / (1.0 + off_now)
        off_now /= 1.0 + untried * untried
        trust = 1.0 / (1.0 + off_now * (1.0 + off_now / OFF))
    reference_age = min(field.reference_age + motion * alike, OLDEST)  # another's is not its own
    left, left_age, rival = field.left, field.left_age, 0.0
    if left_age > 0.0:
        left_age *= math.exp(-motion * alike / OLDEST)
        rival = left**2 * odds(left_age, reference_age)
    another = weigh and off > CANDIDATE_SPREAD
    far = weigh and off + (field.surprise / SURPRISE_SPREAD) ** 2 > CANDIDATE_FAR
    older = candidate_age >= max(CANDIDATE_AGE, reference_age)
    if another and field.looks > TRIED:
        # Only if nobody knows better, or it makes no difference.
        older = older and (held + rival > LOST**2 or field.surprise**2 < AGREES * held)
    elif another and reference_age > UNTRIED:
        # Where nothing turns, nothing is lost by waiting.
        older = older and turned > TURNS * time
    swapped = far and older
    looks = field.looks + trust * turned
    if swapped:
        left, left_age = north, reference_age
        norm_reference = smooth_norm = norm_candidate
        dip_reference = smooth_dip = dip_candidate
        reference_age = min(candidate_age, OLDEST)
        trust, looks, surprise = 1.0, turned, 0.0
        rival = left**2 * odds(left_age, reference_age)
    else:
        share = time / mag_time
        if mag_time >= YOUNG:
            share = trust * max(time / REFERENCE, share)
        norm_reference += share * (smooth_norm - norm_reference)
        dip_reference += share * (smooth_dip - dip_reference)
        share = min(1.0, motion / SURPRISE_TIME)
        surprise = around(field.surprise + share * around(north - field.surprise))
        if weigh:
            # What a field that is off says it says as a whole, and not anew in each window.
            repeats = (off - NEARLY_FAR) / (CANDIDATE_FAR - NEARLY_FAR)
            trust /= (1.0 + min(1.0, max(0.0, repeats)) * candidate_age / REPEATS) ** 2
        if another:
            rival += surprise**2 * odds(candidate_age, reference_age)
    field = Field(
        mag_time,
        norm,
        smooth_norm,
        smooth_dip,
        norm_reference,
        dip_reference,
        reference_age,
        norm_candidate,
        dip_candidate,
        candidate_age,
        looks,
        surprise,
        left,
        left_age,
        rival,
    )
    return field, trust, swapped


def apart(norm: float, dip: float, other_norm: float, other_dip: float) -> float:
    """The sum of the squares of how far a field is off another, in standard deviations."""
    of_norm = (norm - other_norm) / (NORM_SPREAD * other_norm)
    of_dip = (dip - other_dip) / DIP_SPREAD
    return of_norm * of_norm + of_dip * of_dip


def around(angle: float) -> float:
    """The same angle (rad) from −π to π."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


def odds(age: float, other: float) -> float:
    """How likely a field is the right one, rather than another of that age (s of motion)."""
    return age * age / (age * age + other * other + 1e-12)
