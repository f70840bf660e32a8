"""Fits find what the simulated sensor has, and refuse data that do not tell it."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

pytest.importorskip("scipy", reason="scipy is not installed")

from hypothesis import given, settings
from hypothesis import strategies as st
from simulated import simulated
from strategies import rotors
from uncalibrated import FIELD, HARD, RAW, SOFT, attitudes, fields, heading_error, shown, sphere

from stateful_ahrs.filters.samples import Array, Stamps
from stateful_ahrs.mpu9250 import ellipsoid, fits
from stateful_ahrs.mpu9250.calibration import CalibrationError
from stateful_ahrs.mpu9250.fits import (
    CoverageError,
    MovedError,
    ResidualError,
    fit_accel,
    fit_gyro,
    fit_mag,
    is_enough,
)
from stateful_ahrs.recordings import Recording
from stateful_ahrs.rotor import rotate
from stateful_ahrs.snapshot.dcm import dcm

G = 9.81  # m/s², the simulator's
START = 1_700_000_000_000_000_000  # ns


@cache
def tumble(seed: int = 0) -> Recording:
    """32 s at 200 Hz, as an uncalibrated sensor shows them."""
    return simulated("sphere", 32.0, rate=200.0, seed=seed, errors=RAW)


def still(seconds: float, rate: float = 100.0, seed: int = 0) -> tuple[Stamps, Array, Array]:
    """Stamps, rates and forces at rest, with the data sheet's noise."""
    random = np.random.default_rng(seed)
    n = int(seconds * rate)
    stamps = START + np.arange(n) * int(1e9 / rate)
    gyro = RAW.gyro_bias + random.normal(0.0, RAW.gyro_noise, (n, 3))
    return stamps, gyro, np.array([0.0, 0.0, G]) + random.normal(0.0, RAW.accel_noise, (n, 3))


def held(directions: Array, seconds: float = 1.5, seed: int = 0) -> tuple[Stamps, Array, Array]:
    """Positions in which gravity shows up in these directions, with a quick turn between."""
    random = np.random.default_rng(seed)
    rate = 100.0
    gyro, accel = [], []
    for direction in directions:
        rest, turn = int(seconds * rate), int(0.6 * rate)
        clean = np.array(RAW.accel_scale) @ (G * direction / np.linalg.norm(direction))
        gyro += [np.zeros((rest, 3)), random.normal(0.0, 2.0, (turn, 3))]
        accel += [np.tile(clean, (rest, 1)), random.normal(0.0, G, (turn, 3))]
    rates, forces = np.vstack(gyro), np.vstack(accel) + RAW.accel_offset
    stamps = START + np.arange(len(rates)) * int(1e9 / rate)
    noise = random.normal(0.0, 1.0, (2, len(rates), 3))
    return stamps, rates + RAW.gyro_noise * noise[0], forces + RAW.accel_noise * noise[1]


AXES = np.vstack([np.eye(3), -np.eye(3)])
TILTED = np.array([(1, 1, 1), (-1, 1, 1), (1, -1, -1), (1, 1, 0), (0, 1, -1), (-1, 0, 1)])


def scale_error(matrix: object) -> float:
    """Largest element by which the corrected axes differ from ideal ones, as a part."""
    return float(np.abs(np.array(matrix) @ np.array(RAW.accel_scale) - np.eye(3)).max())


# --- what issue and data sheet ask for -----------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_after_a_tumble_heading_is_right_within_1_degree_in_every_attitude(seed: int):
    recording = tumble(seed)
    accel = fit_accel(recording.stamps, recording.gyro, recording.accel, G)
    mag = fit_mag(recording.mag)
    worst = 0.0
    for q in attitudes():
        force, field = shown(q)
        known, found = dcm(accel.apply(force), mag.apply(field))
        assert known
        worst = max(worst, heading_error(found, q))
    assert worst < 1.0


def test_before_it_heading_is_useless():
    errors = [heading_error(dcm(*shown(q))[1], q) for q in attitudes()]
    assert max(errors) > 170.0


@pytest.mark.parametrize("seed", range(3))
def test_after_a_tumble_the_accelerometers_scale_is_right_within_2_per_mille(seed: int):
    recording = tumble(seed)
    found = fit_accel(recording.stamps, recording.gyro, recording.accel, G)
    assert scale_error(found.matrix) < 0.002
    assert found.offset == pytest.approx(RAW.accel_offset, abs=0.02)  # 2 mg, four deviations
    assert found.quality["residual_percent"] == pytest.approx(0.8, abs=0.1)  # 8 mg of noise
    assert is_enough(found)


