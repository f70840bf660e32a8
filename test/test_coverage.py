"""Coverage counts equal parts of the sphere, whatever the sensor's offset."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import axes
from uncalibrated import FIELD, HARD, fields, sphere

from stateful_ahrs.mpu9250.coverage import BANDS, FACES, SECTORS, cells, centre, faces, fraction


def test_nothing_covers_nothing():
    assert not cells(np.empty((0, 3))).any()
    assert not cells(np.zeros((5, 3))).any()
    assert faces(np.empty((0, 3))) == []


@given(axes(), st.floats(1e-9, 1e9))
def test_a_direction_of_any_length_is_one_cell(direction, length):
    assert cells(length * np.array([direction])).sum() == 1


def test_all_directions_cover_everything():
    assert fraction(sphere(10_000)) == 1.0


def test_cells_have_equal_area():
    points = sphere(72_000)
    counts = np.zeros(BANDS * SECTORS)
    for point in points[:7200]:
        counts[np.flatnonzero(cells(point[None]))] += 1
    assert counts == pytest.approx(100.0, abs=45.0)  # Poisson: 4.5 times its deviation


@pytest.mark.parametrize("lowest", [0.9, 0.5, 0.0, -0.5])
def test_the_part_of_the_sphere_is_told_to_a_band(lowest: float):
    assert fraction(sphere(10_000, lowest=lowest)) == pytest.approx(
        (1.0 - lowest) / 2.0, abs=1.0 / BANDS
    )


def test_up_is_the_top_band_and_x_the_middle_sector():
    assert cells(np.array([[0.01, 0.0, 1.0]]))[0].sum() == 1
    assert cells(np.array([[0.0, 0.01, -1.0]]))[-1].sum() == 1
    assert cells(np.array([[1.0, 0.01, 0.1]]))[2, SECTORS // 2]


def test_faces_are_named_when_an_axis_points_along():
    points = np.array([(1.0, 0.1, 0.0), (0.0, -9.0, 0.2), (0.1, 0.0, 3.0), (1.0, 1.0, 0.0)])
    assert faces(points) == ["+x", "-y", "+z"]
    assert tuple(faces(np.vstack([np.eye(3), -np.eye(3)]))) == FACES


def test_the_centre_of_a_sphere_is_its_hard_iron():
    # the soft iron of 10 % moves it by less than that part of the radius
    assert centre(fields(sphere(1000)), 45e-6) == pytest.approx(HARD, abs=0.1 * FIELD)


@given(axes())
def test_a_short_arc_stays_a_small_part_of_the_sphere(axis):
    angles = np.linspace(0.0, 0.3, 300)
    side = np.cross(axis, (0.3, -0.5, 0.8))
    side /= np.linalg.norm(side)
    arc = np.outer(np.cos(angles), axis) + np.outer(np.sin(angles), side)
    points = fields(arc)
    assert fraction(points - centre(points, 45e-6)) < 0.15
