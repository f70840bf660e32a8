"""The stateful complementary filter: the paper's figures as claims, and what may go wrong."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from simulated import nwu, simulated
from test_dcm import felt

from stateful_ahrs import filters, rotor
from stateful_ahrs.errors import UsageError
from stateful_ahrs.filters import Settings
from stateful_ahrs.filters.gains import NO_PACE, gains, paced
from stateful_ahrs.filters.samples import Samples
from stateful_ahrs.filters.settings import Known
from stateful_ahrs.filters.stateful import StatefulFilter
from stateful_ahrs.mpu9250.motion import MOTIONS
from stateful_ahrs.recordings import samples as samples_of
from stateful_ahrs.rotor import IDENTITY, difference, follow, from_axis_angle
from stateful_ahrs.snapshot.dcm import dcm

RATE = 100
NAN = (math.nan, math.nan, math.nan)


# Figures 1, 3, 4 and 7: the rotor over two turns


def figure_1(n=(1.0, 2.0, 3.0), count=720):
    """Two turns about (1, 2, 3), from −2π to 2π (Figure 1's motion)."""
    length = math.sqrt(sum(x * x for x in n))
    axis = tuple(x / length for x in n)
    return [from_axis_angle(axis, 2 * math.pi * (2 * i / count - 1)) for i in range(count + 1)]


def figure_7(count=720):
    """Figure 7's motion: the axis turns from (1, 2, 3) to z between −120° and 120°."""
    attitudes = []
    start, end = np.array([1.0, 2.0, 3.0]) / math.sqrt(14.0), np.array([0.0, 0.0, 1.0])
    for degrees in np.linspace(-360.0, 360.0, count + 1):
        mix = min(1.0, max(0.0, (degrees + 120.0) / 240.0))
        n = (1.0 - mix) * start + mix * end
        attitudes.append(from_axis_angle(tuple(n / np.linalg.norm(n)), math.radians(degrees)))
    return attitudes


def snapshots(attitudes):
    return [dcm(*felt(q))[1] for q in attitudes]


def stateful(measured, state):
    rotors = []
    for q in measured:
        state = follow(q, state)
        rotors.append(state)
    return np.array(rotors)


def largest_step(rotors):
    return np.abs(np.diff(np.asarray(rotors), axis=0)).max()


def motion_step(attitudes):
    """The largest step that an element may make: half the angle between neighbours."""
    return max(difference(p, q) for p, q in itertools.pairwise(attitudes)) / 2


@pytest.mark.parametrize("attitudes", [figure_1(), figure_7()], ids=["figure 1", "figure 7"])
def test_snapshots_alone_jump(attitudes):
    assert largest_step(snapshots(attitudes)) > 1.0


@pytest.mark.parametrize("attitudes", [figure_1(), figure_7()], ids=["figure 3", "figure 7"])
def test_stateful_rotor_steps_no_further_than_the_motion(attitudes):
    rotors = stateful(snapshots(attitudes), attitudes[0])
    assert largest_step(rotors) <= motion_step(attitudes) + 1e-9


def test_stateful_rotor_is_the_true_rotor_from_a_near_initial_state():
    truth = figure_1()
    assert stateful(snapshots(truth), truth[0]) == pytest.approx(np.array(truth), abs=1e-9)


def test_stateful_rotor_is_the_negative_rotor_from_a_far_initial_state():
    truth = figure_1()
    far = stateful(snapshots(truth), rotor.negative(truth[0]))
    assert far == pytest.approx(-np.array(truth), abs=1e-9)  # Figure 4


@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3), st.booleans())
def test_any_smooth_motion_gives_a_continuous_rotor(rate, far):
    truth, q = [], IDENTITY
    for i in range(400):  # two turns or more about an axis that wanders
        wander = (rate[0], math.sin(0.02 * i) + rate[1], math.cos(0.03 * i) + rate[2])
        q = rotor.unit(rotor.product(q, rotor.from_rate(wander, 0.05)))
        truth.append(q)
    state = rotor.negative(truth[0]) if far else truth[0]
    assert largest_step(stateful(snapshots(truth), state)) <= motion_step(truth) + 1e-9


