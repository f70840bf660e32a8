"""The complementary filters of the papers: as printed, over other snapshots, LERP and AQUA."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from simulated import nwu, simulated
from strategies import axes, rotors
from test_dcm import felt
from test_stateful import errors_deg, flips, recording

from stateful_ahrs import filters
from stateful_ahrs.filters import Settings
from stateful_ahrs.filters.aqua import gain_factor, levelling, northing, part_of
from stateful_ahrs.filters.lerp import tilt
from stateful_ahrs.recordings import samples as samples_of
from stateful_ahrs.rotor import (
    IDENTITY,
    blend,
    difference,
    dot,
    euler,
    from_axis_angle,
    product,
    rotate,
    unit,
)

SNAPSHOTS = ("saam", "fqa", "markley", "aqua")


# Kusaka and Tanaka, as printed and over other snapshots


def test_the_product_as_printed_is_right_for_one_axis_at_a_time():
    samples, truth = recording("turns")  # the paper's experiment
    assert errors_deg(filters.make("paper_printed").run(samples), truth).max() < 2.0


def test_the_product_as_printed_is_wrong_for_an_axis_that_moves():
    samples, truth = recording("tumble", 20.0)
    assert errors_deg(filters.make("paper").run(samples), truth).max() < 2.0
    assert errors_deg(filters.make("paper_printed").run(samples), truth).max() > 90.0


@pytest.mark.parametrize("name", SNAPSHOTS)
def test_the_filter_is_the_same_over_any_snapshot(name):
    samples = samples_of(simulated("tumble", 20.0))
    paper = filters.make("paper").run(samples)
    other = filters.make(f"paper_{name}").run(samples)
    # 0.01: tumbling crosses SAAM's singular surface, where a sample or two tell no heading
    limit = 0.01 if name == "saam" else 1e-9
    assert errors_deg(other, [tuple(q) for q in paper]).max() < limit
    assert flips(other) == 0


@pytest.mark.parametrize("name", ["fqa", "markley", "aqua"])
def test_no_snapshot_keeps_the_sign_for_a_stateless_filter(name):
    recorded = simulated("turns", 9.5)
    estimate = filters.make(f"paper_stateless_{name}").run(samples_of(recorded))
    assert errors_deg(estimate, nwu(recorded)).max() > 90.0


def test_saam_turns_its_sign_whenever_roll_does():
    # a swing of 1 rad about x: its rotor has x ≤ 0 on both sides
    samples, _ = recording("rest", 10.0)
    angles = np.sin(2.0 * math.pi * 0.2 * np.arange(len(samples)) / 100.0)
    samples.gyro[1:, 0] = np.diff(angles) * 100.0
    for i, angle in enumerate(angles):
        samples.accel[i], samples.mag[i] = felt(from_axis_angle((1.0, 0.0, 0.0), angle))
    corrections = {}
    for name in ("paper", "paper_saam"):
        f = filters.make(name)
        assert flips(f.run(samples)) == 0
        corrections[name] = f.report.sign_corrections
    assert corrections["paper"] == 0
    assert corrections["paper_saam"] >= 4


def test_where_saam_is_singular_heading_follows_the_gyroscope():
    samples, truth = recording("two_turns")  # level all the time
    f = filters.make("paper_saam")
    assert errors_deg(f.run(samples), truth).max() < 2.0
    assert f.started
    assert not f.report.heading_from_mag
    assert f.report.mag_rejected == len(samples)


def test_the_gyroscope_alone_starts_right_and_takes_nothing_more():
    samples, truth = recording("tumble", 10.0)
    samples.accel[1:], samples.mag[1:] = (0.0, 5.0, 5.0), (1.0, 1.0, 1.0)
    for settings in (Settings(), Settings(alpha=0.5)):
        estimate = filters.make("gyro", settings).run(samples)
        assert errors_deg(estimate, truth).max() < 0.1  # second order of eq. 12


# LERP


@given(rotors())
@example(IDENTITY)
@example((0.0, 1.0, 0.0, 0.0))
@example((math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0))
def test_tilt_is_roll_and_pitch_without_yaw(q):
    accel, _ = felt(q)
    level = tilt(accel)
    assert rotate(level, accel) == pytest.approx((0.0, 0.0, 9.81), abs=1e-9)
    _, pitch, yaw = euler(level)
    if abs(abs(pitch) - math.pi / 2) > 1e-3:
        assert yaw == pytest.approx(0.0, abs=1e-9)


def test_lerp_is_eq_8_to_11_with_the_yaw_of_the_magnetometer():
    # the report's α = 0.02 is a weight of 0.98 for the gyroscope, in each sample
    samples, truth = recording("tumble", 10.0)
    settings = Settings(alpha=0.98, alpha_rate=0.0)
    estimate = filters.make("lerp", settings).run(samples)
    assert errors_deg(estimate, truth).max() < 0.1
    one_step = np.array(
        unit(
            blend(
                product(tuple(estimate[0]), step_of(samples.gyro[1])),
                truth[1] if dot(truth[1], tuple(estimate[0])) > 0 else tuple(-x for x in truth[1]),
                0.98,
            )
        )
    )
    assert estimate[1] == pytest.approx(one_step, abs=1e-6)


def step_of(rate):
    x, y, z = (0.5 * 0.01 * value for value in rate)
    return (1.0, x, y, z)


def test_lerp_as_printed_drags_yaw_to_zero():
    samples, _ = recording("rest", 10.0)
    turned = from_axis_angle((0.0, 0.0, 1.0), 0.0)
    samples.gyro[:300] = (0.0, 0.0, 0.5)  # 1.5 rad in 3 s, then rest
    for i in range(1, len(samples)):
        if i < 300:
            turned = product(turned, from_axis_angle((0.0, 0.0, 1.0), 0.005))
        samples.accel[i], samples.mag[i] = felt(turned)
    yaw = {
        name: euler(tuple(filters.make(name, Settings(alpha=0.98)).run(samples)[-1]))[2]
        for name in ("lerp", "lerp_as_printed")
    }
    assert yaw["lerp"] == pytest.approx(1.495, abs=0.01)
    assert yaw["lerp_as_printed"] == pytest.approx(0.0, abs=0.01)


def test_lerp_as_printed_starts_at_the_identity_and_loses_the_sign():
    samples, truth = recording("two_turns", 7.0)
    estimate = filters.make("lerp_as_printed", Settings(alpha=1.0)).run(samples)
    assert errors_deg(estimate, truth).max() < 0.1  # the gyroscope alone, from the identity
    estimate = filters.make("lerp_as_printed", Settings(alpha=0.98)).run(samples)
    assert errors_deg(estimate, truth).max() > 90.0


# AQUA


@given(axes())
@example((0.0, 0.0, 1.0))
@example((0.0, 0.0, -1.0))
@example((1e-9, 0.0, -1.0))
def test_levelling_brings_any_direction_to_the_vertical(up):
    turn = levelling(up)
    assert rotate(turn, up) == pytest.approx((0.0, 0.0, 1.0), abs=1e-6)
    assert turn[0] >= 0.0
    assert turn[3] == 0.0  # and leaves heading alone


@given(axes())
@example((-1.0, 0.0, 0.0))
@example((-1.0, 1e-12, 0.5))
@example((1.0, 0.0, 0.0))
def test_northing_brings_any_field_to_north_about_the_vertical(field):
    turn = northing(field)
    x, y, z = rotate(turn, field)
    assert (y, z) == pytest.approx((0.0, field[2]), abs=1e-12)
    assert x >= -1e-12
    assert turn[0] >= 0.0


@given(axes(), st.floats(0.0, math.pi))
def test_a_part_of_a_turn_is_on_its_way(axis, angle):
    turn = from_axis_angle(axis, angle)
    assert part_of(turn, 0.0) == pytest.approx(IDENTITY, abs=1e-12)
    assert part_of(turn, 1.0) == pytest.approx(turn, abs=1e-12)
    half = part_of(turn, 0.5)
    assert product(half, half) == pytest.approx(turn, abs=1e-9)
    if turn[0] < 0.9:  # SLERP: even in angle, which LERP is not
        assert difference(part_of(turn, 0.1), IDENTITY) == pytest.approx(0.1 * angle, abs=1e-9)


def test_the_gain_falls_from_one_to_nothing_between_the_thresholds():
    assert gain_factor(0.0) == gain_factor(0.1) == 1.0
    assert gain_factor(0.15) == pytest.approx(0.5)
    assert gain_factor(0.2) == pytest.approx(0.0, abs=1e-12)
    assert gain_factor(0.9) == 0.0


def test_aqua_takes_no_tilt_from_an_accelerometer_that_is_shaken():
    samples, truth = recording("rest", 10.0)
    samples.accel[300:] += (6.0, 0.0, 0.0)  # 17 % above gravity, and 31° off
    worst = errors_deg(filters.make("aqua").run(samples), truth).max()
    whole = errors_deg(filters.make("lerp").run(samples), truth).max()
    # the gain factor there is 0.28
    assert worst < 0.6 * whole
    samples.accel[300:] += (2.0, 0.0, 0.0)  # more than 20 % above
    assert errors_deg(filters.make("aqua").run(samples), truth).max() < 0.1


def test_aqua_learns_the_bias_at_rest():
    samples, truth = recording("rest", 30.0)
    samples.gyro[:] += (0.02, -0.03, 0.01)
    f = filters.make("aqua", Settings(alpha=1.0))
    estimate = f.run(samples)
    assert f._state.bias == pytest.approx((0.02, -0.03, 0.01), abs=1e-6)
    # of a bias forgotten with a time constant of 1 s, that of 1 s is left in the attitude
    assert errors_deg(estimate, truth)[-1] == pytest.approx(math.degrees(0.0374), rel=0.05)


def test_the_bias_is_not_learned_in_motion():
    samples, _ = recording("turns", 5.0)
    f = filters.make("aqua")
    f.run(samples)
    assert np.abs(f._state.bias).max() < math.radians(1.0)  # of the slow start of each turn


def test_aqua_as_printed_is_the_gyroscope_alone():
    samples, _ = recording("two_turns", 7.0)
    tilted = samples.accel.copy()
    samples.accel[:] = (0.0, 6.0, 7.76)
    one = filters.make("aqua_as_printed").run(samples)
    samples.accel[:] = tilted
    other = filters.make("aqua_as_printed").run(samples)
    assert one == pytest.approx(other, abs=0.0)
    assert (one[:, 0] >= 0.0).all()  # its last line
    assert flips(one) > 0
