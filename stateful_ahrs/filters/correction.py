"""The blend of eq. 16 as a turn of the predicted rotor.

The snapshot ``s`` is ``δ p``, where ``p`` is the predicted rotor and ``δ`` the turn, in the earth
frame, from what is predicted to what is seen. So

    α p + (1 − α) s  =  (α + (1 − α) δ) p,

and where ``δ`` has w ≥ 0 the snapshot is the one of its two that continues ``p`` (eq. 3–4).
Here ``δ`` is a turn about a level axis, which brings up to the vertical, and after it one about
the vertical, which brings north to the north, and each is blended by itself: so heading may have
an α of its own, and is corrected where a magnetic field comes, for all the time since the last.

In the earth frame gravity stands still and motion averages out, so up may be low-passed there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..rotor import IDENTITY, Rotor, Vector, rotate, slightly
from .gains import Gains, part_of_heading
from .learning import Learned
from .senses import LEVEL, LOW_PASS, UP, Felt, Senses, heard, says, usable
from .spikes import ZERO, is_glitch

NEARLY_UPRIGHT = 0.01  # square of the tangent of the angle to the vertical
UPSIDE_DOWN = 1e-3  # less than this of up above the opposite of the vertical tells no axis


class Earth(NamedTuple):
    """What stands still in the earth frame."""

    up: Vector = UP  # mean specific force, m/s²
    time: float = 0.0  # s that went into it, at most `LOW_PASS`
    field: Vector = ZERO  # the last magnetic field


def corrected(
    senses: Senses,
    earth: Earth,
    gains: Gains,
    learned: Learned,
    felt: Felt,
    accel: Vector,
    mag: Vector,
    predicted: Rotor,
    weight: float,
    elapsed: float,
    dt: float,
) -> tuple[Senses, Earth, bool, Rotor]:
    """Take a sample after the start: what the blend makes of ``predicted``, a unit rotor.

    ``weight`` is α in this step, and ``elapsed`` the time since the start. Returns

    - what is remembered from now on, of the samples and in the (predicted) earth frame;
    - whether this is the first heading, which is taken whole;
    - the turn of ``predicted``, about axes of the earth: a unit rotor but for the blend.
    """
    _, rate, gyro_rejected = felt
    (
        _, last_mag, mag_age, started, heading_known, turned, sign_corrections, _, accel_rejected,
        mag_rejected,
    ) = senses  # fmt: skip
    (north, west, up), time, field = earth
    has_up = usable(accel)
    if has_up:
        time += dt
        share = dt / time
        if time > LOW_PASS:
            time = LOW_PASS
        x, y, z = rotate(predicted, accel)
        north, west, up = (
            north + share * (x - north),
            west + share * (y - west),
            up + share * (z - up),
        )
    else:
        x, y, z = ZERO
        accel_rejected += 1
    mean = (north, west, up)
    change = IDENTITY
    if usable(mean) if gains.low_pass else has_up:
        change = uprighted(mean if gains.low_pass else (x, y, z), 1.0 - weight)

    first = False
    mag_age += dt
    if says(mag):
        fresh = heard(mag)
        if fresh:
            x, y, z = rotate(predicted, mag)
            square = x * x + y * y
            fresh = square > LEVEL * LEVEL * (square + z * z)  # else it is along gravity
            if fresh and gains.despike:
                fresh = not is_glitch((x, y, z), field, mag_age, dt)
        if not fresh:
            mag_rejected += 1
        else:
            field = (x, y, z)
            last_mag = mag
            if gains.sources.use_mag:
                first = not heading_known
                part = 1.0
                if heading_known:
                    span = max(dt, min(mag_age, gains.sources.mag_timeout))
                    part = part_of_heading(gains, learned, elapsed, span)
                s = part / math.sqrt(square)
                # Half of the way from the measured north, and half of the way that is left.
                cosine, sine = 1.0 - 0.5 * (part - s * x), -0.5 * s * y
                if first:
                    heading_known = True
                    change = about_vertical(cosine, sine)
                else:
                    w, i, j, _ = change
                    change = (
                        cosine * w,
                        cosine * i - sine * j,
                        cosine * j + sine * i,
                        sine * w,
                    )
            mag_age = 0.0

    was_turned = turned
    turned = -min(predicted) > max(predicted)  # the sign that a snapshot has of its own
    if turned != was_turned:
        sign_corrections += 1
    now = Senses(
        rate,
        last_mag,
        mag_age,
        started,
        heading_known,
        turned,
        sign_corrections,
        gyro_rejected,
        accel_rejected,
        mag_rejected,
    )
    return now, Earth(mean, time, field), first, change


def uprighted(up: Vector, part: float) -> Rotor:
    """``1 − part + part δ``, where δ is the shortest turn from ``up`` to the vertical.

    Half the angle θ of δ, from tan θ = 2 √q: within 6° by series of sine and cosine, whose error is
    below 1e-6 of the angle. That saves two square roots, for which all else would have to wait.
    """
    x, y, z = up
    level = x * x + y * y
    if z > 0.0 and level < NEARLY_UPRIGHT * z * z:
        s = 0.5 / z
        q = s * s * level
        s *= part * (1.0 - q * (1.5 - 3.875 * q))
        return (1.0 - part * q * (0.5 - 1.375 * q), s * y, -s * x, 0.0)
    length = math.sqrt(level + z * z)
    z += length  # half way from it to the vertical
    if not z > UPSIDE_DOWN * length:
        x, y, z = 0.0, length, 0.0
    s = part / math.sqrt(x * x + y * y + z * z)
    return (1.0 - part + s * z, s * y, -s * x, 0.0)


def about_vertical(cosine: float, sine: float) -> Rotor:
    """The unit rotor about the vertical from cosine and sine of half the angle, of any length."""
    length = math.sqrt(cosine * cosine + sine * sine)
    if length < 1e-6:  # the field is opposite
        return (0.0, 0.0, 0.0, 1.0)
    return (cosine / length, 0.0, 0.0, sine / length)


def seen_after(earth: Earth, change: Rotor, fresh: bool) -> Earth:
    """The same, after the earth frame was put right by ``change``."""
    up, time, field = earth
    return Earth(slightly(change, up), time, slightly(change, field) if fresh else field)