def test_after_a_tumble_hard_iron_soft_iron_and_the_field_are_known():
    found = fit_mag(tumble().mag)
    assert found.offset == pytest.approx(HARD, abs=0.1e-6)
    product = np.array(found.matrix) @ np.array(SOFT)
    assert np.abs(product / product[0, 0] - np.eye(3)).max() < 0.003
    assert np.linalg.det(np.array(found.matrix)) == pytest.approx(1.0)
    strength = FIELD * np.linalg.det(np.array(SOFT)) ** (1 / 3)
    assert found.quality["field_microtesla"] == pytest.approx(strength * 1e6, rel=5e-3)
    assert found.quality["residual_percent"] == pytest.approx(1.2, abs=0.1)  # 0.6 of 50 µT
    assert found.quality["coverage_percent"] > 85.0
    assert is_enough(found)


# --- gyroscope -----------------------------------------------------------------------------------


def test_the_bias_is_the_mean_rate_at_rest_with_its_temperature():
    found = fit_gyro(*still(6.0), temperature=31.456)
    assert found.offset == pytest.approx(RAW.gyro_bias, abs=5 * RAW.gyro_noise / math.sqrt(600))
    assert found.temperature == 31.46
    assert found.quality["seconds"] == pytest.approx(6.0, abs=0.02)
    assert found.quality["spread_deg_s"] == pytest.approx(0.17, abs=0.02)  # 0.1 on three axes
    assert is_enough(found)


def test_two_seconds_at_rest_are_a_bias_but_not_enough():
    assert not is_enough(fit_gyro(*still(3.0)))
    with pytest.raises(MovedError, match=r"rested for 1\.5 s at most, expected 2"):
        fit_gyro(*still(1.5))


def test_the_longest_rest_is_found_between_motions():
    stamps, gyro, accel = still(12.0)
    gyro[:300] += 1.0
    gyro[850:900] += np.random.default_rng(1).normal(0.0, 1.0, (50, 3))
    found = fit_gyro(stamps, gyro, accel)
    assert found.offset == pytest.approx(RAW.gyro_bias, abs=1e-3)
    assert found.quality["seconds"] == pytest.approx(5.5, abs=0.6)


def test_what_is_not_measured_is_passed_over():
    stamps, gyro, accel = still(6.0)
    gyro[50:60] = np.nan
    accel[:] = np.nan
    assert fit_gyro(stamps, gyro, accel).offset == pytest.approx(RAW.gyro_bias, abs=1e-3)


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (lambda t, gyro: gyro + 0.3, "the sensor moved: rates of"),
        (lambda t, gyro: gyro + 0.2 * np.sin(9.0 * t), "the sensor moved: .* spread"),
        (lambda t, gyro: gyro * np.nan, "0 gyroscope samples"),
        (lambda t, gyro: gyro + 0.05 * t, "rested for .* at most|the sensor moved"),
    ],
)
def test_no_bias_is_taken_from_a_sensor_that_moves(spoil, sentence: str):
    stamps, gyro, accel = still(10.0)
    seconds = ((stamps - stamps[0]) * 1e-9)[:, None]
    with pytest.raises(MovedError, match=sentence):
        fit_gyro(stamps, spoil(seconds, gyro), accel)


def test_a_slow_turn_that_tilts_is_no_rest():
    stamps, gyro, accel = still(10.0)
    angle = np.radians(5.0) * (stamps - stamps[0]) * 1e-9
    accel[:, 1], accel[:, 2] = G * np.sin(angle), G * np.cos(angle)
    with pytest.raises(MovedError):
        fit_gyro(stamps, gyro + np.radians([5.0, 0.0, 0.0]), accel)


def test_samples_across_a_gap_or_a_jump_back_are_not_one_rest():
    stamps, gyro, accel = still(3.8)
    for jump in (10_000_000_000, -10_000_000_000):
        moved = stamps.copy()
        moved[190:] += jump
        with pytest.raises(MovedError, match=r"1\.9 s at most"):
            fit_gyro(moved, gyro, accel)


def test_nothing_is_no_rest():
    with pytest.raises(MovedError, match="0 gyroscope samples"):
        fit_gyro(np.empty(0, np.int64), np.empty((0, 3)), np.empty((0, 3)))


