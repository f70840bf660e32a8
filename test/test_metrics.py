"""BROAD's metric, and the reference at other stamps than its own."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import axes, rotors

from stateful_ahrs import rotor
from stateful_ahrs.evaluation.metrics import (
    LONGEST_GAP,
    Truth,
    errors,
    passes,
    rmse_deg,
    sign_flips,
    slerp,
    truth_at,
)

ROUNDING = 1e-12  # rad, of products of unit rotors
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
MS = 1_000_000  # ns


def error(estimate, reference):
    """The three angles of one pair of rotors, rad."""
    return tuple(float(part[0]) for part in errors(np.array([estimate]), np.array([reference])))


def turned(axis, degrees):
    return rotor.from_axis_angle(axis, math.radians(degrees))


@given(rotors(), st.floats(0.0, math.pi))
def test_a_turn_about_the_vertical_is_all_heading(q, angle):
    found = error(rotor.product(rotor.from_axis_angle(Z, angle), q), q)
    assert found == pytest.approx((angle, angle, 0.0), abs=ROUNDING)


@given(rotors(), st.floats(0.0, math.pi - 0.01), st.floats(0.0, 2.0 * math.pi))
def test_a_turn_about_a_level_axis_is_all_inclination(q, angle, azimuth):
    axis = (math.cos(azimuth), math.sin(azimuth), 0.0)
    found = error(rotor.product(rotor.from_axis_angle(axis, angle), q), q)
    assert found == pytest.approx((angle, 0.0, angle), abs=ROUNDING / 0.01)


def test_heading_and_inclination_of_a_turn_about_a_slanting_axis():
    # 60° about (1, 0, 1)/√2: w = √3/2, x = z = ½/√2.
    found = error(turned((math.sqrt(0.5), 0.0, math.sqrt(0.5)), 60.0), rotor.IDENTITY)
    by_hand = (60.0, 2 * math.atan(0.5 / math.sqrt(1.5)), 2 * math.acos(math.sqrt(7 / 8)))
    assert found == pytest.approx((math.radians(60.0), *by_hand[1:]), abs=ROUNDING)


@given(rotors(), rotors())
def test_the_signs_of_rotors_do_not_matter(p, q):
    assert error(rotor.negative(p), q) == error(p, rotor.negative(q)) == error(p, q)


@given(rotors(), rotors())
def test_total_is_the_angle_between_the_attitudes(p, q):
    assert error(p, q)[0] == pytest.approx(rotor.difference(p, q), abs=ROUNDING)


@given(rotors(), axes(), st.floats(1e-9, 1e-3))
def test_small_errors_keep_their_digits(q, axis, angle):
    # arccos would return 0 or 2e-8 here.
    small = (1.0, *(0.5 * angle * part for part in axis))
    assert error(rotor.product(small, q), q)[0] == pytest.approx(angle, rel=1e-6, abs=1e-15)


@given(rotors(), rotors(), st.floats(0.1, 10.0))
def test_the_length_of_rotors_does_not_matter(p, q, length):
    longer = tuple(length * part for part in p)
    assert error(longer, q) == pytest.approx(error(p, q), abs=1e-9)


def test_rmse_takes_only_the_rows_that_count():
    estimate = np.array([turned(Z, 30.0), turned(Z, 40.0), turned(Z, 90.0), rotor.IDENTITY])
    reference = np.tile(rotor.IDENTITY, (4, 1))
    reference[3] = np.nan
    truth = Truth(reference, np.array([True, True, False, False]))
    root_mean_square = math.sqrt((30.0**2 + 40.0**2) / 2.0)
    expected = (root_mean_square, root_mean_square, 0.0)
    assert rmse_deg(estimate, truth) == pytest.approx(expected, abs=1e-9)


def test_nothing_is_aligned_trial_by_trial():
    estimate = np.tile(turned(Z, 20.0), (5, 1))
    truth = Truth(np.tile(rotor.IDENTITY, (5, 1)), np.ones(5, bool))
    assert rmse_deg(estimate, truth).heading == pytest.approx(20.0)


def test_sign_flips_are_steps_into_the_other_hemisphere():
    q = turned((0.6, 0.0, 0.8), 100.0)
    rows = np.array([q, q, rotor.negative(q), rotor.negative(q), q])
    assert sign_flips(rows) == 2
    assert sign_flips(rows[:2]) == sign_flips(rows[:1]) == sign_flips(rows[:0]) == 0


def test_a_turn_through_many_whole_turns_has_no_sign_flip():
    half = 0.5 * np.linspace(0.0, 20.0 * math.pi, 500)
    rows = np.stack([np.cos(half), np.sin(half), 0 * half, 0 * half], axis=1)
    assert sign_flips(rows) == 0


@given(rotors(), axes(), st.floats(0.0, 3.0), st.floats(0.0, 1.0), st.sampled_from([1.0, -1.0]))
def test_slerp_turns_at_a_constant_rate_the_shorter_way(q, axis, angle, part, sign):
    end = rotor.product(rotor.from_axis_angle(axis, angle), q)
    there = rotor.product(rotor.from_axis_angle(axis, part * angle), q)
    found = slerp(np.array([q]), sign * np.array([end]), np.array([part]))[0]
    assert np.linalg.norm(found) == pytest.approx(1.0, abs=ROUNDING)
    assert rotor.difference(tuple(found), there) < 1e-9


STAMPS = np.array([100, 110, 120, 130]) * MS
ROTORS = np.array([turned(Y, degrees) for degrees in (0.0, 10.0, 30.0, 70.0)])


def test_a_reference_is_taken_as_it_is_where_stamps_coincide():
    movement = np.array([True, False, True, True])
    truth = truth_at(STAMPS[1:3], STAMPS, ROTORS, movement)
    assert np.abs(truth.rotors - ROTORS[1:3]).max() <= 2e-16  # no more than normalising costs
    assert truth.counts.tolist() == [False, True]


def test_a_reference_is_interpolated_between_its_stamps():
    truth = truth_at(np.array([105, 125]) * MS, STAMPS, ROTORS * [[1], [-1], [1], [-1]])
    for found, degrees in zip(truth.rotors, (5.0, 50.0), strict=True):
        assert rotor.difference(tuple(found), turned(Y, degrees)) < ROUNDING
    assert truth.counts.all()


def test_a_stamp_between_two_rows_counts_only_if_both_do():
    movement = np.array([False, True, True, False])
    truth = truth_at(np.array([105, 115, 125]) * MS, STAMPS, ROTORS, movement)
    assert truth.counts.tolist() == [False, True, False]
    assert np.isfinite(truth.rotors).all()


def test_nothing_is_told_outside_the_reference():
    truth = truth_at(np.array([99, 131]) * MS, STAMPS, ROTORS)
    assert np.isnan(truth.rotors).all()
    assert not truth.counts.any()


@pytest.mark.parametrize(("gap", "told"), [(LONGEST_GAP, True), (LONGEST_GAP + 2, False)])
def test_a_gap_is_bridged_up_to_the_longest(gap, told):
    truth = truth_at(np.array([MS + gap // 2]), np.array([MS, MS + gap]), ROTORS[:2])
    assert truth.counts.tolist() == [told]


@pytest.mark.parametrize("nothing", [np.nan, 0.0])
def test_an_unknown_rotor_is_never_interpolated(nothing):
    reference = ROTORS.copy()
    reference[1] = nothing
    at = np.array([100, 105, 110, 115, 120, 125]) * MS
    truth = truth_at(at, STAMPS, reference)
    assert truth.counts.tolist() == [True, False, False, False, True, True]


def test_one_partly_unknown_rotor_is_unknown():
    reference = ROTORS.copy()
    reference[2, 3] = np.nan
    assert truth_at(STAMPS, STAMPS, reference).counts.tolist() == [True, True, False, True]


def test_late_and_double_rows_of_a_reference_are_put_in_order():
    order = [0, 2, 1, 1, 3]
    truth = truth_at(np.array([105, 115]) * MS, STAMPS[order], ROTORS[order])
    for found, degrees in zip(truth.rotors, (5.0, 20.0), strict=True):
        assert rotor.difference(tuple(found), turned(Y, degrees)) < ROUNDING


def test_each_pass_of_a_loop_has_its_own_reference():
    stamps = np.array([100, 300, 500, 100, 300, 500]) * MS
    reference = np.array([turned(X, degrees) for degrees in (0, 10, 20, 90, 100, 110)])
    truth = truth_at(stamps, stamps, reference)
    assert passes(stamps).tolist() == [0, 0, 0, 1, 1, 1]
    assert np.allclose(truth.rotors, reference, atol=1e-15)
    assert truth.counts.all()


def test_a_late_sample_begins_no_pass():
    assert passes(np.array([100, 200, 150, 250]) * MS).tolist() == [0, 0, 0, 0]


def test_rotors_of_the_reference_become_unit():
    truth = truth_at(STAMPS, STAMPS, 3.0 * ROTORS)
    assert np.allclose(np.linalg.norm(truth.rotors, axis=1), 1.0, atol=1e-15)


def test_without_a_single_row_of_reference_nothing_counts():
    truth = truth_at(STAMPS, STAMPS[:0], ROTORS[:0])
    assert not truth.counts.any()
    assert truth.rotors.shape == (4, 4)