# The complementary filter


def recording(motion="turns", seconds=9.5, rate=RATE, mag_every=1, **changes):
    """Ideal samples of a motion of the simulator, and its true rotors."""
    script = MOTIONS[motion]
    times = np.arange(round(seconds * rate)) / rate
    truth = [script.rotor(t) for t in times]
    fields = [felt(q) for q in truth]
    mag = np.array([m for _, m in fields])
    mag[np.arange(len(times)) % mag_every != 0] = np.nan
    # the rate in the middle of the step is what turns one attitude into the next
    columns = {
        "gyro": np.array([script.rate(t - 0.5 / rate) for t in times]),
        "accel": np.array([a for a, _ in fields]),
        "mag": mag,
        **changes,
    }
    stamps = (1e9 + times * 1e9).round().astype(np.int64)
    return Samples(stamps=stamps, **columns), truth


def errors_deg(estimate, truth):
    return np.array(
        [math.degrees(difference(tuple(q), p)) for q, p in zip(estimate, truth, strict=True)]
    )


def flips(rotors):
    return int((np.sum(rotors[1:] * rotors[:-1], axis=1) < 0.0).sum())


@pytest.mark.parametrize("name", ["stateful", "paper"])
def test_stateful_filters_follow_a_turn_about_y_and_one_about_z(name):
    samples, truth = recording()
    estimate = filters.make(name).run(samples)
    assert errors_deg(estimate, truth).max() < 2.0
    assert flips(estimate) == 0
    assert estimate[-1] == pytest.approx(truth[-1], abs=0.02)  # two turns: back at +1


@pytest.mark.parametrize("seed", range(5))
def test_stateless_filter_loses_what_the_stateful_one_follows(seed):
    # with the noise of the data sheet; ideal samples let the stateless rotor pass through zero
    recorded = simulated("turns", 9.5, seed=seed)
    moving = slice(RATE, None)  # after a second of rest
    worst = {
        name: errors_deg(filters.make(name).run(samples_of(recorded)), nwu(recorded))[moving].max()
        for name in ("stateful", "paper", "paper_stateless")
    }
    assert worst["stateful"] < 2.0
    assert worst["paper"] < 3.0  # what the noise of its first snapshot left
    assert worst["paper_stateless"] > 90.0


def test_the_start_is_the_mean_of_all_snapshots_so_far():
    recorded = simulated("rest", 1.0)
    error = errors_deg(filters.make("stateful").run(samples_of(recorded)), nwu(recorded))[-1]
    # of 1.4° for one snapshot (0.6 µT in 25 µT) a hundredth part of the variance is left
    assert error < 3 * 1.4 / math.sqrt(100) + 0.6  # 0.6: hard iron and offsets of the simulator


@pytest.mark.parametrize("name", filters.FILTERS)
def test_sample_by_sample_and_compiled_are_the_same_filter(name):
    samples, _ = recording("tumble", 12.0, mag_every=3)
    one_by_one = filters.make(name)
    rotors = []
    for i in range(len(samples)):
        if not math.isnan(samples.mag[i, 0]):
            one_by_one.update_mag(tuple(samples.mag[i]))
        dt = 0.0 if i == 0 else (samples.stamps[i] - samples.stamps[i - 1]) * 1e-9
        rotors.append(one_by_one.update_imu(tuple(samples.gyro[i]), tuple(samples.accel[i]), dt))
    # 1e-12: compiled and library powers may differ in the last digit
    assert filters.make(name).run(samples) == pytest.approx(np.array(rotors), abs=1e-12)


