"""The blend of eq. 16 as a turn of the predicted rotor.

The snapshot ``s`` is ``δ p``, where ``p`` is the predicted rotor and ``δ`` the turn, in the earth
frame, from what is predicted to what is seen. So

    α p + (1 − α) s  =  (α + (1 − α) δ) p,

and where ``δ`` has w ≥ 0 the snapshot is the one of its two that continues ``p`` (eq. 3–4).
Here ``δ`` is a turn about a level axis, which brings up to the vertical, and after it one about
the vertical, which brings north to the north, and each is blended by itself: so heading may have
an α of its own, and is corrected where a magnetic field comes, for the time since the last, but no
longer than `mag_timeout`.

In the earth frame gravity stands still and motion averages out, so up may be low-passed there.
"""

from __future__ import annotations

import math

from ..rotor import IDENTITY, Rotor, Vector, rotate, slightly
from .gains import START_LOW_PASSED, Gains, Pace, part_of_heading
from .learning import LEVEL, LOW_PASS, Learned
from .senses import DOUBTED, FIRST_HEADING, UP, WEAKEST, Senses, heard, usable
from .spikes import STAYS, ZERO, is_glitch

NEARLY_UPRIGHT = 0.01  # square of the tangent of the angle to the vertical
FAR = 0.999  # square of a rotor's length: below it, one between two others is made a unit again
NEARLY_NORTH = 0.9  # cosine of an error of heading: within it that turn may go in as it is
FAR_OFF = math.cos(math.radians(30.0))  # of a heading that is then told anew
MUCH = 0.9  # a smaller weight of the gyroscope path takes much of the snapshot
UPSIDE_DOWN = 1e-3  # less than this of up above the opposite of the vertical tells no axis


# What stands still in the earth frame: mean specific force (m/s²), the time that went into it (s;
# before the last step at most `LOW_PASS`), the last magnetic field. Without names, because one is
# made for each sample.
Earth = tuple[Vector, float, Vector]
NO_EARTH: Earth = (UP, 0.0, ZERO)


def corrected(
    senses: Senses,
    earth: Earth,
    gains: Gains,
    learned: Learned,
    rate: Vector,
    gyro_rejected: int,
    accel: Vector,
    mag: Vector,
    predicted: Rotor,
    nudge: Vector,
    pace: Pace,
    weight: float,
    elapsed: float,
    dt: float,
) -> tuple[Senses, Earth, bool, Rotor]:
    """Take a sample after the start: what the blend makes of ``predicted``, a unit rotor.

    ``weight`` is α in this step, that of ``pace`` but in a start, ``nudge`` half of a small
    turn (rad) besides, and ``elapsed`` the time since the start. Returns

    - what is remembered from now on, of the samples and in the earth frame;
    - whether heading is told anew: by the first field, which is taken whole, or after a start that
      was far off;
    - the turn of ``predicted``, about axes of the earth: a unit rotor but for the blend.
    """
    (
        _, last_mag, mag_age, started, heading_known, turned, sign_corrections, _, accel_rejected,
        mag_rejected,
    ) = senses  # fmt: skip
    (north, west, up), time, field = earth
    has_up = usable(accel)
    if has_up:
        time = min(time, LOW_PASS) + dt
        share = dt / time
        x, y, z = rotate(predicted, accel)
        north, west, up = toward((north, west, up), (x, y, z), share)
    else:
        x, y, z = ZERO
        accel_rejected += 1
    mean = (north, west, up)
    change = IDENTITY
    if gains.low_pass:
        change = uprighted(mean, 1.0 - weight)
    elif has_up:
        change = uprighted((x, y, z), 1.0 - weight)

    anew, moved = False, weight < MUCH
    mag_age += dt
    x, y, z = mag
    if x == x or y == y or z == z:  # a sample came
        fresh = heard(mag)
        if fresh:
            found = rotate(predicted, mag)
            x, y, z = found
            if moved:  # then level is where up is now, not where it was predicted
                x, y, z = slightly(change, found)
            level = x * x + y * y
            fresh = level > LEVEL * LEVEL * (level + z * z)  # else it is along gravity
            if fresh and gains.despike:
                fresh = not is_glitch(found, field, mag_age, dt)
        if not fresh:
            mag_rejected += 1
            if mag_age - dt >= STAYS:  # the next is believed
                field = ZERO
                heading_known = DOUBTED if heading_known == 1 else heading_known
        else:
            field = found
            last_mag = mag
            if gains.sources.use_mag:
                length = math.sqrt(level)
                if heading_known > 0:
                    span = max(dt, min(mag_age, gains.sources.mag_timeout))
                    part = part_of_heading(gains, learned, pace, elapsed, span)
                    moved = moved or part > 1.0 - MUCH
                    anew = elapsed < START_LOW_PASSED and part > 0.5 and x < FAR_OFF * length
                    change = turned_north(change, x / length, y / length, part)
                else:
                    anew = moved = True
                    heading_known += FIRST_HEADING
                    change = turned_north(IDENTITY, x / length, y / length, 1.0)
            mag_age = 0.0
    if not anew:
        w, i, j, k = change
        change = (w, i + nudge[0], j + nudge[1], k + nudge[2])
    if moved:  # else it is as good where it was seen
        field = slightly(change, field)

    was_turned = turned
    w = predicted[0]  # whose sign a snapshot has of its own, if it is the largest
    turned = w < 0.0 if w * w > 0.5 else -min(predicted) > max(predicted)
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
    return now, (slightly(change, mean), time, field), anew, change


