"""The motions: exact derivatives, continuous, and what their names say."""

from __future__ import annotations

import math

import pytest

from stateful_ahrs.errors import UsageError
from stateful_ahrs.mpu9250.motion import MOTIONS, TURN, Motion, Turn, X, Y, Z, motion
from stateful_ahrs.rotor import IDENTITY, angle, conjugate, difference, dot, product, rotate

EVERY = sorted(MOTIONS)
TIMES = [0.01 * k for k in range(-10, 3500)]
MOVING = [name for name in EVERY if name != "rest"]


def measured_rate(moving: Motion, t: float, h: float = 1e-4) -> tuple[float, float, float]:
    """Rate in the sensor frame by central difference of the rotor: 2 q* dq/dt."""
    _, x, y, z = product(conjugate(moving.rotor(t - h)), moving.rotor(t + h))
    return (x / h, y / h, z / h)


@pytest.mark.parametrize("name", EVERY)
def test_rate_is_the_derivative_of_the_rotor(name: str) -> None:
    moving = MOTIONS[name]
    for t in TIMES:
        # the central difference errs by h² / 6 of the third derivative (< 100 rad/s³)
        assert moving.rate(t) == pytest.approx(measured_rate(moving, t), abs=1e-6)


def test_rate_is_the_derivative_where_three_turns_about_any_axes_overlap() -> None:
    tilted = (2.0 / 7.0, -3.0 / 7.0, 6.0 / 7.0)
    moving = Motion(Turn(X, 2.0, 0.0, 2.0), Turn(tilted, -4.0, 0.3, 1.5), Turn(Y, 1.0, 0.5, 3.0))
    for k in range(400):
        t = 0.01 * k
        assert moving.rate(t) == pytest.approx(measured_rate(moving, t), abs=1e-5)


@pytest.mark.parametrize("name", EVERY)
def test_the_rotor_is_unit_and_never_changes_sign(name: str) -> None:
    last = MOTIONS[name].rotor(TIMES[0])
    for t in TIMES:
        q = MOTIONS[name].rotor(t)
        assert dot(q, q) == pytest.approx(1.0, abs=1e-12)
        assert dot(q, last) > 0.99  # 10 ms at less than 360 °/s: 3.6°
        last = q


@pytest.mark.parametrize("name", EVERY)
def test_motions_begin_with_a_second_of_rest_level_and_facing_north(name: str) -> None:
    for t in (-0.01, 0.0, 0.5, 1.0):
        assert MOTIONS[name].rotor(t) == pytest.approx(IDENTITY, abs=1e-12)
        assert MOTIONS[name].rate(t) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize("name", MOVING)
def test_motions_move(name: str) -> None:
    attitudes = [MOTIONS[name].rotor(t) for t in TIMES]
    assert max(difference(q, IDENTITY) for q in attitudes) == pytest.approx(math.pi, abs=0.05)


def test_turns_is_one_turn_about_y_then_one_about_z_in_eight_seconds() -> None:
    turns = motion("turns")
    for t in TIMES:
        x, y, z = turns.rate(t)
        assert x == pytest.approx(0.0, abs=1e-12)
        assert y == pytest.approx(0.0, abs=1e-12) or 1.0 < t < 5.0
        assert z == pytest.approx(0.0, abs=1e-12) or 5.0 < t < 9.0
    assert turns.rotor(3.0) == pytest.approx(
        (0.0, 0.0, 1.0, 0.0), abs=1e-12
    )  # half-way: upside down
    assert turns.rotor(5.0) == pytest.approx((-1.0, 0.0, 0.0, 0.0), abs=1e-12)
    assert turns.rotor(7.0) == pytest.approx((0.0, 0.0, 0.0, -1.0), abs=1e-12)
    assert turns.rotor(9.0) == turns.rotor(1e4) == pytest.approx(IDENTITY, abs=1e-12)


def test_two_turns_go_round_once_in_attitude_space() -> None:
    two = motion("two_turns")
    assert angle(two.rotor(5.0)) == pytest.approx(TURN)  # one turn: the rotor is -1
    assert two.rotor(9.0) == pytest.approx(IDENTITY, abs=1e-12)
    assert sum(two.rate(t)[2] for t in TIMES) * 0.01 == pytest.approx(2.0 * TURN, abs=1e-6)


def test_tumble_wanders_in_axis_rests_and_begins_again() -> None:
    tumble = motion("tumble")
    axes = set()
    for t in TIMES:
        rate = tumble.rate(t)
        speed = math.hypot(*rate)
        assert speed < math.radians(250.0)  # within the finest range of the gyroscope
        if speed > 1.0:
            axes.add(tuple(round(3.0 * part / speed) for part in rate))
        if t % 10.0 >= 7.5:
            assert speed < 1e-9
        assert tumble.rotor(t + 10.0) == pytest.approx(tumble.rotor(t), abs=1e-9)
    assert len(axes) > 10


def test_sphere_shows_gravity_and_north_to_every_side_of_the_sensor() -> None:
    sphere = motion("sphere")
    sides = [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z]
    for field in (Z, (0.5, 0.0, -math.sqrt(0.75))):
        seen = [rotate(conjugate(sphere.rotor(t)), field) for t in TIMES]
        for side in sides:
            length = math.sqrt(sum(part * part for part in side))
            nearest = max(sum(a * b for a, b in zip(side, v, strict=True)) for v in seen) / length
            assert nearest > math.cos(math.radians(35.0))


def test_an_unknown_motion_is_refused_with_the_known_ones() -> None:
    with pytest.raises(UsageError, match="no motion 'dance'; known: rest, turns, two_turns"):
        motion("dance")
