"""The snapshot of Kusaka & Tanaka against truth."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import rotors, vectors

from stateful_ahrs.rotor import conjugate, difference, from_axis_angle, rotate
from stateful_ahrs.snapshot.dcm import dcm

ROUNDING = 1e-9  # rad
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def felt(q, dip=math.radians(60.0), gravity=9.81, magnetic=50e-6):
    """Specific force and magnetic field in the sensor frame at the attitude ``q``."""
    field = (magnetic * math.cos(dip), 0.0, -magnetic * math.sin(dip))
    return rotate(conjugate(q), (0.0, 0.0, gravity)), rotate(conjugate(q), field)


@given(rotors(), st.floats(-1.5, 1.5))
def test_snapshot_is_the_truth_at_any_attitude_and_dip(q, dip):
    found, snapshot = dcm(*felt(q, dip))
    assert found
    assert difference(snapshot, q) < ROUNDING


@given(rotors(), st.floats(0.01, 1e3), st.floats(1e-9, 1e3))
def test_units_do_not_matter(q, gravity, magnetic):
    found, snapshot = dcm(*felt(q, gravity=gravity, magnetic=magnetic))
    assert found
    assert difference(snapshot, q) < ROUNDING


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("degrees", [-180.0, -90.0, 90.0, 179.999, 180.0, 180.001])
def test_no_attitude_is_singular(axis, degrees):
    q = from_axis_angle(AXES[axis], math.radians(degrees))
    found, snapshot = dcm(*felt(q))
    assert found
    assert difference(snapshot, q) < ROUNDING


def test_upside_down_and_turned():
    q = (0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0)
    found, snapshot = dcm(*felt(q))
    assert found
    assert difference(snapshot, q) < ROUNDING


@given(rotors())
def test_a_field_along_gravity_has_no_north(q):
    accel, _ = felt(q)
    assert not dcm(accel, accel)[0]
    assert not dcm(accel, tuple(-1e-6 * x for x in accel))[0]


@pytest.mark.parametrize("bad", [0.0, math.nan, math.inf, -math.inf, 1e300])
def test_useless_vectors_give_no_rotor(bad):
    good = (0.1, 0.2, 9.8)
    for vector in ((bad, bad, bad), (bad, 0.0, 0.0)):
        assert dcm(vector, good) == (False, (1.0, 0.0, 0.0, 0.0))
        assert dcm(good, vector) == (False, (1.0, 0.0, 0.0, 0.0))


@given(vectors(1e13), vectors(1e13))
def test_a_rotor_found_is_of_unit_length(accel, mag):
    found, q = dcm(accel, mag)
    assert sum(x * x for x in q) == pytest.approx(1.0, abs=1e-6)
    assert found or q == (1.0, 0.0, 0.0, 0.0)
