"""Rotor algebra, the stateful rotor, axis and angle."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import axes, rotors, vectors

from stateful_ahrs import rotor
from stateful_ahrs.rotor import IDENTITY, Turn, follow

ROUNDING = 1e-12
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@given(rotors(), rotors(), vectors())
def test_product_turns_by_the_right_factor_first(p, q, v):
    both = rotor.rotate(rotor.product(p, q), v)
    one_by_one = rotor.rotate(p, rotor.rotate(q, v))
    assert both == pytest.approx(one_by_one, abs=ROUNDING)


@given(rotors(), vectors())
def test_conjugate_turns_back(q, v):
    there_and_back = rotor.rotate(rotor.conjugate(q), rotor.rotate(q, v))
    assert there_and_back == pytest.approx(v, abs=ROUNDING)


@given(rotors(), vectors())
def test_both_signs_of_a_rotor_are_one_attitude(q, v):
    opposite = rotor.rotate(rotor.negative(q), v)
    assert opposite == pytest.approx(rotor.rotate(q, v), abs=ROUNDING)


def test_a_quarter_turn_about_z_takes_x_to_y():
    q = rotor.from_axis_angle(Z, math.pi / 2)
    assert rotor.rotate(q, X) == pytest.approx(Y, abs=ROUNDING)


@given(rotors(), rotors())
def test_follow_never_leaves_the_hemisphere_of_the_state(q, state):
    assert rotor.dot(follow(q, state), state) >= 0.0


@given(rotors(), rotors())
def test_follow_changes_nothing_but_the_sign(q, state):
    assert follow(q, state) in (q, rotor.negative(q))


@given(axes(), st.floats(0.0, 2.0 * math.pi))
def test_angle_and_axis_undo_eq_1(n, theta):
    q = rotor.from_axis_angle(n, theta)
    assert rotor.angle(q) == pytest.approx(theta, abs=1e-9)
    if 1e-3 < theta < 2.0 * math.pi - 1e-3:  # nearer to a whole turn the axis loses digits
        assert rotor.axis(q) == pytest.approx(n, abs=1e-9)


def test_axis_of_a_whole_turn_is_the_last_one():
    assert rotor.axis(IDENTITY, Y) == Y


def test_fast_angle_is_within_the_bound_of_eq_19_over_the_whole_range():
    worst = 0.0
    for w in np.linspace(-1.0, 1.0, 20_001):
        q = (float(w), math.sqrt(max(0.0, 1.0 - w * w)), 0.0, 0.0)
        worst = max(worst, abs(rotor.fast_angle(q) - 2.0 * math.acos(w)))
    assert math.degrees(worst) == pytest.approx(0.492, abs=0.001)  # the paper: below 0.5


@given(axes(), st.floats(0.0, 0.19))
def test_rate_gives_the_rotor_of_eq_11_to_second_order(n, turn):
    rate = tuple(turn * x for x in n)
    exact = rotor.from_axis_angle(n, turn)
    # what eq. 12 leaves out: the third order of the half angle in v, the fourth in w
    assert rotor.from_rate(rate, 1.0) == pytest.approx(exact, abs=(turn / 2) ** 3 / 6 + ROUNDING)


def test_a_small_turn_is_eq_12_to_the_last_bit():
    assert rotor.from_rate((0.1, 0.0, 0.0), 1.0) == (1.0 - 0.05**2 / 2, 0.05, 0.0, 0.0)


@given(axes(), st.floats(0.21, 30.0))
def test_a_turn_across_a_gap_is_exact(n, turn):
    rate = tuple(turn * x for x in n)
    assert rotor.from_rate(rate, 1.0) == pytest.approx(rotor.from_axis_angle(n, turn), abs=1e-9)


@pytest.mark.parametrize(
    ("axis", "angle", "euler"),
    [
        (X, 0.3, (0.3, 0.0, 0.0)),
        (Y, 0.3, (0.0, 0.3, 0.0)),
        (Z, 3.0, (0.0, 0.0, 3.0)),
        (Y, math.pi / 2, (0.0, math.pi / 2, 0.0)),
    ],
)
def test_euler_angles_of_turns_about_one_axis(axis, angle, euler):
    # 1e-7: the arcsine of the pitch has no more digits near its end
    assert rotor.euler(rotor.from_axis_angle(axis, angle)) == pytest.approx(euler, abs=1e-7)


@given(rotors(), axes(), st.floats(0.0, math.pi))
def test_difference_is_the_angle_between_attitudes_whatever_the_sign(q, n, theta):
    p = rotor.negative(rotor.product(rotor.from_axis_angle(n, theta), q))
    assert rotor.difference(p, q) == pytest.approx(theta, abs=1e-7)


# Axis and angle over many turns


def turned(*legs, start=IDENTITY, rate=100, noise=0.0, seed=0):
    """Rotors of successive turns (axis, angle) at 90 °/s, each leg about one sensor axis."""
    random = np.random.default_rng(seed)
    q, last = start, start
    for axis, angle in legs:
        count = max(1, round(abs(angle) / (math.pi / 2) * rate))
        for i in range(1, count + 1):
            noisy = rotor.product(q, rotor.from_axis_angle(axis, angle * i / count))
            wobble = random.normal(0.0, noise, 3)
            noisy = rotor.product(noisy, rotor.from_rate(tuple(wobble), 1.0))
            last = follow(rotor.unit(noisy), last)
            yield last
        q = rotor.product(q, rotor.from_axis_angle(axis, angle))


def counted(path):
    """The angle after each rotor of the path, and the final axis."""
    turn = Turn()
    return np.array([turn.update(q) for q in path]), turn.axis


TURN = 2.0 * math.pi


@pytest.mark.parametrize("noise", [0.0, 0.002, 0.01])
@pytest.mark.parametrize("rate", [50, 1000])
@pytest.mark.parametrize("axis", [Z, (0.0, -1.0, 0.0), (0.6, 0.0, 0.8)])
def test_two_turns_are_4_pi(axis, rate, noise):
    angles, last_axis = counted(turned((axis, 2 * TURN), rate=rate, noise=noise))
    assert angles[-1] == pytest.approx(2 * TURN, abs=5 * noise + 1e-9)
    assert last_axis == pytest.approx(axis, abs=0.1)  # 0.1: of noise, near a whole turn


def test_turns_back_are_subtracted():
    angles, _ = counted(turned((Z, 2.5 * TURN), (Z, -2 * TURN)))
    assert angles.max() == pytest.approx(2.5 * TURN)
    assert angles[-1] == pytest.approx(0.5 * TURN)


def test_ten_turns_and_a_half_are_counted():
    angles, _ = counted(turned((Z, 10.5 * TURN)))
    assert angles[-1] == pytest.approx(10.5 * TURN)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("noise", [0.0, 0.002])
@pytest.mark.parametrize("second", [TURN, -TURN])
def test_a_turn_about_y_and_one_about_z_are_4_pi(second, noise, seed):
    angles, axis = counted(turned((Y, TURN), (Z, second), noise=noise, seed=seed))
    assert angles[-1] == pytest.approx(2 * TURN, abs=0.02)
    assert axis == pytest.approx((0.0, 0.0, math.copysign(1.0, second)), abs=0.1)


@pytest.mark.parametrize("miss", [2.0, 5.0, 8.0])
def test_a_pass_beside_the_whole_turn_counts(miss):
    start = rotor.from_axis_angle(X, math.radians(miss))
    angles, _ = counted(turned((Z, 2 * TURN), start=start))
    assert angles[-1] == pytest.approx(2 * TURN, abs=math.radians(miss))


def test_the_angle_runs_without_a_jump():
    angles, _ = counted(turned((Z, 2 * TURN), (Y, 1.5 * TURN), (Z, -TURN), rate=1000))
    # 0.09° of motion a sample; where the axis changes at a whole turn the angle catches up
    assert np.degrees(np.abs(np.diff(angles))).max() < 3.0


@pytest.mark.parametrize("turns", [2.0, 10.5])
def test_coarse_updates_keep_the_count(turns):
    turn = Turn()
    for q in turned((Z, turns * TURN)):
        turn.update(q, coarse=True)
    assert turn.angle == pytest.approx(turns * TURN, abs=math.radians(6.1))