# --- accelerometer -------------------------------------------------------------------------------


def test_six_positions_give_offset_and_scale():
    found = fit_accel(*held(AXES), G)
    assert found.quality["positions"] == 6
    assert np.count_nonzero(np.array(found.matrix)) == 3
    # 8 mg over 1.5 s is 0.7 mg; misalignment of 1 % costs (0.01)² / 2 of scale
    scales = np.diag(np.array(found.matrix)) * np.diag(RAW.accel_scale)
    assert scales == pytest.approx(1.0, abs=0.002)
    assert is_enough(found)
    assert not is_enough(found, positions=9)


def test_nine_positions_and_more_give_misalignment_too():
    stamps, gyro, accel = held(np.vstack([AXES, TILTED]))
    found = fit_accel(stamps, gyro, accel, G)
    assert found.quality["positions"] == 12
    assert scale_error(found.matrix) < 0.002
    assert found.quality["residual_percent"] < 0.1


def test_nine_positions_that_tell_no_misalignment_give_scale_alone():
    extra = np.array([(1.0, 0.5, 0.0), (-1.0, 0.5, 0.0), (1.0, -0.5, 0.0)])
    found = fit_accel(*held(np.vstack([AXES, extra])), G)
    assert found.quality["positions"] == 9
    assert np.count_nonzero(np.array(found.matrix)) == 3


def test_a_position_taken_twice_is_one():
    found = fit_accel(*held(np.vstack([AXES, AXES[:2]])), G)
    assert found.quality["positions"] == 6


def test_without_a_gyroscope_positions_are_seen_by_the_accelerometer():
    stamps, gyro, accel = held(AXES)
    found = fit_accel(stamps, np.full_like(gyro, np.nan), accel, G)
    assert found.quality["positions"] == 6


def test_five_positions_are_refused_and_the_sixth_is_named():
    with pytest.raises(CalibrationError, match=r"Still to be held for 1 s: -z up;"):
        stamps, gyro, accel = held(AXES[:5])
        quiet = np.linalg.norm(gyro, axis=1) < 0.5
        fit_accel(stamps[quiet], gyro[quiet], accel[quiet], G)


def test_gravity_in_other_units_is_refused():
    recording = tumble()
    with pytest.raises(ResidualError, match=r"gravity measures 1\.0. m/s², expected about 9\.8"):
        fit_accel(recording.stamps, recording.gyro, recording.accel / G)


def test_a_tumble_by_a_rough_hand_is_refused():
    recording = tumble()
    shaken = recording.accel + np.random.default_rng(0).normal(0.0, 1.0, recording.accel.shape)
    with pytest.raises(ResidualError, match=r"residual is \d+\.\d % of the field, expected 3"):
        fit_accel(recording.stamps, recording.gyro, shaken)


# --- magnetometer --------------------------------------------------------------------------------


@settings(max_examples=25)
@given(
    st.tuples(*[st.floats(-300e-6, 300e-6)] * 3),
    st.tuples(*[st.floats(-0.1, 0.1)] * 6),
    rotors(),
)
def test_any_hard_and_soft_iron_is_undone(hard, soft, q):
    s = np.eye(3)
    s[ellipsoid.ROWS, ellipsoid.COLUMNS] += soft
    s[ellipsoid.COLUMNS, ellipsoid.ROWS] = s[ellipsoid.ROWS, ellipsoid.COLUMNS]
    directions = np.array([rotate(q, tuple(v)) for v in sphere(1000)])
    points = FIELD * directions @ s + hard
    points += np.random.default_rng(3).normal(0.0, 0.6e-6, points.shape)
    found = fit_mag(points)
    corrected = (FIELD * directions @ s + hard - found.offset) @ np.array(found.matrix).T
    cosine = (corrected * directions).sum(axis=1) / np.linalg.norm(corrected, axis=1)
    assert np.degrees(np.arccos(cosine.min())) < 0.5


def test_samples_that_are_not_measured_or_disturbed_do_no_harm():
    points = fields(sphere(1000))
    points[::50] = np.nan
    points[7::50] += (30e-6, 0.0, 0.0)  # one of fifty near a passing magnet
    found = fit_mag(points)
    assert found.offset == pytest.approx(HARD, abs=0.5e-6)


def test_a_small_part_of_the_sphere_is_refused():
    with pytest.raises(CoverageError, match=r"cover \d+ % of the sphere, expected 50"):
        fit_mag(fields(sphere(1000, lowest=0.7)))