def test_the_blend_is_eq_16_to_the_last_bit_when_sampled_as_in_the_paper():
    alpha = 0.98
    samples, _ = recording("tumble", 5.0)
    paper = filters.make("paper", Settings(alpha=alpha, alpha_rate=0.0)).run(samples)
    q = dcm(tuple(samples.accel[0]), tuple(samples.mag[0]))[1]
    for i in range(1, len(samples)):
        dt = (samples.stamps[i] - samples.stamps[i - 1]) * 1e-9
        predicted = rotor.product(q, rotor.from_rate(tuple(samples.gyro[i]), dt))
        snapshot = follow(dcm(tuple(samples.accel[i]), tuple(samples.mag[i]))[1], predicted)
        q = tuple(alpha * p + (1.0 - alpha) * s for p, s in zip(predicted, snapshot, strict=True))
        # 1e-14: the published rotor is normalised, the filter's is not
        assert paper[i] == pytest.approx(np.array(q) / np.linalg.norm(q), abs=1e-14)


@pytest.mark.parametrize("rate", [25, 100, 400])
def test_alpha_means_the_same_at_every_rate(rate):
    # a start 0.2 rad off, by a magnet, is forgotten with the time constant: see what is left of it
    settings = Settings(**filters.UNLEARNED, alpha=0.99, alpha_rate=100.0)
    assert settings.time_constant == pytest.approx(0.995, abs=0.001)
    samples, _ = recording("rest", 1.1, rate=rate)
    start = from_axis_angle((0.0, 0.0, 1.0), 0.2)
    samples.mag[0] = felt(start)[1]
    last = filters.make("stateful", settings).run(samples)[rate]
    left = 0.2 * settings.alpha**100
    assert difference(tuple(last), IDENTITY) == pytest.approx(left, rel=0.02)


@pytest.mark.parametrize("jitter", [1e-7, 1e-4, 3e-3, 9e-3])
@pytest.mark.parametrize(
    ("alpha", "rate"), [(0.9967, 100), (0.9, 100), (0, 100), (1, 100), (0.9, 0)]
)
def test_alpha_is_the_power_it_is_said_to_be_however_stamps_jitter(alpha, rate, jitter):
    taken = gains(Settings(alpha=alpha, alpha_rate=rate))
    pace = NO_PACE
    steps = np.random.default_rng(1).uniform(0.01 - jitter, 0.01 + jitter, 20_000)
    for dt in (0.0, *steps.tolist()):  # a start, and what follows it
        pace = paced(taken, pace, dt)
        expected = alpha ** (dt * rate) if rate else alpha
        assert pace[1] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("alpha_heading", [0.999, 0.98])
def test_alpha_heading_is_that_of_heading_alone(alpha_heading):
    # a first sample 0.2 rad off in heading or in tilt: see what is left of it after a second
    settings = Settings(**filters.UNLEARNED | {"alpha_heading": alpha_heading}, alpha=0.99)
    for axis, alpha in (((0.0, 0.0, 1.0), alpha_heading), ((1.0, 0.0, 0.0), 0.99)):
        samples, _ = recording("rest", 1.1)
        samples.accel[0], samples.mag[0] = felt(from_axis_angle(axis, 0.2))
        if axis[0]:
            samples.mag[:] = np.nan
        last = tuple(filters.make("stateful", settings).run(samples)[100])
        assert difference(last, IDENTITY) == pytest.approx(0.2 * alpha**100, rel=0.03)


def test_alpha_one_is_the_gyroscope_alone():
    samples, truth = recording()
    samples.accel[1:], samples.mag[1:] = (0.0, 5.0, 5.0), (1.0, 1.0, 1.0)
    estimate = filters.make("stateful", Settings(**filters.UNLEARNED, alpha=1.0)).run(samples)
    assert errors_deg(estimate, truth).max() < 0.1  # second order of eq. 12


def test_alpha_zero_is_the_snapshot_alone():
    samples, truth = recording(gyro=np.zeros((950, 3)))
    estimate = filters.make("stateful", Settings(**filters.UNLEARNED, alpha=0.0)).run(samples)
    assert errors_deg(estimate, truth).max() < 1e-6


# Magnetometers that are slow, missing, or useless


@pytest.mark.parametrize("every", [2, 3, 10, 30])
def test_a_slow_magnetometer_is_enough(every):
    samples, truth = recording("tumble", 20.0, mag_every=every)
    assert errors_deg(filters.make("stateful").run(samples), truth).max() < 2.0


