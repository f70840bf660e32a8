"""The Kalman filters on the rotor that Yamagishi and Jing compare: the model, and the EKF.

S. Yamagishi and L. Jing, "A Lightweight Cubature Kalman Filter for Attitude and Heading Reference
Systems Using Simplified Prediction Equations". The state is the rotor q, sensor → earth (NWU),
with a covariance P of its four elements. The gyroscope turns it (eq. 1–6); up and the magnetic
field are observed in the sensor frame (eq. 7–14). `cubature`, `unscented`, `fkf` and `gdalkf`
hold the other estimates for the same step.

Deviations from the paper
- F = I + (Δt/2) Ω(ω) is the first order of q ⊗ q_ω; here the turn q_ω is a unit rotor.
- A sensor with nothing to say keeps its place with a variance of `FAR`, so that one code serves
  nine axes, six axes and the gyroscope alone.
- `Noise.reference` may take the magnetic reference (eq. 11–14) from elsewhere than from the same
  sample's acceleration, which lets motion into it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from ..errors import UsageError
from ..rotor import IDENTITY, Rotor, Vector, conjugate, dot, product, rotate, unit
from .compiled import bind
from .kernel import Kernel
from .linear import (
    ZERO,
    Four,
    Matrix,
    Six,
    added,
    mixed,
    plus,
    plus_square,
    plus_times,
    times,
    turned,
)
from .senses import UP, Senses, Sources, feel, look, sources
from .settings import NORTH, Settings

FAR = 1e4  # variance, of unit vectors, of what was not measured
LARGEST = 0.25  # variance of an element that nothing is known of
UNKNOWN = 4.0  # trace of a covariance that has run away
V = 1e-2
AT_FIRST: Matrix = ((V, 0.0, 0.0, 0.0), (0.0, V, 0.0, 0.0), (0.0, 0.0, V, 0.0), (0.0, 0.0, 0.0, V))
START = 1.0  # s in which a fixed magnetic reference is learned

ADAPTIVE, RECURSIVE, FIXED = REFERENCES = ("adaptive", "recursive", "fixed")


@dataclass(frozen=True)
class Noise:
    """Standard deviations, and where the magnetic reference comes from.

    Only the ratios of the three matter, but for the first seconds. What a sensor alone observes has
    the time constant of its deviation over the gyroscope's, in s, at any rate.
    """

    gyro: float = 0.1  # rad/s
    accel: float = 0.18  # of the unit vector
    mag: float = 0.36  # of the unit vector
    reference: str = ADAPTIVE  # the sample's own dip (eq. 11), the predicted, or the first second's

    def __post_init__(self) -> None:
        """Refuse what makes no filter."""
        for name in ("gyro", "accel", "mag"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise UsageError(f"{name} noise must be above 0, got {getattr(self, name)}.")
        if self.reference not in REFERENCES:
            raise UsageError(
                f"reference must be one of {', '.join(REFERENCES)}, got {self.reference!r}."
            )


TUNED = Noise()  # on the 15 development trials of BROAD, as those of the FKF and GDALKF


class Gains(NamedTuple):
    """The settings as the kernel takes them."""

    sources: Sources
    gyro: float  # variances
    accel: float
    mag: float
    recursive: bool
    fixed: bool


class State(NamedTuple):
    """All that the filter carries from sample to sample."""

    rotor: Rotor = IDENTITY
    senses: Senses = Senses()
    covariance: Matrix = AT_FIRST
    vertical: float = 0.0  # m_D of a fixed reference
    elapsed: float = 0.0  # s since the start


class Model(NamedTuple):
    """What an estimate takes beside the state (eq. 1–14)."""

    turn: Rotor
    gyro: float  # variances: (Δt/2)² σ_g², and those of what was measured
    accel: float
    mag: float
    north: float  # m_N
    vertical: float  # m_D
    up: Vector  # what was measured, in the sensor frame
    field: Vector


def gains(settings: Settings, noise: Noise = TUNED) -> Gains:
    """The settings as the kernel takes them."""
    return Gains(
        sources(settings),
        noise.gyro**2,
        noise.accel**2,
        noise.mag**2,
        noise.reference == RECURSIVE,
        noise.reference == FIXED,
    )


def estimate(x: Rotor, p: Matrix, model: Model) -> tuple[Rotor, Matrix]:
    """Stands for the filter's own, which `kalman` binds: predict and correct the state."""
    raise NotImplementedError


