"""The five snapshots against truth and against each other, and where each has none."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from strategies import rotors, vectors
from test_dcm import felt

from stateful_ahrs.filters.compiled import compiled
from stateful_ahrs.filters.lerp import roll_pitch_yaw
from stateful_ahrs.rotor import IDENTITY, difference, from_axis_angle, product, unit
from stateful_ahrs.snapshot.aqua import aqua
from stateful_ahrs.snapshot.dcm import dcm
from stateful_ahrs.snapshot.fqa import fqa, half_angle
from stateful_ahrs.snapshot.markley import markley
from stateful_ahrs.snapshot.saam import saam

EVERYWHERE = [dcm, fqa, markley, aqua, roll_pitch_yaw]
ALL = [*EVERYWHERE, saam]
EQUAL = math.radians(1e-6)
SOLID = 1e-5  # of SAAM's x; its rounding errors are 1/x times as large as the others'
AXES = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
NONE = (False, IDENTITY)

dips = st.floats(-1.4, 1.4)
each = pytest.mark.parametrize("snapshot", ALL, ids=lambda snapshot: snapshot.__name__)


@st.composite
def special(draw):
    """Products of quarter turns, each missed by nothing or by next to nothing."""
    q = IDENTITY
    for _ in range(3):
        quarters = draw(st.integers(-4, 4))
        miss = draw(st.sampled_from([0.0, 1e-12, 1e-9, 1e-8, 1e-7, 1e-5, -1e-8]))
        axis = draw(st.sampled_from(AXES))
        q = product(q, from_axis_angle(axis, quarters * math.pi / 4.0 + miss))
    return unit(q)


@given(st.one_of(rotors(), special()), dips)
@pytest.mark.parametrize("snapshot", EVERYWHERE, ids=lambda snapshot: snapshot.__name__)
def test_snapshots_are_the_truth_at_any_attitude(snapshot, q, dip):
    found, rotor = snapshot(*felt(q, dip))
    assert found
    assert difference(rotor, q) < EQUAL


@given(st.one_of(rotors(), special()), dips)
def test_saam_is_the_truth_wherever_it_is_defined(q, dip):
    assume(abs(q[1]) > SOLID)
    found, rotor = saam(*felt(q, dip))
    assert found
    assert difference(rotor, q) < EQUAL


@given(vectors(), vectors())
def test_snapshots_agree_on_any_two_vectors(accel, mag):
    # noise makes the dip another at each sample; all take it from the sample itself
    cosine = sum(a * m for a, m in zip(accel, mag, strict=True))
    lengths = math.hypot(*accel), math.hypot(*mag)
    assume(min(lengths) > 1e-3 and abs(cosine) < 0.99 * lengths[0] * lengths[1])
    found, truth = dcm(accel, mag)
    assert found
    for snapshot in ALL:
        found, rotor = snapshot(accel, mag)
        if snapshot is saam and abs(truth[1]) < SOLID:
            continue
        assert found
        assert difference(rotor, truth) < EQUAL


@given(rotors(), st.floats(0.01, 1e3), st.floats(1e-9, 1e3))
@each
def test_units_do_not_matter(snapshot, q, gravity, magnetic):
    assume(snapshot is not saam or abs(q[1]) > SOLID)
    found, rotor = snapshot(*felt(q, gravity=gravity, magnetic=magnetic))
    assert found
    assert difference(rotor, q) < EQUAL


# Singular sets


@given(st.floats(-math.pi, math.pi), st.floats(-1.5, 1.5), dips)
@example(0.0, 0.0, 1.0)
def test_saam_has_none_level_at_any_yaw_nor_facing_north_at_any_pitch(yaw, pitch, dip):
    # a whole surface, of which Kusaka and Tanaka name the one axis (0, 0, 1)
    assert saam(*felt(from_axis_angle((0.0, 0.0, 1.0), yaw), dip)) == NONE
    assert saam(*felt(from_axis_angle((0.0, 1.0, 0.0), pitch), dip)) == NONE


@given(rotors(), dips)
def test_saam_always_has_the_sign_with_x_negative(q, dip):
    _, rotor = saam(*felt(q, dip))
    assert rotor[1] <= 0.0


@given(st.floats(-1e-3, 1e-3), st.floats(-math.pi, math.pi), st.sampled_from([1.0, -1.0]))
@example(0.0, 0.0, 1.0)
@example(math.acos(0.1) - math.pi / 2, 0.0, 1.0)  # where it changes the formula
def test_fqa_has_a_rotor_with_its_x_axis_vertical(miss, roll, sign):
    pitched = from_axis_angle((0.0, 1.0, 0.0), sign * math.pi / 2 + miss)
    q = product(pitched, from_axis_angle((1.0, 0.0, 0.0), roll))
    found, rotor = fqa(*felt(q))
    assert found
    assert difference(rotor, q) < EQUAL


@given(st.floats(-math.pi, math.pi), st.floats(-1e-3, 1e-3))
def test_markley_has_a_rotor_where_the_normals_are_opposite(angle, miss):
    # half a turn about any axis across the normal of the references, which is west
    axis = (math.cos(angle), 0.0, math.sin(angle))
    q = from_axis_angle(axis, math.pi + miss)
    found, rotor = markley(*felt(q))
    assert found
    assert difference(rotor, q) < EQUAL


@given(st.floats(-math.pi, math.pi), st.floats(-1e-3, 1e-3))
def test_aqua_has_a_rotor_upside_down_and_facing_south(heading, miss):
    upside_down = from_axis_angle((math.cos(heading), math.sin(heading), 0.0), math.pi + miss)
    south = from_axis_angle((0.0, 0.0, 1.0), math.pi + miss)
    for q in (upside_down, south, product(south, upside_down)):
        found, rotor = aqua(*felt(q))
        assert found
        assert difference(rotor, q) < EQUAL


@given(rotors())
@each
def test_a_field_along_gravity_has_no_north(snapshot, q):
    accel, _ = felt(q)
    assert snapshot(accel, accel) == NONE
    assert snapshot(accel, tuple(-1e-6 * x for x in accel)) == NONE


@pytest.mark.parametrize("bad", [0.0, math.nan, math.inf, -math.inf, 1e300])
@each
def test_useless_vectors_give_no_rotor(snapshot, bad):
    good = (0.1, 0.2, 9.8)
    for vector in ((bad, bad, bad), (bad, 0.0, 0.0)):
        assert snapshot(vector, good) == NONE
        assert snapshot(good, vector) == NONE


number = st.floats(allow_nan=True, allow_infinity=True)
triple = st.tuples(number, number, number)


@given(st.one_of(triple, vectors(1e13)), st.one_of(triple, vectors(1e13)))
@each
def test_whatever_comes_in_a_unit_rotor_comes_out(snapshot, accel, mag):
    found, q = snapshot(accel, mag)
    assert sum(x * x for x in q) == pytest.approx(1.0, abs=1e-6)
    assert found or q == IDENTITY


@given(rotors(), dips)
@each
def test_compiled_snapshots_are_the_same(snapshot, q, dip):
    vectors = felt(q, dip)
    found, rotor = compiled(snapshot)(*vectors)
    assert (found, rotor) == (
        snapshot(*vectors)[0],
        pytest.approx(snapshot(*vectors)[1], abs=1e-12),
    )


@given(st.floats(-math.pi, math.pi))
@example(0.0)
@example(math.pi)
@example(1e-9)
def test_half_an_angle_keeps_its_precision(angle):
    cosine, sine = half_angle(math.cos(angle), math.sin(angle))
    # the square roots of 1 ± cos alone would be off by 1e-8
    assert (cosine, sine) == pytest.approx((math.cos(angle / 2), math.sin(angle / 2)), abs=1e-15)