def test_without_a_magnetometer_heading_follows_the_gyroscope():
    samples, truth = recording(mag_every=10**9)
    samples.mag[:] = np.nan
    estimate = filters.make("stateful").run(samples)
    assert errors_deg(estimate, truth).max() < 2.0  # the motion begins facing north


def test_the_first_heading_without_a_magnetometer_is_the_one_asked_for():
    east = filters.make("stateful", Settings(north_at_start=(0.0, 1.0, 0.0)))
    east.update_imu((0.0, 0.0, 0.0), (0.0, 0.0, 9.81), 0.0)
    facing = rotor.rotate(east.rotor, (1.0, 0.0, 0.0))
    assert facing == pytest.approx((0.0, -1.0, 0.0), abs=1e-12)  # NWU: −west
    assert not east.report.heading_from_mag


def test_the_first_magnetometer_sample_gives_heading_at_once():
    f = filters.make("stateful")
    truth = from_axis_angle((0.0, 0.0, 1.0), 2.0)
    accel, mag = felt(truth)
    f.update_imu((0.0, 0.0, 0.0), accel, 0.0)
    f.update_mag(mag)
    f.update_imu((0.0, 0.0, 0.0), accel, 0.01)
    assert difference(f.rotor, truth) < 1e-9
    assert f.report.heading_from_mag


def test_a_stale_magnetometer_gives_way_to_the_gyroscope():
    samples, truth = recording("tumble", 20.0)
    samples.mag[300:] = np.nan
    samples.mag[299] = felt(from_axis_angle((0.0, 0.0, 1.0), 1.0))[1]  # its last word was wrong
    f = filters.make("stateful", Settings(**filters.UNLEARNED, mag_timeout=0.1))
    # 0.1 s of a pull of 1 rad with a time constant of 3 s; a second of it would be 16°
    assert errors_deg(f.run(samples), truth)[400] < 3.0
    assert not f.report.heading_from_mag
    assert f.report.mag_age > 16.0


def test_a_restart_waits_for_a_magnetometer_sample_of_its_own():
    samples, truth = recording("tumble", 12.9, mag_every=15)
    count = len(samples)
    turned = [i for i in range(count) if i % 15 == 0][-1]
    twice = Samples(
        stamps=np.concatenate([samples.stamps[: turned + 5], samples.stamps]),
        **{
            name: np.concatenate([getattr(samples, name)[: turned + 5], getattr(samples, name)])
            for name in ("gyro", "accel", "mag")
        },
    )
    # the second pass begins without a magnetometer sample, where the first ended turned away
    twice.mag[turned + 5] = np.nan
    estimate = filters.make("stateful").run(twice)
    assert difference(truth[turned + 4], truth[0]) > 1.0
    second = errors_deg(estimate[turned + 5 :], truth)
    assert second[15:].max() < 2.0


def test_the_first_heading_leaves_the_tilt_alone():
    f = filters.make("stateful")
    accel, mag = felt(IDENTITY)
    for i in range(300):
        f.update_imu((0.0, 0.0, 0.0), accel, 0.0 if i == 0 else 0.01)
    f.update_mag(mag)
    f.update_imu((0.0, 0.0, 0.0), (4.0, 0.0, 9.81), 0.01)  # shaken just now
    assert difference(f.rotor, IDENTITY) < math.radians(0.2)


def test_a_field_along_gravity_is_not_heading():
    f = filters.make("stateful")
    for i in range(100):
        f.update_mag((0.0, 0.0, 4e-5))
        f.update_imu((0.0, 0.0, 0.0), (0.0, 0.0, 9.81), 0.0 if i == 0 else 0.01)
    assert f.report.mag_rejected == 100
    assert not f.report.heading_from_mag


def test_use_mag_off_ignores_the_magnetometer():
    samples, truth = recording()
    samples.mag[:] = (0.0, 1.0, 0.0)
    estimate = filters.make("stateful", Settings(use_mag=False)).run(samples)
    assert errors_deg(estimate, truth).max() < 2.0


