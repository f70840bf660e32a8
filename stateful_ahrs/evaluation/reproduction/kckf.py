"""S. Yamagishi and L. Jing, "A Lightweight Cubature Kalman Filter for AHRS" (KCKF)."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ... import filters
from ...filters.compiled import bind
from ...filters.cubature import A, ckf, kckf, point_free
from ...filters.fkf import fkf
from ...filters.frames import WorldFrame
from ...filters.gdalkf import gdalkf
from ...filters.kalman import (
    AT_FIRST,
    REFERENCES,
    TUNED,
    Model,
    Noise,
    direction,
    ekf,
    estimate,
    kalman,
)
from ...filters.kernel import KernelFilter
from ...filters.linear import Matrix
from ...filters.samples import Array, Samples
from ...filters.unscented import kukf, ukf
from ...mpu9250.motion import motion
from ...rotor import IDENTITY, Rotor, Vector, conjugate, from_rate, product, unit
from ..metrics import errors, rmse_deg
from ..score import Trial, prepare
from ..score import estimate as run
from .counting import Counted, flops, operations
from .page import (
    AS_PRINTED,
    DIFFERENT,
    MEASURED,
    WORSE,
    Claim,
    Section,
    refuted,
    shown,
)
from .simulated import simulated
from .timing import of_filters, of_steps

Dense = Sequence[Sequence[float]]
Trials = Callable[[], Sequence[Trial]]

EQUAL = 1e-6  # degrees
SHORT = 1500  # rows that are timed: over before other processes want the core
PAIRS = (("ckf", "kckf"), ("ckf", "ckf_point_free"), ("ukf", "kukf"))
TABLE_III = {
    "kckf": "4.40 (1.87) / 2.67 (0.94) / 4.67 (1.21)",
    "ckf": "4.40 (1.87) / 2.67 (0.94) / 4.67 (1.21)",
    "ekf": "4.40 (1.86) / 2.70 (0.91) / 4.66 (1.23)",
    "ukf": "4.40 (1.86) / 2.70 (0.90) / 4.66 (1.23)",
    "kukf": "4.42 (1.89) / 2.69 (0.94) / 4.69 (1.23)",
    "fkf": "3.10 (1.40) / 2.72 (1.03) / 5.29 (1.88)",
    "gdalkf": "2.88 (1.76) / 3.99 (2.17) / 12.43 (6.60)",
    "gyro": "4.20 (4.61) / 3.82 (2.25) / 9.13 (6.22)",
}

# Eq. 16–23 as the paper counts them: on full matrices, by the pseudo-code of its section II-D.


def times(m: Dense, n: Dense) -> list[list[float]]:
    """The product of two matrices."""
    found: list[list[float]] = []
    for row in m:
        found.append([])
        for column in zip(*n, strict=True):
            total, *others = (x * y for x, y in zip(row, column, strict=True))
            for other in others:
                total = total + other
            found[-1].append(total)
    return found


def plus(m: Dense, n: Dense, sign: float = 1.0) -> list[list[float]]:
    """The sum of two matrices, or their difference."""
    return [
        [x + y if sign > 0.0 else x - y for x, y in zip(r, s, strict=True)]
        for r, s in zip(m, n, strict=True)
    ]


def scaled(s: float, m: Dense) -> list[list[float]]:
    """A number times a matrix."""
    return [[s * x for x in row] for row in m]


def transposed(m: Dense) -> list[list[float]]:
    """The columns of a matrix."""
    return [list(column) for column in zip(*m, strict=True)]


def summed(matrices: Sequence[Dense]) -> Dense:
    """The sum of several matrices."""
    total, *others = matrices
    for other in others:
        total = plus(total, other)
    return total


XI = [[[A * sign * (n == k)] for n in range(4)] for sign in (1.0, -1.0) for k in range(4)]


def ckf_prediction(f: Dense, s: Dense, x: Dense, q: Dense, n: float) -> tuple[Dense, Dense]:
    """The predicted state and covariance (eq. 20–23)."""
    points = [plus(times(s, xi), x) for xi in XI]
    points = [times(f, point) for point in points]
    x = scaled(1.0 / (2.0 * n), summed(points))
    squares = summed([times(point, transposed(point)) for point in points])
    p = plus(scaled(1.0 / (2.0 * n), squares), times(x, transposed(x)), -1.0)
    return x, plus(p, q)


def closed_form_prediction(f: Dense, s: Dense, x: Dense, q: Dense, _: float) -> tuple[Dense, Dense]:
    """The same by eq. 16, 17 and 19, which take no point."""
    a = times(f, s)
    return times(f, x), plus(times(a, transposed(a)), q)


def kckf_prediction(f: Dense, s: Dense, x: Dense, q: Dense, _: float) -> tuple[Dense, Dense]:
    """The same by eq. 16–19, with the points of eq. 18 for the observation."""
    a, x_next = times(f, s), times(f, x)
    for xi in XI:
        plus(times(a, xi), x_next)
    return x_next, plus(times(a, transposed(a)), q)


def problem(kind: Callable[[Any], Any] = float) -> tuple[Any, ...]:
    """F, S, x, Q and n of some step, of numbers of that kind."""
    turn = np.array(from_rate((0.3, -0.2, 0.5), 0.01))
    w, x, y, z = turn
    f = np.array([[w, -x, -y, -z], [x, w, z, -y], [y, -z, w, x], [z, y, -x, w]])
    s = np.tril(np.linspace(0.1, 0.4, 16).reshape(4, 4))
    state = np.array([[0.5], [0.5], [-0.5], [0.5]])
    q = 1e-3 * (np.eye(4) - state @ state.T)
    return (*([[kind(v) for v in row] for row in m.tolist()] for m in (f, s, state, q)), kind(4.0))


def prediction_counts() -> dict[str, Counter[str]]:
    """Operations of the three predictions."""
    made: dict[str, Callable[[], Any]] = {
        "CKF": lambda: ckf_prediction(*problem(Counted)),
        "KCKF": lambda: kckf_prediction(*problem(Counted)),
        "closed form": lambda: closed_form_prediction(*problem(Counted)),
    }
    found = {}
    for name, make in made.items():
        Counted.tally.clear()
        make()
        found[name] = Counter(Counted.tally)
    return found


def step_counts() -> dict[str, Counter[str]]:
    """Operations of the kernels' whole step."""
    model = Model(
        unit(from_rate((0.3, -0.2, 0.5), 0.01)),
        1e-4,
        0.03,
        0.1,
        0.5,
        -math.sqrt(0.75),
        (0.1, 0.2, 0.97),
        (0.5, 0.1, -0.86),
    )
    kernels = {"ekf": ekf, "ckf": ckf, "kckf": kckf, "ckf_point_free": point_free}
    return {name: operations(kernel, IDENTITY, AT_FIRST, model) for name, kernel in kernels.items()}