def test_half_a_sphere_is_refused_for_its_condition():
    with pytest.raises(CoverageError, match=r"condition of the fit is .*, expected 12 or less"):
        fit_mag(fields(sphere(1000, lowest=0.0)))


@settings(max_examples=25)
@given(rotors(), st.floats(0.0, 0.5))
def test_a_turn_about_one_axis_is_refused_as_planar(q, height):
    angles = np.linspace(0.0, 2.0 * np.pi, 1000)
    r = math.sqrt(1.0 - height * height)
    circle = np.column_stack([r * np.cos(angles), r * np.sin(angles), np.full(1000, height)])
    directions = np.array([rotate(q, tuple(v)) for v in circle])
    with pytest.raises(CoverageError, match="about one axis alone"):
        fit_mag(fields(directions))


def test_too_few_samples_are_refused():
    with pytest.raises(CoverageError, match="99 samples, expected 100"):
        fit_mag(fields(sphere(99)))
    with pytest.raises(CoverageError, match="0 samples"):
        fit_mag(np.empty((0, 3)))


def test_a_sensor_that_never_moved_is_refused():
    with pytest.raises(CoverageError):
        fit_mag(fields(np.tile([0.0, 0.0, 1.0], (1000, 1))))
    with pytest.raises(CoverageError):
        fit_mag(np.tile([1e-5, 0.0, 4e-5], (1000, 1)))


def test_a_field_that_changes_with_the_place_is_refused():
    directions = sphere(1000)
    noise = np.random.default_rng(5).normal(0.0, 6e-6, (1000, 3))
    with pytest.raises(ResidualError, match=r"residual is .* expected 5"):
        fit_mag(fields(directions) + noise)


def test_another_unit_is_refused():
    with pytest.raises(CalibrationError):
        fit_mag(1e6 * fields(sphere(1000)))
    with pytest.raises(CalibrationError):
        fit_mag(1e-3 * fields(sphere(1000)))


def test_the_more_of_the_sphere_is_seen_the_better_the_figures():
    lowest = (-0.4, -0.7, -1.0)
    found = [fit_mag(fields(sphere(2000, lowest=z))).quality for z in lowest]
    conditions = [quality["condition"] for quality in found]
    coverages = [quality["coverage_percent"] for quality in found]
    assert conditions == sorted(conditions, reverse=True)
    assert coverages == sorted(coverages)


def test_coverage_grows_along_a_tumble():
    mag = tumble().mag
    seen = [len(np.flatnonzero(fits.coverage.cells(fits.directions("mag", mag[:n]))))
            for n in (100, 800, 1200, 1600, 2000, 3000)]  # fmt: skip
    assert seen == sorted(seen)
    assert seen[0] <= 4


def test_a_long_recording_is_thinned_over_all_its_length():
    found = fit_mag(fields(sphere(20_000)))
    assert found.quality["samples"] <= fits.MOST_SAMPLES
    assert found.offset == pytest.approx(HARD, abs=0.2e-6)


# --- ellipsoid -----------------------------------------------------------------------------------


def test_the_jacobian_is_the_derivative_of_the_residuals():
    x = 1.3 * sphere(20, seed=4) + 0.1
    parameters = np.array([0.1, -0.2, 0.05, 0.9, 1.1, 1.0, 0.05, -0.03, 0.02])
    for count in (6, 9):
        p = parameters[:count]
        numeric = np.column_stack(
            [
                (ellipsoid._residuals(p + h, x) - ellipsoid._residuals(p - h, x)) / 2e-6
                for h in 1e-6 * np.eye(count)
            ]
        )
        assert ellipsoid._jacobian(p, x) == pytest.approx(numeric, abs=1e-8)


def test_a_whole_sphere_has_the_least_condition():
    found = ellipsoid.fit(sphere(20_000))
    assert found is not None
    assert found.condition == pytest.approx(math.sqrt(5.0 / 2.0), rel=0.03)


@pytest.mark.parametrize(
    "points", [np.zeros((200, 3)), np.full((200, 3), np.inf), np.outer(np.arange(200.0), [1, 2, 3])]
)
def test_points_that_are_no_ellipsoid_make_none(points: Array):
    with np.errstate(invalid="ignore"):
        found = ellipsoid.fit(points)
    assert found is None or found.condition > fits.WORST_CONDITION