# Bad samples


BAD = [0.0, math.nan, math.inf, -math.inf, 1e200, -1e308]


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("sensor", ["gyro", "accel", "mag"])
def test_recovery_with_the_next_good_sample(sensor, bad):
    samples, truth = recording("tumble", 8.0)
    getattr(samples, sensor)[400] = bad
    estimate = filters.make("stateful").run(samples)
    assert np.isfinite(estimate).all()
    assert errors_deg(estimate, truth).max() < 2.0


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("sensor", ["gyro", "accel", "mag"])
def test_bad_samples_at_the_start_cost_nothing_later(sensor, bad):
    samples, truth = recording("tumble", 8.0)
    getattr(samples, sensor)[:50] = bad
    estimate = filters.make("stateful").run(samples)
    assert np.isfinite(estimate).all()
    assert errors_deg(estimate, truth)[60:].max() < 2.0


number = st.floats(allow_nan=True, allow_infinity=True)
triple = st.tuples(number, number, number)


@given(st.lists(st.tuples(triple, triple, triple, st.floats(0.0, 2.0)), max_size=20))
@pytest.mark.parametrize("name", filters.FILTERS)
def test_whatever_comes_in_a_unit_rotor_comes_out(name, inputs):
    f = filters.make(name)
    for gyro, accel, mag, dt in inputs:
        f.update_mag(mag)
        q = f.update_imu(gyro, accel, dt)
        assert sum(x * x for x in q) == pytest.approx(1.0, abs=1e-9)


def test_rates_are_held_while_the_gyroscope_gives_none():
    f = filters.make("stateful", Settings(**filters.UNLEARNED, alpha=1.0))
    f.update_imu((0.0, 0.0, 1.0), (0.0, 0.0, 9.81), 0.0)
    for _ in range(20):
        f.update_imu(NAN, (0.0, 0.0, 9.81), 0.01)
    assert difference(f.rotor, IDENTITY) == pytest.approx(0.2, abs=1e-4)


def test_what_is_too_weak_or_too_strong_for_gravity_is_left_out():
    for accel in ((1e-3, 0.0, 0.0), (1e5, 0.0, 0.0)):
        f = filters.make("stateful")
        f.update_imu((0.0, 0.0, 0.0), (0.0, 0.0, 9.81), 0.0)
        for _ in range(300):
            f.update_imu((0.0, 0.0, 0.0), accel, 0.01)
        assert f.rotor == IDENTITY
        assert f.report.accel_rejected == 300


def test_the_sign_is_that_of_the_predicted_rotor():
    # 0.9 s at 250 °/s between two samples: the last rotor is on the other side
    f = filters.make("stateful", Settings(alpha=0.0))
    rate = math.radians(250.0)
    f.update_imu((0.0, 0.0, rate), *((0.0, 0.0, 9.81), 0.0))
    truth = from_axis_angle((0.0, 0.0, 1.0), 0.9 * rate)
    accel, mag = felt(truth)
    f.update_mag(mag)
    f.update_imu((0.0, 0.0, rate), accel, 0.9)
    assert f.rotor == pytest.approx(truth, abs=1e-9)  # w < 0


def test_an_amendment_after_a_reset_is_nothing():
    f = filters.make("stateful")
    f.update_imu((0.0, 0.0, 0.0), (0.0, 0.0, 9.81), 0.0)
    f.reset()
    f.amend_mag((2e-5, 0.0, -4e-5))
    assert not f.started
    assert f.report.accel_rejected == 0


def test_rejections_are_counted():
    f = StatefulFilter()
    good = ((0.0, 0.0, 0.0), (0.0, 0.0, 9.81))
    f.update_imu(*good, 0.0)
    f.update_imu(NAN, good[1], 0.01)
    f.update_imu(good[0], (0.0, 0.0, 0.0), 0.01)
    f.update_mag((0.0, 0.0, 1e-5))  # along gravity
    f.update_imu(*good, 0.01)
    f.update_mag((0.0, 0.0, 0.0))
    f.update_imu(*good, 0.01)
    report = f.report
    assert (report.gyro_rejected, report.accel_rejected, report.mag_rejected) == (1, 1, 2)