def counts() -> Section:
    """Section II-D."""
    found = prediction_counts()
    totals = {name: flops(own) for name, own in found.items()}
    x, p = ckf_prediction(*problem())
    y, r = kckf_prediction(*problem())
    apart = float(max(np.abs(np.array(x) - y).max(), np.abs(np.array(p) - r).max()))
    steps = {name: flops(own) for name, own in step_counts().items()}
    return Section(
        "Section II-D: operations of the prediction",
        "Counted as the paper counts: on full matrices, S and Q being known, a division for "
        "four. The closed form needs no points (eq. 18); none of the papers has it. The "
        "kernels' own whole steps, with Cholesky, observation and correction, use symmetry and "
        "zeros and are counted as they run.",
        [
            Claim("CKF, eq. 20–23", "826", str(totals["CKF"]), shown(totals["CKF"] == 826)),
            Claim("KCKF, eq. 16–19", "524", str(totals["KCKF"]), shown(totals["KCKF"] == 524)),
            Claim("closed form, eq. 16, 17, 19", "", str(totals["closed form"]), MEASURED),
            Claim(
                "largest difference of the two predictions",
                "none",
                f"{apart:.0e}",
                shown(apart < 1e-12),
            ),
            *(Claim(f"whole step of `{name}`", "", str(n), MEASURED) for name, n in steps.items()),
        ],
    )


