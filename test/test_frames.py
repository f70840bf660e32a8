"""World frames, declination, and the sign of what is published."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import rotors

from stateful_ahrs.errors import UsageError
from stateful_ahrs.filters.frames import WORLD_FRAMES, WorldFrame
from stateful_ahrs.rotor import dot, euler, from_axis_angle, negative, product, rotate

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
NORTH, EAST, UP = "north", "east", "up"
DIRECTIONS = {  # of north, east and up in each world frame
    "enu": {NORTH: Y, EAST: X, UP: Z},
    "nwu": {NORTH: X, EAST: (0.0, -1.0, 0.0), UP: Z},
    "ned": {NORTH: X, EAST: Y, UP: (0.0, 0.0, -1.0)},
}
ATTITUDES = {  # the filter's rotor (NWU), and where the sensor's x axis and z axis then point
    "level, facing north": ((1.0, 0.0, 0.0, 0.0), (NORTH, 1), (UP, 1)),
    "level, facing east": (from_axis_angle(Z, -math.pi / 2), (EAST, 1), (UP, 1)),
    "level, facing south": (from_axis_angle(Z, math.pi), (NORTH, -1), (UP, 1)),
    "level, facing west": (from_axis_angle(Z, math.pi / 2), (EAST, -1), (UP, 1)),
    "nose up": (from_axis_angle(Y, -math.pi / 2), (UP, 1), (NORTH, -1)),
    "nose down": (from_axis_angle(Y, math.pi / 2), (UP, -1), (NORTH, 1)),
    "on the right side": (from_axis_angle(X, math.pi / 2), (NORTH, 1), (EAST, 1)),
    "upside down": (from_axis_angle(X, math.pi), (NORTH, 1), (UP, -1)),
}


@pytest.mark.parametrize("frame", WORLD_FRAMES)
@pytest.mark.parametrize("name", ATTITUDES)
def test_named_attitudes_point_where_they_should(name, frame):
    q, x_axis, z_axis = ATTITUDES[name]
    published = WorldFrame(frame).update(q)
    for sensor_axis, (direction, sign) in ((X, x_axis), (Z, z_axis)):
        expected = tuple(sign * part for part in DIRECTIONS[frame][direction])
        assert rotate(published, sensor_axis) == pytest.approx(expected, abs=1e-12)


def test_yaw_is_zero_facing_east_in_enu():
    facing_east = from_axis_angle(Z, -math.pi / 2)
    assert euler(WorldFrame("enu").update(facing_east)) == pytest.approx((0, 0, 0), abs=1e-12)


@pytest.mark.parametrize(("frame", "sign"), [("enu", -1.0), ("nwu", -1.0), ("ned", 1.0)])
def test_east_declination_turns_the_heading_east(frame, sign):
    with_it = WorldFrame(frame, 0.1).update((1.0, 0.0, 0.0, 0.0))
    without = WorldFrame(frame).update((1.0, 0.0, 0.0, 0.0))
    # clockwise from above: negative yaw where up is z, positive where down is
    assert euler(with_it)[2] - euler(without)[2] == pytest.approx(sign * 0.1)


@pytest.mark.parametrize("frame", WORLD_FRAMES)
def test_north_at_zero_yaw_is_where_the_frame_has_it(frame):
    expected = DIRECTIONS[frame][NORTH]
    assert WorldFrame(frame).north_at_zero_yaw == pytest.approx(expected, abs=1e-12)


@given(rotors())
def test_the_first_rotor_has_w_of_at_least_zero(q):
    assert WorldFrame("enu").update(q)[0] >= 0.0


@given(st.lists(st.tuples(rotors(), st.booleans()), min_size=2))
def test_published_rotors_never_flip_sign(rotors):
    world = WorldFrame("ned", 0.3)
    published = [world.update(negative(q) if flip else q) for q, flip in rotors]
    for p, q in itertools.pairwise(published):
        assert dot(p, q) >= 0.0


@given(rotors())
def test_a_whole_recording_is_turned_as_single_rotors(q):
    import numpy as np

    world = WorldFrame("enu", 0.2)
    assert world.all(np.array([q]))[0] == pytest.approx(np.array(product(world.rotor, q)))


@pytest.mark.parametrize("declination", [math.nan, math.inf, 4.0])
def test_a_declination_that_is_no_angle_is_refused(declination):
    with pytest.raises(UsageError, match="magnetic_declination must be between -π and π rad"):
        WorldFrame("enu", declination)


def test_an_unknown_frame_is_refused_with_the_known_ones():
    with pytest.raises(UsageError, match="world_frame must be one of enu, nwu, ned, got 'nue'"):
        WorldFrame("nue")