# Restarts and settings


def test_a_restart_continues_the_sign():
    truth = from_axis_angle((0.0, 0.0, 1.0), 1.5 * math.pi)  # w < 0, and the snapshot's w > 0
    accel, mag = felt(truth)
    samples, _ = recording("two_turns", 7.0)
    f = filters.make("stateful")
    before = f.run(samples)[-1]
    f.update_mag(mag)
    after = f.update_imu((0.0, 0.0, 0.0), accel, 0.0)
    assert difference(after, truth) < 1e-9
    assert np.dot(before, after) >= 0.0


def test_settings_apply_from_the_next_sample():
    f = filters.make("stateful", Settings(**filters.UNLEARNED, alpha=1.0))
    f.update_imu((0.0, 0.0, 0.0), (0.0, 0.0, 9.81), 0.0)
    f.update_imu((0.0, 0.0, 0.0), (0.0, 9.81, 0.0), 0.01)
    assert f.rotor == IDENTITY
    f.settings = replace(f.settings, alpha=0.0)
    f.update_imu((0.0, 0.0, 0.0), (0.0, 9.81, 0.0), 0.01)
    assert difference(f.rotor, IDENTITY) == pytest.approx(math.pi / 2)


def test_what_makes_a_filter_the_papers_outlives_new_settings():
    f = filters.make("paper_stateless")
    f.settings = Settings(alpha=0.5)
    assert f.settings == Settings(**filters.AS_PUBLISHED, alpha=0.5, stateful=False)


def test_with_all_off_it_is_the_papers_filter_to_the_last_bit():
    samples = samples_of(simulated("tumble", 8.0))
    off = Settings(**filters.AS_PUBLISHED)
    paper = filters.make("paper")
    assert np.array_equal(filters.make("stateful", off).run(samples), paper.run(samples))
    live = filters.make("stateful", replace(off, alpha=0.9))  # α, too, is changed on the way
    for f in (live, paper):
        f.reset()
    live_rotors, paper_rotors = [], []
    for i in range(len(samples)):
        for f, rotors in ((live, live_rotors), (paper, paper_rotors)):
            if i == 400:
                f.settings = replace(f.settings, alpha=0.99, alpha_rate=0.0)
            elif i == 0:
                f.settings = replace(f.settings, alpha=0.95)
            f.update_mag(tuple(samples.mag[i].tolist()))
            dt = 0.0 if i == 0 else (samples.stamps[i] - samples.stamps[i - 1]) * 1e-9
            gyro, accel = samples.gyro[i].tolist(), samples.accel[i].tolist()
            rotors.append(f.update_imu(tuple(gyro), tuple(accel), dt))
    assert live_rotors == paper_rotors


def test_each_part_has_a_switch_that_changes_something():
    samples = samples_of(simulated("tumble", 12.0))
    samples.gyro[500] += 20.0  # a glitch
    seen = [filters.make("stateful").run(samples)]
    for part in filters.UNLEARNED:
        seen.append(
            filters.make("stateful", Settings(**{part: filters.UNLEARNED[part]})).run(samples)
        )
    seen[1] = filters.make("stateful", Settings(alpha_heading=0.999)).run(samples)
    assert all((p != q).any() for p, q in itertools.combinations(seen, 2))


@pytest.mark.parametrize("alpha", [-0.1, 1.2, math.nan, math.inf])
def test_alpha_out_of_range_is_refused_with_its_range(alpha):
    with pytest.raises(UsageError, match=r"alpha must be between 0 and 1, got"):
        Settings(alpha=alpha)


@pytest.mark.parametrize(
    "wrong", [{"mag_timeout": math.nan}, {"mag_timeout": -1.0}, {"north_at_start": (0.0, 0.0, 0.0)}]
)
def test_settings_that_make_no_filter_are_refused(wrong):
    with pytest.raises(UsageError, match="must be"):
        Settings(**wrong)


