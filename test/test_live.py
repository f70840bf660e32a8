"""The tally of a live stream."""

from __future__ import annotations

import math

import pytest

from stateful_ahrs.evaluation.live import WAITING, Tally
from stateful_ahrs.rotor import IDENTITY, from_axis_angle, negative

MS = 1_000_000  # ns
Z = (0.0, 0.0, 1.0)


def turned(degrees: float):
    return from_axis_angle(Z, math.radians(degrees))


def test_a_smooth_motion_has_no_flip_and_its_true_step_and_rate():
    tally = Tally()
    for i in range(721):  # two turns
        tally.add(5 * i * MS, turned(i))
    assert tally.samples == 721
    assert tally.sign_flips == 0
    assert math.degrees(tally.largest_step) == pytest.approx(1.0)
    assert tally.rate == pytest.approx(200.0)
    assert tally.turned == pytest.approx(4.0 * math.pi)


def test_a_change_of_sign_is_a_flip_but_no_step():
    tally = Tally()
    for i, rotor in enumerate((turned(1), negative(turned(1)), turned(1))):
        tally.add(i, rotor)
    assert tally.sign_flips == 2
    assert tally.largest_step == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize("truth_first", [False, True])
def test_the_error_is_that_at_the_last_common_stamp_whichever_came_first(truth_first: bool):
    tally = Tally()
    tally.add(0, IDENTITY)
    for stamp in (1, 2):
        arrivals = [
            lambda stamp=stamp: tally.add(stamp, turned(10 * stamp)),
            lambda stamp=stamp: tally.add_truth(stamp, negative(turned(10 * stamp + 3 * stamp))),
        ]
        for arrive in reversed(arrivals) if truth_first else arrivals:
            arrive()
    tally.add(3, turned(90))
    assert math.degrees(tally.error) == pytest.approx(6.0)


def test_lost_are_truths_between_the_first_and_the_last_orientation_that_have_none():
    tally = Tally()
    tally.add_truth(0, IDENTITY)  # before anybody was there
    for stamp in (1, 2, 4, 7):
        tally.add(stamp, IDENTITY)
    for stamp in range(1, 10):  # 3, 5 and 6; 8 and 9 may yet come
        tally.add_truth(stamp, IDENTITY)
    assert tally.lost == 3


def test_a_day_without_truth_does_not_fill_the_memory():
    tally = Tally()
    for stamp in range(WAITING + 10):
        tally.add(stamp, IDENTITY)
    tally.add_truth(5, turned(1))  # long forgotten
    assert tally.error is None
    tally.add_truth(10, turned(1))
    assert math.degrees(tally.error) == pytest.approx(1.0)
