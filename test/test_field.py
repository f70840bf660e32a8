"""A magnetic field and its reference: what is held, what takes its place, what is told of both."""

from __future__ import annotations

import math

import numpy as np
import pytest
from test_learning import MICRO, WILD, errors_deg, inclination_deg, live, recording

from stateful_ahrs import filters
from stateful_ahrs.filters.field import LOST, TRIED, UNSEEN, compared
from stateful_ahrs.filters.samples import Samples
from stateful_ahrs.mpu9250.motion import MOTIONS
from stateful_ahrs.rotor import conjugate, from_axis_angle, product, rotate

WINDOW = 0.5  # s
SURE = math.radians(3.0) ** 2  # rad²
NORM, DIP = 50.0 * MICRO, -0.8


def seen(field, seconds, norm=NORM, dip=DIP, north=0.0, held=SURE, turned=0.5):
    """The field after ``seconds``, the last trust, and how often another took its place."""
    trust, swaps = 1.0, 0
    for _ in range(round(seconds / WINDOW)):
        field, trust, swapped = compared(field, norm, dip, north, held, turned, WINDOW, True)
        if swapped:
            swaps, north = swaps + 1, 0.0  # it is followed from now on
    return field, trust, swaps


def test_what_is_off_by_more_is_trusted_less_and_soon_hardly():
    field, _, _ = seen(UNSEEN, 60.0)
    assert seen(field, 10.0)[1] == pytest.approx(1.0)
    trusts = [seen(field, 10.0, norm=NORM * off)[1] for off in (1.02, 1.05, 1.1, 1.3, 2.0)]
    assert trusts == sorted(trusts, reverse=True)
    assert trusts[0] > 0.5
    assert trusts[2] < 0.03  # 4 σ
    assert trusts[-1] < 1e-5


def test_what_a_field_that_is_off_says_again_and_again_counts_once():
    field, _, _ = seen(UNSEEN, 60.0)
    at_first = seen(field, 4.0, norm=1.2 * NORM, north=0.8)[1]
    later = seen(field, 60.0, norm=1.2 * NORM, north=0.8)[1]
    assert later < 0.02 * at_first


@pytest.mark.parametrize("seconds", [4.0, 30.0])
def test_trust_falls_without_a_step(seconds):
    field, _, _ = seen(UNSEEN, 60.0)
    whole = trusts(field, seconds, 1.0, 1.3, 0.01)
    assert (np.diff(whole) < 0.0).all()
    assert whole[0] > 0.99
    assert whole[-1] < 1e-3
    # Where it is steepest, ten times shorter steps fall by about ten times less.
    coarse, fine = (np.diff(np.log(trusts(field, seconds, 1.07, 1.16, s))) for s in (1e-3, 1e-4))
    assert fine.min() > 0.2 * coarse.min()


def trusts(field, seconds, first, last, step):
    """Of fields so much stronger than the reference, after as many seconds each."""
    return [seen(field, seconds, norm=NORM * off)[1] for off in np.arange(first, last, step)]


def test_a_reference_that_was_tried_is_held_for_ten_minutes_where_heading_is_known():
    field, _, _ = seen(UNSEEN, 60.0)
    assert field.looks > TRIED
    other, trust, swaps = seen(field, 600.0, norm=2.0 * NORM, north=1.4)
    assert swaps == 0
    assert trust < 1e-5
    assert other.norm_reference == pytest.approx(NORM, rel=1e-3)
    back, trust, swaps = seen(other, 30.0)
    assert (swaps, trust) == (0, pytest.approx(1.0, abs=0.01))
    assert back.rival == 0.0


@pytest.mark.parametrize(
    ("north", "held"), [(1.4, (1.1 * LOST) ** 2), (0.0, SURE)], ids=["heading is lost", "it agrees"]
)
def test_it_is_left_where_nobody_knows_better_or_it_makes_no_difference(north, held):
    field, _, _ = seen(UNSEEN, 60.0)
    assert seen(field, 60.0, norm=2.0 * NORM, north=north, held=held)[2] == 1
    assert seen(field, 60.0, norm=2.0 * NORM, north=1.4, held=SURE)[2] == 0


def test_a_reference_hardly_tried_gives_way_but_where_nothing_turns():
    field, _, _ = seen(UNSEEN, 60.0, turned=0.0)
    assert seen(field, 120.0, norm=2.0 * NORM, north=1.4, turned=0.0)[2] == 0
    assert seen(field, 10.0, norm=2.0 * NORM, north=1.4)[2] == 1


def test_the_deviation_holds_both_until_one_has_outlived_the_other():
    first, _, _ = seen(UNSEEN, 3.0)
    first, _, swaps = seen(first, 2.5, norm=2.0 * NORM, north=1.4)
    assert swaps == 0
    before = math.sqrt(first.rival)
    assert 0.3 < before < 1.4
    field, _, swaps = seen(first, 1.0, norm=2.0 * NORM, north=1.4)
    assert swaps == 1
    after = math.sqrt(field.rival)
    assert before < after < 1.4
    later = [math.sqrt(seen(field, s, norm=2.0 * NORM)[0].rival) for s in (10.0, 40.0, 150.0)]
    assert after > later[0] > later[1] > later[2]
    assert later[2] < math.radians(1.0)