@cache
def tumbling() -> Trial:
    """A minute of the simulated chip."""
    return prepare(simulated(motion("tumble"), 60.0))


def apart_deg(pair: tuple[str, str], trials: Sequence[Trial]) -> float:
    """The largest angle between what two filters say."""
    worst = 0.0
    for trial in trials:
        one, other = (run(trial, filters.make(name)) for name in pair)
        worst = max(worst, float(np.degrees(errors(one, other).total.max())))
    return worst


def equality(trials: Sequence[Trial]) -> list[Claim]:
    """Claims on the equality of filters over whole trials."""
    found = {pair: apart_deg(pair, trials) for pair in PAIRS}
    return [
        Claim(
            f"`{one}` − `{other}`, largest angle",
            "none" if other != "ckf_point_free" else "",
            f"{apart:.0e}°",
            shown(apart < EQUAL) if other != "ckf_point_free" else MEASURED,
        )
        for (one, other), apart in found.items()
    ]


class Bare(NamedTuple):
    """A rotor and its covariance."""

    rotor: Rotor = IDENTITY
    covariance: Matrix = AT_FIRST


def bare(state: Bare, _: Any, gyro: Vector, accel: Vector, mag: Vector, dt: float) -> Bare:
    """The paper's filter and nothing around it, for good samples alone."""
    up, field = direction(accel), direction(mag)
    vertical = up[0] * field[0] + up[1] * field[1] + up[2] * field[2]
    model = Model(
        unit(from_rate(gyro, dt)),
        0.25 * dt * dt * 0.01,
        0.0324,
        0.13,
        math.sqrt(1.0 - vertical * vertical),
        vertical,
        up,
        field,
    )
    rotor, covariance = estimate(state.rotor, state.covariance, model)
    return Bare(unit(rotor), covariance)


def times_section() -> Section:
    """Experiment 2."""
    family = (ekf, ckf, kckf, point_free, ukf, kukf, fkf, gdalkf)
    names = {"point_free": "ckf_point_free"}
    kernels = {names.get(one.__name__, one.__name__): bind(bare, estimate=one) for one in family}
    samples = tumbling().samples
    samples = replace(samples, mag=np.where(np.isnan(samples.mag), 1e-5, samples.mag))
    samples = Samples(*(part[:SHORT] for part in vars(samples).values()))
    spent, whole = of_steps(kernels, Bare(), samples), of_filters(kernels, samples)
    pairs = (("kckf", "ckf"), ("ckf_point_free", "ckf"), ("kukf", "ukf"))
    (kckf_, free, kukf_), wholes = (
        [time[one] / time[other] for one, other in pairs] for time in (spent, whole)
    )
    least = min(spent, key=spent.__getitem__)
    return Section(
        "Experiment 2: times, and that nothing is lost",
        "A minute of the simulated chip tumbling. Times are those of the paper's filter alone and, "
        "in brackets, of the filter of this package, which also checks its samples, makes a "
        "snapshot to begin with, and follows the sign.",
        [
            *equality([tumbling()]),
            Claim(
                "KCKF / CKF",
                "0.81 to 0.85",
                f"{kckf_:.2f} ({wholes[0]:.2f})",
                AS_PRINTED if kckf_ <= 0.85 else WORSE,
            ),
            Claim("closed form / CKF", "", f"{free:.2f} ({wholes[1]:.2f})", MEASURED),
            Claim("KUKF / UKF", "", f"{kukf_:.2f} ({wholes[2]:.2f})", MEASURED),
            Claim("least of all", "EKF", least.upper(), shown(least == "ekf")),
            *(
                Claim(f"`{name}`", "", f"{spent[name]:.0f} ns ({whole[name]:.0f} ns)", MEASURED)
                for name in kernels
            ),
        ],
    )


