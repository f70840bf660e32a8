"""The settings as the stateful filter's kernel takes them, and what α makes of a span of time."""

from __future__ import annotations

import math
from typing import NamedTuple

from .learning import LOW_PASS, Chosen, Learned, chosen
from .senses import Sources, sources
from .settings import Settings

START = 1.0  # s: the mean of all snapshots
START_LOW_PASSED = LOW_PASS  # s: until the low-pass is full, its up is taken whole
AVERAGED = 2.0 * LOW_PASS  # s: until then a slow α is that of a mean
NEWER = 3.0  # at the start: the mean north of all samples, the newer the more
SERIES = 3e-3  # change of the weight's logarithm for which a series is as good: to 2e-15


class Gains(NamedTuple):
    """The settings as the kernel takes them."""

    sources: Sources
    alpha: float
    alpha_rate: float
    alpha_heading: float
    decay: float  # 1/s: of the weight's logarithm; 0 if α is that of each sample, −inf if α is 0
    stateful: bool
    normalise: bool
    average_start: bool
    despike: bool
    low_pass: bool
    corrects: bool
    learns: bool
    turns: bool  # the blend is a turn of the predicted rotor (`correction`)
    chosen: Chosen


# What α makes of a step: the step (s), and the weight left to the gyroscope path in it. No step is
# like that of `NO_PACE`.
Pace = tuple[float, float]
NO_PACE: Pace = (-math.inf, 0.0)


def gains(settings: Settings) -> Gains:
    """The settings as the kernel takes them; a rotor of its own sign teaches nothing."""
    learns = settings.learns and settings.stateful
    taught = chosen(settings) if learns else Chosen(False, False, False, False)
    apart = settings.low_pass or settings.despike or settings.alpha_heading >= 0.0
    turns = settings.stateful and (apart or learns)
    return Gains(
        sources(settings),
        float(settings.alpha),
        float(settings.alpha_rate),
        float(settings.alpha_heading),
        settings.alpha_rate * math.log(settings.alpha) if settings.alpha > 0.0 else -math.inf,
        settings.stateful,
        settings.normalise,
        settings.average_start,
        settings.despike and turns,
        settings.low_pass and turns,
        settings.corrects,
        learns,
        turns,
        taught,
    )


def plain_gains(settings: Settings) -> Gains:
    """The same for a kernel that knows the plain blend alone, and no slow room."""
    return gains(settings)._replace(turns=False, despike=False, low_pass=False, learns=False)


def weight_of_gyro(alpha: float, alpha_rate: float, span: float) -> float:
    """The weight that α leaves to the gyroscope path in ``span`` s."""
    weight = alpha
    if alpha_rate > 0.0:
        weight = alpha ** (span * alpha_rate)
    return weight


def paced(gains: Gains, last: Pace, dt: float) -> Pace:
    """What α makes of a step of ``dt`` s, after ``last``.

    Stamps jitter, and a power for each step takes the paper's filter 20 of 70 ns.
    """
    step, weight = last
    x = gains.decay * (dt - step)
    if abs(x) < SERIES:
        return dt, weight * (1.0 + x * (1.0 + x * (1 / 2 + x * (1 / 6 + x * (1 / 24)))))
    return dt, weight_of_gyro(gains.alpha, gains.alpha_rate, dt)


def at_start(gains: Gains, weight: float, elapsed: float, dt: float) -> float:
    """The weight of the gyroscope path, less where the filter has not yet taken a mean."""
    if gains.low_pass and elapsed + dt < START_LOW_PASSED:
        return 0.0
    if elapsed + dt < AVERAGED if gains.low_pass else elapsed < START:
        return min(weight, elapsed / (elapsed + dt))
    return weight


def part_of_heading(
    gains: Gains, learned: Learned, pace: Pace, elapsed: float, span: float
) -> float:
    """How much of the way to the measured north heading goes, ``span`` s after the last one.

    Left to itself, heading is never corrected faster than tilt is.
    """
    if gains.low_pass and gains.average_start and elapsed < START_LOW_PASSED:
        return min(1.0, learned.trust * NEWER * span / elapsed)
    if gains.alpha >= 1.0:
        part = 0.0
    elif gains.alpha_heading >= 0.0:
        kept = weight_of_gyro(gains.alpha_heading, gains.alpha_rate, span)
        part = learned.trust * (1.0 - kept)
    elif gains.chosen.weigh:
        step, kept = pace
        part = min(1.0, span * min(learned.heading_rate, (1.0 - kept) / step))
    else:
        part = 1.0 - weight_of_gyro(gains.alpha, gains.alpha_rate, span)
    if gains.average_start and not gains.low_pass and elapsed < START:
        part = min(1.0, max(part, span / elapsed))
    return part