def test_a_field_adopted_late_is_no_surer_of_itself_at_first():
    field, _, _ = seen(UNSEEN, 60.0)
    field, _, swaps = seen(field, 600.0, norm=2.0 * NORM, north=1.4)
    assert swaps == 0
    at_once, _, swaps = seen(field, WINDOW, norm=2.0 * NORM, north=1.4, held=(1.1 * LOST) ** 2)
    assert swaps == 1
    after, _, _ = seen(at_once, WINDOW, norm=2.0 * NORM)
    assert after.rival == pytest.approx(at_once.rival, rel=0.1)
    assert math.sqrt(after.rival) > 0.9


def otherwise(samples, truth, after, turn_deg, times):
    """The same, its field turned about the vertical and so many times as strong ``after`` s."""
    turn = from_axis_angle((0.0, 0.0, 1.0), math.radians(turn_deg))
    at = int(after * 100)
    for i, q in enumerate(truth[at:], at):
        there = product(conjugate(q), product(turn, q))  # in the sensor frame
        samples.mag[i] = times * np.array(rotate(there, tuple(samples.mag[i].tolist())))
    return samples


@pytest.mark.parametrize("turning", [True, False], ids=["in motion", "at rest"])
@pytest.mark.parametrize(
    ("turn_deg", "times"), [(80.0, 2.0), (30.0, 1.3), (-120.0, 0.7), (180.0, 2.0)]
)
def test_a_field_rejected_for_two_minutes_moves_no_heading_and_is_told(turning, turn_deg, times):
    samples, truth = recording(180.0, motion=WILD if turning else MOTIONS["rest"])
    otherwise(samples, truth, 60.0, turn_deg, times)
    f = filters.make("stateful")
    told = []
    errors = errors_deg(live(samples, f, lambda: told.append(f.stddev)), truth)
    tilt, heading = np.degrees(told).T
    # At rest a minute is seconds of motion: the first field is not yet much more than the second.
    assert errors[6000:].max() < abs(turn_deg) * (0.05 if turning else 0.07)
    assert f.report.field_changes == 0
    assert f.report.mag_trust < 0.01
    assert not f.report.heading_from_mag
    assert np.linalg.norm(f.report.hard_iron) < 1.0 * MICRO  # nothing is learned from it
    assert (errors[6000:] < 3.0 * heading[6000:]).all()
    assert heading[-1] > 2.0 * heading[5999]
    assert tilt[6000:].max() < 1.1 * tilt[5999] + 0.1


def test_a_field_off_by_little_drags_little_and_is_told():
    samples, truth = recording(180.0)
    otherwise(samples, truth, 60.0, 45.0, 1.15)
    f = filters.make("stateful")
    told = []
    errors = errors_deg(live(samples, f, lambda: told.append(f.stddev[1])), truth)
    assert errors[6000:].max() < 4.0
    assert (errors[6000:] < 3.0 * np.degrees(told[6000:])).all()


@pytest.mark.parametrize("times", [0.7, 1.3, 2.0, 4.0])
def test_after_it_north_is_found_again_at_once_and_iron_within_seconds(times):
    samples, truth = recording(140.0)
    clean = samples.mag.copy()
    otherwise(samples, truth, 60.03, 80.0, times)
    samples.mag[9011:] = clean[9011:]
    f = filters.make("stateful")
    iron = []
    errors = errors_deg(live(samples, f, lambda: iron.append(f.report.hard_iron)), truth)
    assert errors[6000:].max() < 3.0
    wrong = np.linalg.norm(iron, axis=1) / MICRO
    assert wrong.max() < 10.0  # of 45 µT: the window of the change has both fields in it
    assert wrong[12000:].max() < 0.5
    assert f.report.mag_trust > 0.9
    assert math.degrees(f.stddev[1]) < 4.0


@pytest.mark.parametrize("turn_deg", [20.0, 45.0, 90.0])
def test_a_field_turned_alone_moves_no_tilt(turn_deg):
    samples, truth = recording(110.0)
    otherwise(samples, truth, 60.0, turn_deg, 1.0)
    rotors = filters.make("stateful").run(samples)
    assert inclination_deg(rotors, truth)[6000:].max() < 0.5


def test_at_rest_the_deviation_falls_once_the_right_field_is_back():
    samples, truth = recording(160.0, motion=MOTIONS["rest"])
    clean = samples.mag.copy()
    otherwise(samples, truth, 60.0, 80.0, 2.0)
    samples.mag[12000:] = clean[12000:]
    f = filters.make("stateful")
    told = []
    live(samples, f, lambda: told.append(math.degrees(f.stddev[1])))
    assert told[11900] > 15.0
    assert max(told[12500:]) < 4.0


def test_a_new_start_in_another_field_unlearns_no_iron():
    iron = np.array((8.0, -5.0, 6.0)) * MICRO
    samples, _ = recording(90.0, iron=tuple(iron))
    samples.mag[6000:] = 1.3 * (samples.mag[6000:] - iron) + iron
    f = filters.make("stateful")
    found = []
    for rows in (slice(6000), slice(6000, None)):  # each with a step of 0
        part = Samples(*(each[rows] for each in vars(samples).values()))
        live(part, f, lambda: found.append(f.report.hard_iron))
    wrong = np.linalg.norm(np.array(found) - iron, axis=1) / MICRO
    assert wrong[5999] < 1.0
    assert wrong[6000:].max() < 1.3