def test_an_unknown_filter_is_refused_with_the_known_ones():
    with pytest.raises(UsageError, match="no filter 'kalman'; there are stateful, paper"):
        filters.make("kalman")


def test_a_rotor_of_its_own_sign_teaches_nothing():
    samples, _ = recording("turns")
    f = filters.make("stateful", Settings(stateful=False))
    f.run(samples)
    assert f.known is None
    assert f.bias == (0.0, 0.0, 0.0)


def test_the_papers_filter_takes_nothing_from_an_earlier_run():
    samples = samples_of(simulated("tumble", 8.0))
    known = Settings(known=Known(bias=(0.02, 0.0, 0.0), mag_delay=0.01))
    for name in ("paper", "paper_stateless", "paper_printed", "paper_fqa", "lerp"):
        assert np.array_equal(
            filters.make(name, known).run(samples), filters.make(name).run(samples)
        )


def test_what_is_known_corrects_though_nothing_is_learned():
    samples = samples_of(simulated("tumble", 8.0))
    bias = np.array([0.05, -0.02, 0.03])
    off = Settings(**filters.UNLEARNED)
    expected = filters.make("stateful", off).run(samples)
    biased = replace(samples, gyro=samples.gyro + bias)
    for stateful in (True, False):
        f = filters.make("stateful", replace(off, known=Known(bias=tuple(bias)), stateful=stateful))
        found = f.run(biased)
        assert f.bias == tuple(bias)
        if stateful:
            assert found == pytest.approx(expected, abs=1e-9)


def test_alpha_is_live_in_every_filter_that_has_it():
    for name in ("stateful", "paper", "paper_printed", "paper_fqa", "lerp", "aqua"):
        f = filters.make(name, Settings(**filters.UNLEARNED, alpha=1.0))
        level, up, on_side = (2e-5, 0.0, -4e-5), (0.0, 0.0, 9.81), (0.0, 5.0, 8.44)
        f.update_mag(level)
        f.update_imu((0.0, 0.0, 0.0), up, 0.0)
        for alpha, moved in ((1.0, False), (0.5, True)):
            f.settings = replace(f.settings, alpha=alpha)
            before = f.rotor
            for _ in range(500):
                f.update_mag(level)
                f.update_imu((0.0, 0.0, 0.0), on_side, 0.01)
            assert (difference(f.rotor, before) > 0.3) is moved, name


@pytest.mark.parametrize("name", ["stateful", "paper", "ekf", "aqua"])
def test_a_restart_waits_for_a_usable_force(name):
    f = filters.make(name)
    f.update_mag((2e-5, 0.0, -4e-5))
    f.update_imu((0.0, 0.0, 0.0), (0.0, 0.0, 9.81), 0.0)
    f.update_imu((0.0, 0.0, 0.0), (math.nan, 0.0, 0.0), 0.0)  # after a gap; it lies on its side
    assert not f.started
    f.update_mag((2e-5, -4e-5, 0.0))
    found = f.update_imu((0.0, 0.0, 0.0), (0.0, 9.81, 0.0), 0.01)
    assert f.started
    assert difference(found, from_axis_angle((1.0, 0.0, 0.0), math.pi / 2)) < 1e-6


@pytest.mark.parametrize("rate", [1.0, 10.0])
def test_slow_samples_are_no_spikes_and_need_no_normalising(rate):
    times = np.arange(60.0 * rate) / rate
    shake = 0.6 * np.sin(2 * math.pi * 0.2 * rate * times)
    samples = Samples(
        (1e9 + times * 1e9).astype(np.int64),
        np.stack([shake, 0.5 * shake, 0.3 + 0.0 * shake], axis=1),
        np.tile([0.0, 0.0, 9.81], (len(times), 1)),
        np.tile([2e-5, 0.0, -4e-5], (len(times), 1)),
    )
    for normalise in (True, False):
        found = filters.make("stateful", Settings(normalise=normalise)).run(samples)
        assert np.linalg.norm(found, axis=1) == pytest.approx(1.0, abs=1e-9)
