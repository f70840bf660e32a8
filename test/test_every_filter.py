"""What holds for every filter of the registry: one interface, and nothing that stops it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from simulated import nwu, simulated
from test_dcm import felt
from test_stateful import errors_deg, flips, recording

from stateful_ahrs import filters
from stateful_ahrs.filters import Settings
from stateful_ahrs.filters.samples import Samples
from stateful_ahrs.recordings import samples as samples_of
from stateful_ahrs.rotor import IDENTITY, difference, from_axis_angle, product, rotate

# Shown to fail on purpose, each by a test of its own.
FAILING = ("paper_printed", "lerp_as_printed", "aqua_as_printed")
FOLLOWING = [name for name in filters.FILTERS if name not in FAILING and "stateless" not in name]
CORRECTING = [name for name in FOLLOWING if name != "gyro"]
CLOSE = 3.0  # degrees; AQUA takes the slow start of a turn for bias, 0.1 rad/s being at rest

following = pytest.mark.parametrize("name", FOLLOWING)
RESTING = from_axis_angle((0.8, 0.0, 0.6), 2.5)  # upside down: corrections differ on each side


def resting(seconds):
    samples, truth = recording("rest", seconds)
    samples.accel[:], samples.mag[:] = felt(RESTING)
    return samples, [RESTING] * len(truth)


correcting = pytest.mark.parametrize("name", CORRECTING)


@following
@pytest.mark.parametrize("motion", ["turns", "two_turns", "tumble"])
def test_the_motion_is_followed(name, motion):
    samples, truth = recording(motion, 12.0)
    estimate = filters.make(name).run(samples)
    assert errors_deg(estimate, truth).max() < CLOSE
    assert flips(estimate) == 0
    assert np.linalg.norm(estimate, axis=1) == pytest.approx(1.0, abs=1e-9)


@correcting
def test_the_motion_is_followed_through_the_noise_of_the_sensors(name):
    recorded = simulated("tumble", 30.0, seed=2)
    error = errors_deg(filters.make(name).run(samples_of(recorded)), nwu(recorded))
    assert error[1000:].max() < CLOSE


@following
@pytest.mark.parametrize("every", [3, 10, 30])
def test_a_slow_magnetometer_is_enough(name, every):
    samples, truth = recording("tumble", 12.0, mag_every=every)
    assert errors_deg(filters.make(name).run(samples), truth).max() < CLOSE


@following
def test_without_a_magnetometer_heading_follows_the_gyroscope(name):
    samples, truth = recording("turns", 9.5, mag_every=10**9)
    samples.mag[:] = np.nan
    f = filters.make(name)
    assert errors_deg(f.run(samples), truth).max() < CLOSE  # the motion begins facing north
    assert not f.heading_known
    assert not f.report.heading_from_mag


@following
def test_a_magnetometer_that_dies_gives_way_to_the_gyroscope(name):
    samples, truth = recording("tumble", 12.0)
    samples.mag[400:] = np.nan
    f = filters.make(name)
    assert errors_deg(f.run(samples), truth).max() < CLOSE
    assert not f.report.heading_from_mag
    assert f.report.mag_age > 7.0


@correcting
def test_tilt_is_corrected_without_a_magnetometer(name):
    # the first sample is taken while shaken, some 20° off, which a minute makes forgotten
    samples, _ = resting(60.0)
    samples.mag[:] = np.nan
    up = tuple(samples.accel[-1] / 9.81)
    samples.accel[0] += (2.5, -2.5, 0.0)
    estimate = filters.make(name).run(samples)
    cosines = [rotate(tuple(q), up)[2] for q in (estimate[0], estimate[-1])]
    start, end = np.degrees(np.arccos(np.minimum(cosines, 1.0)))
    assert start > 15.0
    assert end < 0.1


@correcting
def test_heading_is_corrected_by_the_magnetometer(name):
    samples, truth = resting(90.0)
    samples.mag[0] = felt(product(from_axis_angle((0.0, 0.0, 1.0), 0.5), RESTING))[1]
    error = errors_deg(filters.make(name).run(samples), truth)
    assert error[0] > 25.0
    assert error[-1] < 0.1


@following
def test_the_first_magnetometer_sample_gives_heading(name):
    f = filters.make(name)
    truth = from_axis_angle((0.6, 0.0, 0.8), 2.0)
    accel, mag = felt(truth)
    for i in range(50):
        f.update_imu((0.0, 0.0, 0.0), accel, 0.0 if i == 0 else 0.01)
    assert f.started and not f.heading_known
    assert difference(f.rotor, truth) > 0.1
    f.update_mag(mag)
    f.update_imu((0.0, 0.0, 0.0), accel, 0.01)
    assert f.heading_known
    assert difference(f.rotor, truth) < 1e-4  # cubature is not exact before


@following
@pytest.mark.parametrize("bad", [0.0, math.nan, math.inf, 1e200])
@pytest.mark.parametrize("sensor", ["gyro", "accel", "mag"])
def test_a_bad_sample_costs_nothing_later(name, sensor, bad):
    samples, truth = recording("tumble", 8.0)
    getattr(samples, sensor)[400] = bad
    getattr(samples, sensor)[:20] = bad
    error = errors_deg(filters.make(name).run(samples), truth)
    assert error[30:].max() < CLOSE


# `aqua` and `stateful` keep what they learned of the gyroscope, and SAAM cannot start level.
@pytest.mark.parametrize(
    "name", [name for name in FOLLOWING if name not in ("aqua", "stateful", "paper_saam")]
)
def test_a_start_anew_is_a_start(name):
    # a bag in a loop: the second pass is the first once more, but for the sign it continues
    samples, _ = recording("tumble", 6.0)
    twice = Samples(*(np.concatenate([part, part]) for part in vars(samples).values()))
    estimate = filters.make(name).run(twice)
    once, again = estimate[: len(samples)], estimate[len(samples) :]
    assert errors_deg(again, [tuple(q) for q in once]).max() < 1e-6


@following
def test_a_start_anew_continues_the_sign(name):
    truth = from_axis_angle((0.0, 0.0, 1.0), 1.5 * math.pi)  # w < 0, and the snapshot's w > 0
    accel, mag = felt(truth)
    samples, _ = recording("two_turns", 6.8)
    f = filters.make(name)
    before = f.run(samples)[-1]
    f.update_mag(mag)
    after = f.update_imu((0.0, 0.0, 0.0), accel, 0.0)
    assert np.dot(before, after) >= 0.0


@pytest.mark.parametrize("name", filters.FILTERS)
def test_a_magnetometer_sample_that_came_late_amends_the_step(name):
    samples, _ = recording("tumble", 3.0, mag_every=4)
    in_time, late = filters.make(name), filters.make(name)
    for i in range(len(samples)):
        gyro, accel, mag = (tuple(a[i]) for a in (samples.gyro, samples.accel, samples.mag))
        dt = 0.0 if i == 0 else 0.01
        fresh = not math.isnan(mag[0])
        if fresh:
            in_time.update_mag(mag)
        in_time.update_imu(gyro, accel, dt)
        late.update_imu(gyro, accel, dt)
        if fresh:
            late.amend_mag(mag)
        assert late.rotor == in_time.rotor
    assert late.report == in_time.report


@pytest.mark.parametrize("name", filters.FILTERS)
def test_reset_forgets_but_for_the_counts(name):
    f = filters.make(name)
    f.update_imu((math.nan,) * 3, (0.0, 0.0, 9.81), 0.0)
    f.update_mag((1.0, 0.0, 0.0))
    f.update_imu((1.0, 0.0, 0.0), (0.0, 5.0, 9.81), 0.1)
    f.reset()
    assert not f.started and not f.heading_known
    assert f.rotor == IDENTITY
    assert f.report.gyro_rejected == 1


@following
def test_use_mag_off_ignores_the_magnetometer(name):
    samples, truth = recording("tumble", 8.0)
    samples.mag[:] = (0.0, 1.0, 0.0)
    f = filters.make(name, Settings(use_mag=False))
    assert errors_deg(f.run(samples), truth).max() < CLOSE
    assert not f.heading_known


@following
def test_the_first_heading_without_a_magnetometer_is_the_one_asked_for(name):
    f = filters.make(name, Settings(north_at_start=(0.0, 1.0, 0.0)))
    f.update_imu((0.0, 0.0, 0.0), (0.0, 0.0, 9.81), 0.0)
    assert rotate(f.rotor, (0.0, 1.0, 0.0)) == pytest.approx((1.0, 0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize("name", filters.FILTERS)
def test_new_settings_leave_the_filter_what_its_name_says(name):
    samples, _ = recording("tumble", 3.0)
    f = filters.make(name)
    f.settings = Settings(alpha=0.9)
    changed = f.run(samples)
    made = filters.make(name, Settings(alpha=0.9)).run(samples)
    assert changed == pytest.approx(made, abs=0.0)
