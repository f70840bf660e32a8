"""The stateful complementary filter of Kusaka and Tanaka (eq. 12 and 16).

The gyroscope path ``q ⊗ q_ω`` and the snapshot of accelerometer and magnetometer are blended
element by element, which is allowed because the snapshot takes the sign that continues the
gyroscope path.

Deviations from the paper
- The rotor of eq. 12 is exact (eq. 11) where one step turns by more than 0.2 rad.
- Eq. 14 multiplies the gyroscope's rotor on the left, as if rates were measured in the earth
  frame. A strapped-down gyroscope measures in the sensor frame: the rotor goes on the right.
- The sign of the snapshot is compared with the predicted rotor; eq. 3 has the last one.
- Not in the paper, and off where the filter is called the paper's: the rotor is normalised after
  each blend, and for the first second the blend is the mean of all snapshots so far.
- The paper leaves the start open: the first snapshot is taken as it is, after a restart with the
  sign that continues, and so is the first heading that a magnetometer gives.
- The paper blends once for each sample of all three sensors. Here α may be given for a fixed
  span of time, and a magnetometer sample that is missing, stale or useless costs only its
  heading: the snapshot is then taken with the north that the gyroscope predicts.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from ..rotor import IDENTITY, Rotor, Vector, blend, dot, negative, product, unit
from .compiled import bind
from .kernel import NO_MAG as NO_MAG
from .kernel import Kernel, KernelFilter
from .kernel import Report as Report
from .senses import FASTEST as FASTEST
from .senses import STRONGEST as STRONGEST
from .senses import UP as UP
from .senses import WEAKEST as WEAKEST
from .senses import Senses, Sources, feel, look, sources
from .settings import DEFAULTS
from .settings import Settings as Settings

START = 1.0  # s


class Gains(NamedTuple):
    """The settings as the kernel takes them."""

    sources: Sources
    alpha: float
    alpha_rate: float
    stateful: bool
    normalise: bool
    average_start: bool


class State(NamedTuple):
    """All that the filter carries from sample to sample."""

    rotor: Rotor = IDENTITY  # sensor → earth (NWU); of unit length only if normalised
    senses: Senses = Senses()
    elapsed: float = 0.0  # s since the start


def gains(settings: Settings) -> Gains:
    """The settings as the kernel takes them."""
    return Gains(
        sources(settings),
        float(settings.alpha),
        float(settings.alpha_rate),
        settings.stateful,
        settings.normalise,
        settings.average_start,
    )


def predict(rotor: Rotor, turn: Rotor) -> Rotor:
    """The gyroscope path (eq. 14), the turn on the right: in the sensor frame."""
    return product(rotor, turn)


def predict_as_printed(rotor: Rotor, turn: Rotor) -> Rotor:
    """Eq. 14 as printed, the turn on the left, as if rates were measured in the earth frame."""
    return product(turn, rotor)


def weight_of_gyro(alpha: float, alpha_rate: float, dt: float) -> float:
    """The weight that α leaves to the gyroscope path in a step of ``dt`` s."""
    weight = alpha
    if alpha_rate > 0.0:
        weight = alpha ** (dt * alpha_rate)
    return weight


def step(state: State, gains: Gains, gyro: Vector, accel: Vector, mag: Vector, dt: float) -> State:
    """Take one sample of all sensors, ``dt`` s after the last; 0 starts anew (eq. 16)."""
    felt = feel(state.senses, gyro, dt)
    rotor = predicted = predict(state.rotor, felt[0])
    senses, found, _, begins, snapshot = look(
        state.senses, gains.sources, felt, accel, mag, predicted, dt
    )
    elapsed = state.elapsed + dt
    if begins:
        rotor = snapshot
        if dt <= 0.0 or not state.senses.started:
            elapsed = 0.0
    elif found:
        if senses.turned and not gains.stateful:
            snapshot = negative(snapshot)
        weight = weight_of_gyro(gains.alpha, gains.alpha_rate, dt)
        if gains.average_start and elapsed < START:
            weight = min(weight, elapsed / (elapsed + dt))
        rotor = blend(predicted, snapshot, weight)  # eq. 16
    square = dot(rotor, rotor)
    if not square > 1e-12:  # only a stateless blend of opposite signs can vanish
        rotor = predicted
    elif gains.normalise and gains.stateful:
        rotor = unit(rotor)
    return State(rotor, senses, elapsed)


STATEFUL = Kernel(step, State(), gains)
PRINTED = Kernel(bind(step, predict=predict_as_printed), State(), gains)


def over(snapshot: Callable[..., Any]) -> Kernel:
    """The filter over another snapshot than the direct one (eq. 5–10)."""
    return Kernel(bind(step, look=bind(look, snapshot=snapshot)), State(), gains)


class StatefulFilter(KernelFilter):
    """The filter of this module; see `KernelFilter`."""

    def __init__(self, settings: Settings = DEFAULTS, **fixed: Any) -> None:
        super().__init__(STATEFUL, settings, **fixed)
