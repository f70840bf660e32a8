"""The blend as a turn of the predicted rotor, against the snapshot and eq. 16."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from strategies import rotors
from test_stateful import errors_deg, recording

from stateful_ahrs import filters
from stateful_ahrs.filters.correction import turned_north, uprighted
from stateful_ahrs.filters.settings import Settings
from stateful_ahrs.rotor import IDENTITY, difference, from_axis_angle, rotate, slightly, unit

ANGLES = st.floats(0.0, math.pi)
PARTS = st.floats(0.0, 1.0)


@given(ANGLES, st.floats(-math.pi, math.pi), st.floats(0.1, 300.0), PARTS)
def test_up_is_turned_to_the_vertical_by_the_shortest_way(tilt, azimuth, length, part):
    level, vertical = length * math.sin(tilt), length * math.cos(tilt)
    up = (level * math.cos(azimuth), level * math.sin(azimuth), vertical)
    w, x, y, z = uprighted(up, part)
    axis = (math.sin(azimuth), -math.cos(azimuth), 0.0)
    if tilt > math.pi - 0.05:  # there any axis does
        axis, tilt = (1.0, 0.0, 0.0), math.pi
    whole = from_axis_angle(axis, tilt)
    meant = [1.0 - part + part * whole[0], *(part * each for each in whole[1:])]
    assert (w, x, y, z) == pytest.approx(meant, abs=2e-7)


def test_the_series_meets_what_is_exact():
    edge = math.atan(0.1)
    near, far = (
        uprighted((math.sin(a), 0.0, math.cos(a)), 1.0) for a in (edge - 1e-9, edge + 1e-9)
    )
    assert near == pytest.approx(far, abs=1e-7)


def test_what_is_too_weak_for_gravity_turns_nothing():
    assert uprighted((0.01, 0.02, 0.03), 1.0) == IDENTITY
    assert uprighted((0.0, 0.0, -0.01), 0.5) == IDENTITY


@given(st.floats(-math.pi, math.pi), ANGLES, st.floats(-math.pi, math.pi))
def test_the_whole_turn_to_north_is_the_measured_one(heading, tilt, azimuth):
    change = from_axis_angle((math.cos(azimuth), math.sin(azimuth), 0.0), tilt)
    turned = turned_north(change, math.cos(heading), math.sin(heading), 1.0)
    about = from_axis_angle((0.0, 0.0, 1.0), -heading)
    north = rotate(about, (math.cos(heading), math.sin(heading), 0.0))
    assert north == pytest.approx((1.0, 0.0, 0.0), abs=1e-9)
    x, y, z = rotate(unit(turned), (0.3, -0.5, 0.2))
    assert (x, y, z) == pytest.approx(rotate(about, rotate(change, (0.3, -0.5, 0.2))), abs=1e-9)


@given(st.floats(-0.2, 0.2), st.floats(0.0, 0.1))
def test_a_part_of_the_turn_to_north_is_that_part_of_the_angle(heading, part):
    turned = turned_north(IDENTITY, math.cos(heading), math.sin(heading), part)
    assert 2.0 * math.atan2(turned[3], turned[0]) == pytest.approx(-part * heading, abs=2e-4)


@pytest.mark.parametrize("part", [0.0, 0.3, 0.5, 0.999, 1.0])
@pytest.mark.parametrize("heading", [math.pi, -math.pi, 3.1])
def test_an_opposite_north_makes_no_turn_of_no_length(part, heading):
    turned = turned_north(IDENTITY, math.cos(heading), math.sin(heading), part)
    assert sum(each * each for each in turned) > 0.998


@given(rotors(), st.floats(0.0, 0.1))
def test_a_slight_turn_is_a_turn(axis, angle):
    length = math.hypot(*axis[1:])
    assume(length > 1e-3)
    q = from_axis_angle(tuple(each / length for each in axis[1:]), angle)
    v = (3.0, -4.0, 12.0)
    assert slightly(q, v) == pytest.approx(rotate(q, v), abs=13.0 * 5e-5)


@pytest.mark.parametrize("name", ["tumble", "two_turns"])
def test_it_is_the_paper_s_blend(name):
    samples, truth = recording(name, 20.0)
    alone = {"learn_bias": False, "learn_misalignment": False, "learn_mag": False}
    same = Settings(alpha=0.98, low_pass=False, weigh_mag=False, average_start=False, **alone)
    turned = filters.make("stateful", same).run(samples)
    paper = filters.make("paper", Settings(alpha=0.98)).run(samples)
    apart = [
        math.degrees(difference(tuple(p), tuple(q))) for p, q in zip(turned, paper, strict=True)
    ]
    # the paper's is not normalised, and here a turn about a level axis leaves the heading alone
    assert np.sqrt(np.mean(np.square(apart))) < 0.1
    assert abs(errors_deg(turned, truth).mean() - errors_deg(paper, truth).mean()) < 0.05


# The filter that uses it, at rest: level, and turned about the vertical by ``heading``.


def at_rest(heading=0.0, mag=True, down=-40e-6):
    """Rate, force, field (NaN without a magnetometer)."""
    c, s = math.cos(heading), math.sin(heading)
    field = (20e-6 * c, -20e-6 * s, down) if mag else (math.nan,) * 3
    return (0.0, 0.0, 0.0), (0.0, 0.0, 9.81), field


def fed(f, samples, dt=0.01):
    for gyro, accel, mag in samples:
        if mag[0] == mag[0]:
            f.update_mag(mag)
        f.update_imu(gyro, accel, dt if f.started else 0.0)
    return 2.0 * math.atan2(f.rotor[3], f.rotor[0])


def unlearning(**changes):
    names = ("learn_bias", "learn_misalignment", "learn_mag", "weigh_mag", "average_start")
    return Settings(**{**dict.fromkeys(names, False), **changes})


@pytest.mark.parametrize("every", [2, 5, 10, 25])
def test_heading_goes_as_fast_with_a_slow_magnetometer(every):
    ends = []
    for each in (1, every):
        f = filters.make("stateful", unlearning(alpha_heading=0.99))
        fed(f, [at_rest()] * 2)  # one heading, and one that confirms it
        ends.append(fed(f, [at_rest(0.5, mag=k % each == 0) for k in range(1, 101)]))
    whole, part = ends
    assert 0.2 < whole < 0.4
    assert part == pytest.approx(whole, abs=0.03)


def test_the_start_is_a_mean_unless_alpha_is_faster():
    slow, fast = (
        filters.make("stateful", unlearning(alpha=a, average_start=True, low_pass=False))
        for a in (0.999, 0.5)
    )
    for f in (slow, fast):
        fed(f, [at_rest()] * 50)
    assert fed(slow, [at_rest(0.5)] * 40) < 0.3  # of 90 samples 40 say 0.5
    assert fed(fast, [at_rest(0.5)] * 10) == pytest.approx(0.5, abs=1e-3)


def test_where_alpha_is_one_nothing_is_corrected():
    f = filters.make("stateful", unlearning(alpha=1.0, alpha_heading=0.9))
    fed(f, [at_rest()])
    assert fed(f, [at_rest(0.5)] * 200) == 0.0


def test_without_a_weight_of_the_gyroscope_it_is_the_snapshot():
    sample = ((0.1, -0.2, 0.3), (2.0, -3.0, 8.0), (15e-6, 9e-6, -35e-6))
    found = []
    for name in ("stateful", "paper"):
        f = filters.make(name, unlearning(alpha=0.0, low_pass=False))
        fed(f, [at_rest(), sample])
        found.append(f.rotor)
    assert difference(*found) < 1e-6


def test_a_first_heading_is_taken_whole_and_the_next_field_believed():
    f = filters.make("stateful")
    fed(f, [at_rest(mag=False)] * 100)
    heading = fed(f, [at_rest(3.0, down=0.0)] * 2)
    assert math.cos(heading) == pytest.approx(math.cos(3.0), abs=1e-6)
    assert f.report.mag_rejected == 0


def test_signs_are_counted_as_the_paper_s_filter_counts_them():
    counts = []
    for name in ("stateful", "paper"):
        f = filters.make(name)
        samples, _ = recording("two_turns", 20.0)
        f.run(samples)
        counts.append(f.report.sign_corrections)
    assert counts[0] == counts[1] > 0


def test_a_live_switch_to_the_stateful_rotor_rejects_nothing_and_keeps_the_attitude():
    f = filters.make("stateful", Settings(stateful=False))
    turned = from_axis_angle((0.0, 1.0, 0.0), 0.4)
    _, _, mag = at_rest()
    back = tuple(-each for each in turned[1:])
    sample = ((0.0, 0.0, 0.0), *(rotate((turned[0], *back), v) for v in ((0.0, 0.0, 9.81), mag)))
    fed(f, [sample] * 300)
    f.settings = Settings()
    for _ in range(50):
        fed(f, [sample])
        assert difference(f.rotor, turned) < 1e-6
    assert f.report.mag_rejected == 0


@pytest.mark.parametrize("off", [{"stateful": False}, {"alpha": 1.0}])
def test_learning_that_is_switched_on_again_starts_from_what_is_seen(off):
    none = dict.fromkeys(("learn_bias", "learn_misalignment", "learn_mag", "weigh_mag"), False)
    f = filters.make("stateful")
    fed(f, [at_rest()] * 500)
    f.settings = Settings(**none, **off)
    gyro, accel, mag = at_rest(2.5)  # turned meanwhile, by more than the gyroscope says
    fed(f, [((0.0, 0.0, -1.0), accel, mag)] * 250)
    f.settings = Settings()
    heading = fed(f, [(gyro, accel, mag)] * 100)
    assert math.cos(heading - 2.5) == pytest.approx(1.0, abs=1e-4)
    assert f.stddev[1] > math.radians(5.0)


@pytest.mark.parametrize("force", [39.0, 157.0, 390.0])
@pytest.mark.parametrize("restart", [0, 300])
def test_a_bad_first_force_is_forgotten_at_once(force, restart):
    f = filters.make("stateful")
    fed(f, [at_rest()] * restart)
    gyro, _, mag = at_rest()
    f.update_mag(mag)
    f.update_imu(gyro, (force, 0.0, 0.0), 0.0)
    fed(f, [at_rest()] * 10)
    assert difference(f.rotor, IDENTITY) < 1e-3


def test_a_stateless_filter_takes_no_force_back_that_it_has_not_low_passed():
    ends = []
    for despike in (True, False):
        f = filters.make("stateful", Settings(stateful=False, despike=despike))
        fed(f, [at_rest()] * 100)
        gyro, _, mag = at_rest()
        fed(f, [(gyro, (60.0, 0.0, 9.81), mag), *[at_rest()] * 3])
        ends.append(f.rotor)
    assert ends[0] == ends[1]


@given(st.floats(-math.pi, math.pi), st.floats(0.0, 1.0))
@example(math.pi, 0.75)
@example(math.pi, 0.3)
def test_a_part_of_a_turn_to_north_is_between_the_rotors_of_none_and_all(heading, part):
    turned = turned_north(IDENTITY, math.cos(heading), math.sin(heading), part)
    half = 0.5 * abs(heading)
    wanted = math.atan2(part * math.sin(half), 1.0 - part * (1.0 - math.cos(half)))
    found = math.atan2(abs(turned[3]), turned[0])
    assert found == pytest.approx(wanted, rel=0.03, abs=1e-9)