def step(state: State, gains: Gains, gyro: Vector, accel: Vector, mag: Vector, dt: float) -> State:
    """Take one sample of all sensors, ``dt`` s after the last; 0 starts anew."""
    felt = feel(state.senses, gyro, dt)
    turn = unit(felt[0])
    predicted = product(state.rotor, turn)
    senses, found, from_mag, begins, snapshot = look(
        state.senses, gains.sources, felt, accel, mag, predicted, dt
    )
    to_sensor = conjugate(predicted)
    up, field = rotate(to_sensor, UP), rotate(to_sensor, NORTH)
    accel_variance = mag_variance = FAR
    if found:
        up, accel_variance = direction(accel), gains.accel
    if from_mag:
        field, mag_variance = direction(senses.mag), gains.mag
    vertical = up[0] * field[0] + up[1] * field[1] + up[2] * field[2]
    if begins:
        covariance = AT_FIRST
        if dt > 0.0 and state.senses.started:  # the first heading leaves the tilt alone
            covariance = turned(state.covariance, product(conjugate(state.rotor), snapshot))
        return State(snapshot, senses, covariance, vertical, 0.0)
    elapsed = state.elapsed + dt
    fixed = state.vertical
    if from_mag and elapsed < START:
        fixed += (vertical - fixed) * dt / (elapsed + dt)
    if gains.recursive:
        vertical = rotate(predicted, field)[2]
    elif gains.fixed:
        vertical = fixed
    model = Model(
        turn,
        min(0.25 * dt * dt * gains.gyro, LARGEST),
        accel_variance,
        mag_variance,
        math.sqrt(max(0.0, 1.0 - vertical * vertical)),
        vertical,
        up,
        field,
    )
    rotor, covariance = estimate(state.rotor, state.covariance, model)
    trace = covariance[0][0] + covariance[1][1] + covariance[2][2] + covariance[3][3]
    if not (0.0 < trace < UNKNOWN and dot(rotor, rotor) > 1e-12):
        rotor, covariance = predicted, AT_FIRST
    return State(unit(rotor), senses, covariance, fixed, elapsed)


def kalman(estimate: Callable[..., Any], noise: Noise = TUNED) -> Kernel:
    """The filter with this estimate."""
    return Kernel(bind(step, estimate=estimate), State(), partial(gains, noise=noise))


def direction(v: Vector) -> Vector:
    """The unit vector of one that is not zero."""
    s = 1.0 / math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    return (s * v[0], s * v[1], s * v[2])


def drift(x: Rotor, variance: float) -> Matrix:
    """Q (eq. 5): ``variance`` Ξ Ξᵀ, in the three directions across a unit rotor."""
    s: Matrix = (
        (variance, 0.0, 0.0, 0.0),
        (0.0, variance, 0.0, 0.0),
        (0.0, 0.0, variance, 0.0),
        (0.0, 0.0, 0.0, variance),
    )
    return plus_square(s, -variance, x)


def observed(q: Rotor, north: float, vertical: float) -> Six:
    """h (eq. 7–10): up, and the field that has these parts in the earth frame, as q sees them.

    It is quadratic: q need not be of unit length.
    """
    w, x, y, z = q
    u, v, t = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z
    return (
        u,
        v,
        t,
        north * (w * w + x * x - y * y - z * z) + vertical * u,
        2.0 * north * (x * y - w * z) + vertical * v,
        2.0 * north * (x * z + w * y) + vertical * t,
    )


def innovation(model: Model, z: Six) -> Six:
    """What was measured, less what was expected."""
    up, field = model.up, model.field
    return (
        up[0] - z[0],
        up[1] - z[1],
        up[2] - z[2],
        field[0] - z[3],
        field[1] - z[4],
        field[2] - z[5],
    )


def up_rows(q: Rotor) -> tuple[Four, Four, Four]:
    """Half the Jacobian of up in the sensor frame; the rows by q give up itself."""
    w, x, y, z = q
    return (-y, z, -w, x), (x, w, z, y), (w, -x, -y, z)


def north_rows(q: Rotor) -> tuple[Four, Four, Four]:
    """Half the Jacobian of north in the sensor frame; the rows by q give north itself."""
    w, x, y, z = q
    return (w, x, -y, -z), (-z, y, x, -w), (y, z, w, x)


def ekf(x: Rotor, p: Matrix, model: Model) -> tuple[Rotor, Matrix]:
    """Extended: R is diagonal, so the six observations are taken one after the other."""
    x = product(x, model.turn)
    p = added(turned(p, model.turn), drift(x, model.gyro))
    z = innovation(model, observed(x, model.north, model.vertical))
    a, b, c = up_rows(x)
    d, e, f = north_rows(x)
    d = mixed(model.north, d, model.vertical, a)
    e = mixed(model.north, e, model.vertical, b)
    f = mixed(model.north, f, model.vertical, c)
    by = ZERO
    by, p = corrected(by, p, a, z[0], model.accel)
    by, p = corrected(by, p, b, z[1], model.accel)
    by, p = corrected(by, p, c, z[2], model.accel)
    by, p = corrected(by, p, d, z[3], model.mag)
    by, p = corrected(by, p, e, z[4], model.mag)
    by, p = corrected(by, p, f, z[5], model.mag)
    return plus(x, by), p


def corrected(
    by: Four, p: Matrix, half_row: Four, innovation: float, variance: float
) -> tuple[Four, Matrix]:
    """Take one scalar observation; ``by`` is the correction of the state so far."""
    row = plus(half_row, half_row)
    k = times(p, row)
    s = 1.0 / (dot(row, k) + variance)
    return plus_times(by, s * (innovation - dot(row, by)), k), plus_square(p, -s, k)