def table_iii(trials: Trials) -> Section:
    """Errors of roll, pitch and yaw on BROAD."""
    claims = []
    means = {}
    for name, printed in TABLE_III.items():
        found = np.array([_euler_rmse(trial, name) for trial in trials()])
        mean, spread = found.mean(axis=0), found.std(axis=0)
        means[name] = mean
        cell = " / ".join(f"{m:.2f} ({s:.2f})" for m, s in zip(mean, spread, strict=True))
        claims.append(Claim(f"`{name}`", printed, cell, MEASURED))
    family = [means[name] for name in ("kckf", "ckf", "ekf", "ukf", "kukf")]
    spread = float(max(np.abs(own - family[0]).max() for own in family))
    worst = max(means, key=lambda name: means[name][2])
    claims += [
        Claim(
            "KCKF, CKF, EKF, UKF, KUKF: largest difference",
            "0.03°, very close",
            f"{spread:.2f}°",
            shown(spread < 0.1),
        ),
        Claim(
            "worst yaw", "RMr-GDALKF", f"`{worst}`", AS_PRINTED if worst == "gdalkf" else DIFFERENT
        ),
        *equality(trials()),
    ]
    return Section(
        "Table III: roll, pitch and yaw",
        f"Mean (standard deviation) of the RMSE in degrees over {len(trials())} trials of "
        "BROAD, whose truth is optical; the paper walked, and took another filter for the "
        f"truth. Noise here: {TUNED.gyro:g} rad/s, {TUNED.accel:g} and {TUNED.mag:g} for the "
        "first five, tuned on these trials; in the paper all alike, its values being lost.",
        claims,
    )


def _euler_rmse(trial: Trial, name: str) -> Array:
    assert trial.truth
    back = conjugate(WorldFrame("enu").rotor)
    angles = []
    counts = trial.truth.counts
    for rotors in (run(trial, filters.make(name))[counts], trial.truth.rotors[counts]):
        w, x, y, z = product(back, tuple(rotors.T))
        angles.append(
            np.stack(
                (
                    np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
                    np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)),
                    np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
                )
            )
        )
    off = np.remainder(angles[0] - angles[1] + np.pi, 2.0 * np.pi) - np.pi
    degrees: Array = np.degrees(np.sqrt((off**2).mean(axis=1)))
    return degrees


ACCEL, MAG = (0.1, 0.18, 0.3, 0.5), (0.2, 0.36, 0.6, 1.0)


def reference(trials: Trials) -> Section:
    """Eq. 11: where the magnetic reference comes from."""
    best = {}
    for kind in REFERENCES:
        found = {
            (accel, mag): _mean_total(Noise(accel=accel, mag=mag, reference=kind), trials())
            for accel, mag in itertools.product(ACCEL, MAG)
        }
        best[kind] = min((error, *noise) for noise, error in found.items())
    rows = [("reference of the EKF", "total", "σ accelerometer", "σ magnetometer")]
    rows += [(kind, f"{e:.2f}°", f"{a:g}", f"{m:g}") for kind, (e, a, m) in best.items()]
    adaptive, recursive, fixed = (best[kind][0] for kind in REFERENCES)
    return Section(
        "Equations 11–14: the adaptive magnetic reference",
        "m_D = a · m takes the dip from the same sample's acceleration, and so lets motion "
        f"into the reference. Mean total RMSE over {len(trials())} trials of BROAD, each with "
        f"the best of {len(ACCEL) * len(MAG)} pairs of noise (of the unit vectors; gyroscope "
        f"{TUNED.gyro:g} rad/s); `Noise.reference` chooses.",
        [
            Claim(
                "eq. 11 is the best reference",
                "taken without comparison",
                f"adaptive {adaptive:.2f}°, recursive {recursive:.2f}°, fixed {fixed:.2f}°",
                refuted(adaptive > max(recursive, fixed)),
            )
        ],
        rows,
    )


def _mean_total(noise: Noise, trials: Sequence[Trial]) -> float:
    f = KernelFilter(kalman(ekf, noise))
    return float(np.mean([rmse_deg(run(t, f), t.truth).total for t in trials if t.truth]))
