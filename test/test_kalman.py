"""The Kalman family against its textbooks, against each other, and on what may go wrong."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from simulated import simulated
from strategies import rotors, vectors
from test_dcm import felt
from test_stateful import errors_deg, recording

from stateful_ahrs.errors import UsageError
from stateful_ahrs.filters import Settings
from stateful_ahrs.filters.cubature import ckf, kckf, point_free
from stateful_ahrs.filters.fkf import fkf
from stateful_ahrs.filters.gdalkf import gdalkf, step_size
from stateful_ahrs.filters.kalman import REFERENCES, Model, Noise, ekf, kalman
from stateful_ahrs.filters.kernel import KernelFilter
from stateful_ahrs.filters.linear import cholesky, explained, explained4
from stateful_ahrs.filters.samples import Samples
from stateful_ahrs.filters.unscented import ALPHA, BETA, kukf, ukf
from stateful_ahrs.recordings import samples as samples_of
from stateful_ahrs.rotor import (
    IDENTITY,
    difference,
    from_axis_angle,
    from_rate,
    product,
    rotate,
    unit,
)

EQUAL = 1e-6  # degrees, over a whole recording
FAMILY = [ekf, ckf, kckf, point_free, ukf, kukf, fkf, gdalkf]
each = pytest.mark.parametrize("estimate", FAMILY, ids=lambda estimate: estimate.__name__)

# The filters of the paper once more, as their textbooks have them: on matrices, with loops over
# points and without a thought of cost.


def matrix(q):
    """The rotation sensor → earth of a unit rotor, times the square of its length."""
    w, x, y, z = q
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def h(q, model):
    to_sensor = matrix(q).T
    return np.r_[to_sensor @ (0, 0, 1), to_sensor @ (model.north, 0, model.vertical)]


def turn_matrix(q):
    w, x, y, z = q
    return np.array([[w, -x, -y, -z], [x, w, z, -y], [y, -z, w, x], [z, y, -x, w]])


def jacobian(function, at, step=1e-6):
    columns = [
        (function(at + step * e) - function(at - step * e)) / (2 * step) for e in np.eye(len(at))
    ]
    return np.stack(columns, axis=1)


def drift_of(x, model):
    w, x, y, z = x
    xi = np.array([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]])
    return model.gyro * xi @ xi.T


def noise_of(model):
    return np.diag([model.accel] * 3 + [model.mag] * 3)


def measured(x, p, pxz, pzz, z, expected):
    gain = pxz @ np.linalg.inv(pzz)
    return x + gain @ (z - expected), p - gain @ pzz @ gain.T


def textbook_ekf(x, p, model):
    f = turn_matrix(model.turn)
    x = f @ x
    p = f @ p @ f.T + drift_of(x, model)
    hh = jacobian(lambda q: h(q, model), x)
    pzz = hh @ p @ hh.T + noise_of(model)
    return measured(x, p, p @ hh.T, pzz, np.r_[model.up, model.field], h(x, model))


def textbook_points(x, p, model, points, weights, weights_c):
    points = [turn_matrix(model.turn) @ q for q in points]
    seen = [h(q, model) for q in points]
    x = sum(w * q for w, q in zip(weights, points, strict=True))
    z = sum(w * s for w, s in zip(weights, seen, strict=True))
    p = drift_of(x, model)
    pxz, pzz = np.zeros((4, 6)), noise_of(model)
    for w, q, s in zip(weights_c, points, seen, strict=True):
        p = p + w * np.outer(q - x, q - x)
        pxz += w * np.outer(q - x, s - z)
        pzz = pzz + w * np.outer(s - z, s - z)
    return measured(x, p, pxz, pzz, np.r_[model.up, model.field], z)


def textbook_ckf(x, p, model):
    s = np.linalg.cholesky(p)
    points = [x + sign * 2.0 * s[:, i] for sign in (1, -1) for i in range(4)]
    return textbook_points(x, p, model, points, [1 / 8] * 8, [1 / 8] * 8)


def textbook_ukf(x, p, model):
    n, kappa = 4, 0.0
    lam = ALPHA**2 * (n + kappa) - n
    s = np.linalg.cholesky(p)
    spread = math.sqrt(n + lam)
    points = [x] + [x + sign * spread * s[:, i] for sign in (1, -1) for i in range(4)]
    others = [1 / (2 * (n + lam))] * 8
    centre = lam / (n + lam)
    return textbook_points(
        x, p, model, points, [centre, *others], [centre + 1 - ALPHA**2 + BETA, *others]
    )


def w_x(m):
    x, y, z = m
    return np.array([[x, 0, z, -y], [0, x, y, z], [z, y, -x, 0], [-y, z, 0, -x]])


def w_z(v):
    x, y, z = v
    return np.array([[z, y, -x, 0], [y, -z, 0, x], [-x, 0, -z, y], [0, x, y, z]])


def linear(x, p, model, measure):
    f = turn_matrix(model.turn)
    x = f @ x
    p = f @ p @ f.T + drift_of(x, model)
    y, noise = measure(x)
    gain = p @ np.linalg.inv(p + noise + 1e-12 * np.eye(4))
    return x + gain @ (y - x), p - gain @ p


def textbook_fkf(x, p, model):
    def y_of(vectors, q):
        a, m = vectors[:3], vectors[3:]
        w = np.eye(4) + model.north * w_x(m) + model.vertical * w_z(m)
        return 0.25 * (np.eye(4) + w_z(a)) @ w @ q

    def measure(q):
        vectors = np.r_[model.up, model.field]
        y, j = y_of(vectors, q), jacobian(lambda v: y_of(v, q), vectors)
        return y / np.linalg.norm(y), j @ noise_of(model) @ j.T

    return linear(x, p, model, measure)


def textbook_gdalkf(x, p, model):
    def measure(q):
        a, m = np.array(model.up), np.array(model.field)
        field = matrix(q) @ m
        north, vertical = np.hypot(*field[:2]), field[2]
        g, cosine = 0.8, a @ m
        s = cosine * vertical + north * math.sqrt(1 - cosine**2)
        assume(s < 1 - 1e-4)  # near 1 the printed form is 0/0
        mu = (1 - math.sqrt((1 - g) ** 2 + g**2 + 2 * g * (1 - g) * s)) / (
            4 - 2 * math.sqrt(2 + 2 * s)
        )
        k = 2 * (w_z(a) + north * w_x(m) + vertical * w_z(m)) - 4 * np.eye(4)

        def by_north(v):
            return np.hypot(*(matrix(q) @ v)[:2]) * w_x(v) @ q

        def by_vertical(v):
            return (matrix(q) @ v)[2] * w_z(v) @ q

        l1, n, d = (
            jacobian(lambda v: w_z(v) @ q, a),
            jacobian(by_north, m),
            jacobian(by_vertical, m),
        )
        noise = 4 * mu**2 * (model.accel * l1 @ l1.T + model.mag * (n @ n.T + d @ d.T))
        return q + mu * k @ q, noise

    return linear(x, p, model, measure)


TEXTBOOKS = {
    ekf: textbook_ekf,
    ckf: textbook_ckf,
    kckf: textbook_ckf,
    point_free: textbook_ckf,
    ukf: textbook_ukf,
    kukf: textbook_ukf,
    fkf: textbook_fkf,
    gdalkf: textbook_gdalkf,
}


@st.composite
def problems(draw):
    """A rotor, its covariance, and a model whose measurements are some 0.1 rad off."""
    x = draw(rotors())
    root = np.array([draw(st.tuples(*[st.floats(-0.1, 0.1)] * 4)) for _ in range(4)])
    turn = unit(from_rate(draw(vectors(3.0)), 0.01))
    vertical = draw(st.floats(-0.9, 0.9))
    up, field = (direction(v) for v in felt(product(x, turn)))
    model = Model(
        turn,
        gyro=1e-4,
        accel=0.03,
        mag=0.1,
        north=math.sqrt(1.0 - vertical * vertical),
        vertical=vertical,
        up=direction(np.add(up, draw(vectors(0.1)))),
        field=direction(np.add(field, draw(vectors(0.1)))),
    )
    return x, root @ root.T + 1e-4 * np.eye(4), model


def direction(v):
    return tuple((np.array(v) / np.linalg.norm(v)).tolist())


@given(problems())
@each
def test_one_step_is_the_textbooks(estimate, problem):
    x, p, model = problem
    state, covariance = estimate(x, tuple(map(tuple, p.tolist())), model)
    expected, spread = TEXTBOOKS[estimate](np.array(x), p, model)
    # 1e-7: of the textbooks' numerical derivatives
    assert state == pytest.approx(expected, abs=1e-7)
    assert np.array(covariance) == pytest.approx(spread, abs=1e-7)


# Over whole recordings


@cache
def trial(mag_every=1):
    """40 s of tumbling with the noise of the data sheets, from 3 s without a magnetometer."""
    recorded = samples_of(simulated("tumble", 40.0, seed=3))
    mag = recorded.mag.copy()
    mag[np.arange(len(mag)) % mag_every != 0] = np.nan
    mag[1000:1300] = np.nan
    return Samples(recorded.stamps, recorded.gyro, recorded.accel, mag)


@cache
def run(estimate, noise, mag_every=1):
    return KernelFilter(kalman(estimate, noise)).run(trial(mag_every))


def largest_difference_deg(estimates, noise, mag_every=1):
    one, other = (run(estimate, noise, mag_every) for estimate in estimates)
    return max(
        math.degrees(difference(tuple(p), tuple(q))) for p, q in zip(one, other, strict=True)
    )


NOISES = [
    Noise(),
    Noise(reference="recursive"),
    Noise(reference="fixed"),
    Noise(gyro=20.0, accel=0.3, mag=0.3),  # so unsure that cubature and Jacobian disagree
]


@pytest.mark.parametrize("noise", NOISES, ids=["tuned", "recursive", "fixed", "unsure"])
@pytest.mark.parametrize(
    "pair",
    [(ckf, kckf), (ckf, point_free), (ukf, kukf)],
    ids=["ckf kckf", "ckf point_free", "ukf kukf"],
)
def test_the_fast_forms_give_the_same(pair, noise):
    assert largest_difference_deg(pair, noise) < EQUAL
    assert largest_difference_deg(pair, noise, mag_every=7) < EQUAL


def test_that_equality_is_more_than_the_likeness_of_any_two():
    assert largest_difference_deg((ckf, ekf), NOISES[-1]) > 1000 * EQUAL
    assert largest_difference_deg((ckf, ukf), NOISES[-1]) > 1000 * EQUAL


@each
def test_only_the_ratios_of_the_noise_matter(estimate):
    # but for the seconds in which the first covariance is forgotten, and the curvature of h
    one, other = (
        run(estimate, Noise(gyro=s * 0.1, accel=s * 0.2, mag=s * 0.3))[2000:] for s in (1.0, 0.5)
    )
    errors = [difference(tuple(p), tuple(q)) for p, q in zip(one, other, strict=True)]
    assert math.degrees(max(errors)) < 0.02


@pytest.mark.parametrize("rate", [50, 200])
@pytest.mark.parametrize("estimate", [ekf, ckf, kckf, point_free, ukf, kukf])
def test_the_time_constant_is_the_ratio_of_the_noises_at_any_rate(estimate, rate):
    # a heading 0.1 rad off, by a magnet, in a level field, which is alone in telling heading
    samples, _ = recording("rest", 14.1, rate=rate)
    samples.mag[:] = felt(IDENTITY, dip=0.0)[1]
    samples.mag[: 10 * rate] = felt(from_axis_angle((0.0, 0.0, 1.0), 0.1), dip=0.0)[1]
    f = KernelFilter(kalman(estimate, Noise(gyro=0.1, accel=0.1, mag=0.2)))
    left = difference(tuple(f.run(samples)[12 * rate]), IDENTITY)
    assert left == pytest.approx(0.1 * math.exp(-1.0), rel=0.1)


@each
def test_the_covariance_stays_one(estimate):
    f = KernelFilter(kalman(estimate))
    f.run(trial())
    p = np.array(f._state.covariance)
    assert p == pytest.approx(p.T, abs=1e-12)
    assert np.linalg.eigvalsh(p).min() > 0.0
    # what the filter is sure to within: 0.1 rad, and more than 1e-4
    assert 1e-8 < np.trace(p) < 1e-2


def test_without_a_magnetometer_the_filter_knows_that_heading_drifts():
    f = KernelFilter(kalman(kckf))
    samples, _ = recording("rest", 60.0, mag_every=10**9)
    samples.mag[1:] = np.nan

    def heading_and_tilt(state):
        w, x, y, z = state.rotor
        about = {"z": np.array([-z, -y, x, w]), "x": np.array([-x, w, -z, y])}
        p = np.array(state.covariance)
        return about["z"] @ p @ about["z"], about["x"] @ p @ about["x"]

    f.run(Samples(*(part[:1000] for part in vars(samples).values())))
    early, _ = heading_and_tilt(f._state)
    f.run(samples)
    late, tilt = heading_and_tilt(f._state)
    # (Δt/2)² σ_g² in each of 5000 steps
    assert late - early == pytest.approx(5000 * (0.005 * Noise.gyro) ** 2, rel=0.05)
    assert tilt < 0.1 * late


@each
def test_the_first_heading_leaves_the_tilt_alone(estimate):
    f = KernelFilter(kalman(estimate))
    accel, mag = felt(IDENTITY)
    for i in range(1000):
        f.update_imu((0.0, 0.0, 0.0), accel, 0.0 if i == 0 else 0.01)
    f.update_mag(mag)
    for _ in range(10):
        f.update_imu((0.0, 0.0, 0.0), (4.0, 0.0, 9.81), 0.01)  # shaken just now
    up = rotate(f.rotor, (0.0, 0.0, 1.0))
    assert f.heading_known
    # a tenth of a second of 22° with a time constant of seconds; a fresh start would take most
    assert math.degrees(math.acos(min(1.0, up[2]))) < 3.0


def test_the_adaptive_reference_lets_acceleration_into_the_attitude():
    # two seconds at 3 m/s² to the north, which tilts what the accelerometer takes for up by 17°
    samples, truth = recording("rest", 12.0)
    samples.accel[1000:] += (3.0, 0.0, 0.0)
    worst = {
        reference: errors_deg(
            KernelFilter(kalman(ekf, Noise(reference=reference))).run(samples), truth
        ).max()
        for reference in REFERENCES
    }
    # the dip that it was at the start, or that the gyroscope foretells, contradicts
    assert worst["fixed"] < 0.8 * worst["adaptive"]
    assert worst["recursive"] < 0.9 * worst["adaptive"]


sample = st.tuples(vectors(2e3), vectors(1e4), vectors(1.0), st.floats(0.0, 1.0))


@given(st.lists(sample, max_size=20), st.sampled_from([0.1, 1e3]))
@settings(max_examples=20)
@each
def test_no_covariance_runs_away(estimate, inputs, gyro_noise):
    f = KernelFilter(kalman(estimate, Noise(gyro=gyro_noise)))
    for gyro, accel, mag, dt in inputs:
        f.update_mag(mag)
        f.update_imu(gyro, accel, dt)
        p = np.array(f._state.covariance)
        assert 0.0 < np.trace(p) < 4.0
        assert np.linalg.eigvalsh(p).min() > -1e-9


@each
def test_tilt_is_right_however_unsure_the_heading(estimate):
    # as unsure in a minute as the default becomes in days
    samples, _ = recording("rest", 60.0)
    samples.mag[:] = np.nan
    f = KernelFilter(kalman(estimate, Noise(gyro=20.0)))
    worst = min(rotate(tuple(q), (0.0, 0.0, 1.0))[2] for q in f.run(samples))
    assert math.degrees(math.acos(min(1.0, worst))) < 0.1
    assert np.trace(f._state.covariance) < 4.0  # of a rotor, more cannot be unsure


@pytest.mark.parametrize(
    "wrong",
    [{"gyro": 0.0}, {"accel": -1.0}, {"mag": math.nan}, {"mag": math.inf}, {"reference": "none"}],
)
def test_noise_that_makes_no_filter_is_refused(wrong):
    with pytest.raises(UsageError, match="must be"):
        Noise(**wrong)


# The algebra


@given(st.lists(st.floats(-1.0, 1.0), min_size=16, max_size=16))
def test_cholesky_is_a_square_root(values):
    root = np.reshape(values, (4, 4))
    p = root @ root.T + 1e-6 * np.eye(4)
    columns = np.array(cholesky(tuple(map(tuple, p.tolist())))).T
    assert np.triu(columns, 1) == pytest.approx(0.0, abs=0.0)
    assert columns @ columns.T == pytest.approx(p, abs=1e-12)


def test_cholesky_of_what_rounding_made_negative_is_still_real():
    flat = ((1.0, 0.0, 0.0, 0.0), (0.0, -1e-20, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), (0.0,) * 4)
    assert np.isfinite(cholesky(flat)).all()


@given(st.integers(0, 2**32 - 1))
def test_elimination_is_what_solving_gives(seed):
    random = np.random.default_rng(seed)
    for n, kernel in ((6, explained), (4, explained4)):
        root = random.normal(size=(n, n))
        s = root @ root.T + 0.1 * np.eye(n)
        c, z = random.normal(size=(n, 4)), random.normal(size=n)
        if n == 6:
            rows = np.hstack([np.triu(s), c, z[:, None]])  # the lower triangle is not read
            m, v = kernel(tuple(map(tuple, rows.tolist())))
        else:
            m, v = kernel(*(tuple(map(tuple, a.tolist())) for a in (s, c)), tuple(z.tolist()))
        # 1e-8: the condition of S
        assert np.array(m) == pytest.approx(c.T @ np.linalg.solve(s, c), rel=1e-8, abs=1e-8)
        assert v == pytest.approx(c.T @ np.linalg.solve(s, z), rel=1e-8, abs=1e-8)


@given(rotors())
def test_the_step_size_is_a_number_where_the_printed_form_is_not(q):
    up, field = felt(q)
    up, field = direction(up), direction(field)
    assert step_size(up, field, math.cos(math.radians(60)), -math.sin(math.radians(60))) == (
        pytest.approx(0.16, abs=1e-9)  # g (1 − g)
    )


def test_the_user_chooses_the_sensors():
    f = KernelFilter(kalman(kckf), Settings(use_mag=False, north_at_start=(0.0, 1.0, 0.0)))
    f.update_mag((1.0, 0.0, 0.0))
    f.update_imu((0.0, 0.0, 0.0), (0.0, 0.0, 9.81), 0.0)
    assert rotate(f.rotor, (0.0, 1.0, 0.0)) == pytest.approx((1.0, 0.0, 0.0), abs=1e-12)
    assert not f.heading_known