def toward(mean: Vector, value: Vector, share: float) -> Vector:
    """A mean with so large a share of one more value."""
    x, y, z = mean
    return (
        x + share * (value[0] - x),
        y + share * (value[1] - y),
        z + share * (value[2] - z),
    )


def uprighted(up: Vector, part: float) -> Rotor:
    """``1 − part + part δ``, where δ is the shortest turn from ``up`` (m/s²) to the vertical; 1 if
    ``up`` is too weak.

    Half the angle θ of δ, from tan θ = 2 √q: within 6° by series of sine and cosine, whose error is
    below 1e-6 of the angle. That saves two square roots, for which all else would have to wait.
    """
    x, y, z = up
    level = x * x + y * y
    if z > WEAKEST and level < NEARLY_UPRIGHT * z * z:
        s = 0.5 / z
        q = s * s * level
        s *= part
        series = 1.0 - q * (1.5 - 3.875 * q)  # last, as all else can be had before it
        return (1.0 - part * q * (0.5 - 1.375 * q), s * y * series, -s * x * series, 0.0)
    length = math.sqrt(level + z * z)
    if not length > WEAKEST:
        return IDENTITY
    z += length  # half way from it to the vertical
    if not z > UPSIDE_DOWN * length:
        x, y, z = 0.0, length, 0.0
    s = part / math.sqrt(x * x + y * y + z * z)
    return (1.0 - part + s * z, s * y, -s * x, 0.0)


def turned_north(change: Rotor, north: float, west: float, part: float) -> Rotor:
    """``change``, and after it ``part`` of the turn from a measured north to the true one.

    The measured one is level and of length one. The turn is about the vertical, between the rotors
    of no turn and of the whole one; ``change`` is one about a level axis.
    """
    if north < NEARLY_NORTH:
        cosine, sine = far_north(north, west, part)
    else:
        cosine, sine = 1.0 - 0.5 * part * (1.0 - north), -0.5 * part * west
        square = cosine * cosine + sine * sine
        if square < FAR:
            s = 1.0 / math.sqrt(square)
            cosine, sine = s * cosine, s * sine
    w, x, y, _ = change
    return (cosine * w, cosine * x - sine * y, cosine * y + sine * x, sine * w)


def far_north(north: float, west: float, part: float) -> tuple[float, float]:
    """Cosine and sine of half the turn by ``part`` to a north that may be opposite."""
    cosine, sine = 0.5 * (1.0 + north), -0.5 * west
    square = cosine * cosine + sine * sine
    if square < 1e-12:
        cosine, sine = 0.0, 1.0
    else:
        s = 1.0 / math.sqrt(square)
        cosine, sine = s * cosine, s * sine
    cosine, sine = 1.0 - part * (1.0 - cosine), part * sine
    s = 1.0 / math.sqrt(cosine * cosine + sine * sine)
    return s * cosine, s * sine
