"""The filter that learns its sensors: what it learns, what it scores, and what may go wrong."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_dcm import felt

from stateful_ahrs import filters, rotor
from stateful_ahrs.evaluation.metrics import Truth
from stateful_ahrs.evaluation.score import prepare, score
from stateful_ahrs.filters import Settings
from stateful_ahrs.filters.frames import WorldFrame
from stateful_ahrs.filters.gaps import is_gap
from stateful_ahrs.filters.learning import SIZE
from stateful_ahrs.filters.samples import Samples
from stateful_ahrs.filters.settings import Known
from stateful_ahrs.filters.stateful import StatefulFilter
from stateful_ahrs.mpu9250.motion import MOTIONS, TURN, Motion, Turn, X, Y, Z
from stateful_ahrs.recordings import load
from stateful_ahrs.rotor import IDENTITY, difference, from_axis_angle

BROAD = Path(__file__).parents[2] / "shared" / "data" / "broad"
NAN = (math.nan, math.nan, math.nan)
DEGREE = math.pi / 180.0
MICRO = 1e-6  # tesla
# Turns about every axis, two at a time, and a second of rest.
WILD = Motion(
    Turn(X, TURN, 1.0, 4.0),
    Turn(Z, -TURN, 2.0, 5.0),
    Turn(Y, TURN, 4.0, 4.0),
    Turn(Z, TURN, 7.0, 4.0),
    period=12.0,
)


def recording(
    seconds=60.0,
    rate=100,
    motion=WILD,
    bias=(0.0, 0.0, 0.0),
    misalignment=None,
    delay=0.0,
    iron=(0.0, 0.0, 0.0),
    mag_every=1,
    start=0.0,
    noise=1.0,
):
    """Samples with the data sheet's noise, or so much of it, and the errors named; true rotors."""
    random = np.random.default_rng(1)
    times = start + np.arange(round(seconds * rate)) / rate
    truth = [motion.rotor(t) for t in times]
    # the rate in the middle of the step is what turns one attitude into the next
    rates = np.array([motion.rate(t - 0.5 / rate) for t in times])
    if misalignment is not None:
        rates = np.linalg.solve(np.eye(3) + misalignment, rates.T).T
    mag = np.array([felt(motion.rotor(t - delay))[1] for t in times]) + iron
    mag += noise * 0.6 * MICRO * random.normal(size=mag.shape)
    mag[np.arange(len(times)) % mag_every != 0] = np.nan
    accel = np.array([felt(q)[0] for q in truth])
    samples = Samples(
        (1e9 + times * 1e9).round().astype(np.int64),
        rates + bias + noise * 0.1 * DEGREE * random.normal(size=rates.shape),
        accel + noise * 0.05 * random.normal(size=accel.shape),
        mag,
    )
    return samples, truth


def errors_deg(estimate, truth):
    return np.array(
        [math.degrees(difference(tuple(q), p)) for q, p in zip(estimate, truth, strict=True)]
    )


def rms(errors):
    return math.sqrt(np.mean(errors**2))


def inclination_deg(estimate, truth):
    up = (0.0, 0.0, 1.0)
    return np.array(
        [
            math.degrees(
                math.acos(min(1.0, np.dot(_up(tuple(q), up), _up(p, up))))  # in the sensor frame
            )
            for q, p in zip(estimate, truth, strict=True)
        ]
    )


def _up(q, up):
    return rotor.rotate(rotor.conjugate(q), up)


def live(samples, f, after=lambda: None):
    """The filter sample by sample, as the node runs it; ``after`` is called after each."""
    rotors = []
    for i in range(len(samples)):
        if not math.isnan(samples.mag[i, 0]):
            f.update_mag(tuple(samples.mag[i].tolist()))
        step = 0.0 if i == 0 else (samples.stamps[i] - samples.stamps[i - 1]) * 1e-9
        gyro, accel = samples.gyro[i].tolist(), samples.accel[i].tolist()
        rotors.append(f.update_imu(tuple(gyro), tuple(accel), step))
        after()
    return np.array(rotors)


@pytest.fixture
def learning():
    return filters.make("stateful")


# BROAD


@pytest.fixture(scope="module")
def trials():
    pytest.importorskip("scipy")
    found = sorted(BROAD.glob("*.mat"))
    if not found:
        pytest.skip("the BROAD trials are not beside the checkout")
    return [prepare(load(path)) for path in found]


def mean_rmse(trials, name="stateful"):
    scores = [score(trial, name, Settings()).rmse for trial in trials]
    return [np.mean([getattr(rmse, part) for rmse in scores]) for part in ("total", "inclination")]


def thinned(trial):
    """Every third sample."""
    samples, truth = trial.samples, trial.truth
    few = Samples(
        samples.stamps[::3], *(np.ascontiguousarray(part[::3]) for part in _columns(samples))
    )
    return replace(trial, samples=few, truth=Truth(truth.rotors[::3], truth.counts[::3]))


def test_broad_is_at_most_1_85_degrees_and_a_quarter_of_the_papers_filter(trials):
    total, inclination = mean_rmse(trials)
    assert total < 1.85
    assert inclination < 0.65
    assert total < mean_rmse(trials, "paper")[0] / 4.0


def test_a_third_of_the_samples_loses_at_most_5_percent(trials):
    whole = mean_rmse(trials)
    third = mean_rmse([thinned(trial) for trial in trials])
    assert third[0] < 1.05 * whole[0]
    assert third[1] < 1.05 * whole[1]


def test_what_another_trial_taught_costs_nothing(trials):
    known, found, alone = Settings().known, [], []
    for trial in trials:
        f = filters.make("stateful")
        f.run(trial.samples)
        before, known = known, f.known
        found.append(score(trial, "stateful", Settings(known=before)).rmse.total)
        alone.append(score(trial, "stateful", Settings()).rmse.total)
    assert np.mean(found[1:]) < 1.01 * np.mean(alone[1:])
    assert (np.array(found) < 1.5 * np.array(alone)).all()


def test_true_errors_lie_within_the_deviations_told(trials):
    tilts, headings, widths = [], [], []
    for trial in map(thinned, trials[::3]):
        f = filters.make("stateful")
        told = []
        rotors = live(trial.samples, f, lambda told=told, f=f: told.append(f.stddev))
        tilt, heading = np.array(told)[trial.truth.counts].T
        enu = WorldFrame("enu").all(rotors)[trial.truth.counts]
        true = trial.truth.rotors[trial.truth.counts] * (1.0, -1.0, -1.0, -1.0)
        w, x, y, z = rotor.product(tuple(enu.T), tuple(true.T))  # of the error, earth frame
        about = 2.0 * np.arctan2(z, w)
        headings.append(np.abs((about + math.pi) % (2.0 * math.pi) - math.pi) / heading)
        tilts.append(2.0 * np.arcsin(np.minimum(1.0, np.hypot(x, y))) / tilt)
        widths.append((np.median(tilt), np.median(heading)))
    for errors in (np.concatenate(headings), np.concatenate(tilts)):  # the latter as a whole
        assert np.mean(errors < 1.0) > 0.60
        assert np.mean(errors < 3.0) > 0.97
    tilt, heading = np.degrees(np.mean(widths, axis=0))
    assert tilt < 0.8
    assert heading < 4.0


# What is learned


def test_a_bias_is_learned_in_motion(learning):
    bias = (1.0 * DEGREE, -1.0 * DEGREE, 0.5 * DEGREE)
    samples, truth = recording(60.0, bias=bias)
    errors = errors_deg(learning.run(samples), truth)
    assert learning.report.learned_bias_rad_s == pytest.approx(bias, abs=0.06 * DEGREE)
    assert rms(errors[3000:]) < 0.5  # 2.2 with `paper`


def test_a_bias_is_learned_at_rest_and_said_to_be(learning):
    bias = (1.0 * DEGREE, -1.0 * DEGREE, 0.5 * DEGREE)
    samples, truth = recording(20.0, motion=MOTIONS["rest"], bias=bias)
    errors = errors_deg(learning.run(samples), truth)
    # 0.1 °/s of noise, averaged over 20 s at 100 Hz
    assert learning.report.learned_bias_rad_s == pytest.approx(bias, abs=0.02 * DEGREE)
    assert learning.report.resting
    assert errors[1000:].max() < 0.5


def test_misalignment_is_learned_and_can_be_left_alone():
    scale = np.diag((0.005, -0.006, 0.004))
    samples, truth = recording(120.0, misalignment=scale)
    learned, left = filters.make("stateful"), filters.make("stateful")
    left.settings = Settings(learn_misalignment=False)
    errors = rms(errors_deg(learned.run(samples), truth)[6000:])
    assert np.array(learned.report.misalignment) == pytest.approx(scale, abs=0.0015)
    assert errors < rms(errors_deg(left.run(samples), truth)[6000:])
    assert left.report.misalignment == ((0.0,) * 3,) * 3


def test_the_magnetometers_delay_is_learned_and_can_be_left_alone():
    samples, truth = recording(60.0, delay=0.012)
    learned, left = filters.make("stateful"), filters.make("stateful")
    left.settings = Settings(learn_mag=False)
    errors = rms(errors_deg(learned.run(samples), truth)[3000:])
    assert learned.report.mag_delay_s == pytest.approx(0.012, abs=0.002)
    assert errors < 0.4  # the delay alone is 1.4° at 115 °/s
    assert errors < rms(errors_deg(left.run(samples), truth)[3000:])
    assert left.report.mag_delay_s == 0.0


def test_a_large_hard_iron_is_learned(learning):
    iron = np.array((6.0, -4.0, 8.0)) * MICRO
    samples, truth = recording(60.0, iron=iron)
    errors = errors_deg(learning.run(samples), truth)
    assert np.array(learning.report.hard_iron) == pytest.approx(iron, abs=0.8 * MICRO)
    assert rms(errors[3000:]) < 1.2  # 8 µT across 25 µT would be 18°


def test_a_magnet_in_passing_is_not_trusted_and_trust_recovers(learning):
    samples, truth = recording(60.0)
    samples.mag[3000:3500] += np.array((20.0, -15.0, 20.0)) * MICRO
    before = Samples(*(part[:3400] for part in vars(samples).values()))
    learning.run(before)
    assert learning.report.mag_trust < 0.1
    assert not learning.report.heading_from_mag
    errors = errors_deg(learning.run(samples), truth)
    assert errors[3000:].max() < 3.0
    assert learning.report.mag_trust > 0.9
    assert learning.report.field_changes == 0


def test_another_field_that_stays_becomes_the_reference(learning):
    samples, _ = recording(120.0)
    samples.mag[2000:] *= 1.3  # as in another room
    learning.run(samples)
    assert learning.report.mag_trust > 0.9
    assert learning.report.field_changes == 1


def test_a_shaken_sensor_keeps_its_inclination(learning):
    samples, truth = recording(30.0)
    shake = 3.0 * np.sin(2.0 * math.pi * 2.0 * np.arange(len(samples)) / 100)
    east = [
        rotor.rotate(rotor.conjugate(q), (s, 0.0, 0.0)) for q, s in zip(truth, shake, strict=True)
    ]
    samples.accel[:] += np.array(east)
    paper = inclination_deg(filters.make("paper").run(samples), truth)
    found = inclination_deg(learning.run(samples), truth)
    assert rms(found[500:]) < 0.3
    assert rms(found[500:]) < rms(paper[500:])


def test_what_a_sudden_magnet_took_is_taken_back(learning):
    samples, truth = recording(60.0)
    samples.mag[3000:3050] = (-60.0 * MICRO, 60.0 * MICRO, 0.0)  # half a second, 100° off or so
    errors = errors_deg(learning.run(samples), truth)
    unharmed = errors_deg(learning.run(recording(60.0)[0]), truth)
    assert errors[3000:3100].max() > 1.5 * unharmed[3000:3100].max()
    assert errors[3300:3600].max() < 0.5


def test_a_first_heading_beside_iron_is_let_go_of(learning):
    still, moving = (recording(20.0, motion=MOTIONS["rest"]), recording(40.0))
    parts = [
        np.concatenate([getattr(samples, name) for samples, _ in (still, moving)])
        for name in ("gyro", "accel", "mag")
    ]
    stamps = 1_000_000_000 + np.arange(6000) * 10_000_000
    parts[2][:2000] += np.array((0.0, 4.0, 2.0)) * MICRO  # 9° of heading
    truth = still[1] + moving[1]
    errors = errors_deg(learning.run(Samples(stamps, *parts)), truth)
    assert errors[1900:2000].min() > 7.0
    assert errors[5000:].max() < 2.0


def test_at_rest_a_field_that_stays_outweighs_the_first(learning):
    samples, truth = recording(40.0, motion=MOTIONS["rest"])
    samples.mag[:2000] += np.array((4.0, 4.0, 0.0)) * MICRO  # 8° of heading
    errors = errors_deg(learning.run(samples), truth)
    assert errors[2999] < 0.2 * errors[1999]  # at a trust that does not grow 0.27 of it is left


# What an earlier run knew


def test_what_is_known_starts_the_next_run():
    bias = (1.0 * DEGREE, -1.0 * DEGREE, 0.5 * DEGREE)
    samples, truth = recording(60.0, bias=bias, delay=0.012)
    first = filters.make("stateful")
    first.run(samples)
    again = filters.make("stateful", Settings(known=first.known))
    early = Samples(*(part[:500] for part in vars(samples).values()))
    errors = errors_deg(again.run(early), truth[:500])
    assert rms(errors) < 0.5 * rms(errors_deg(first.run(early), truth[:500]))
    assert again.report.mag_delay_s == pytest.approx(0.012, abs=0.002)


@pytest.mark.parametrize("mag_every", [1, 10_000], ids=["nine axes", "six axes"])
def test_a_bias_that_is_known_and_no_longer_true_is_learned_anew_at_rest(mag_every):
    samples, truth = recording(60.0, motion=MOTIONS["rest"], mag_every=mag_every)
    f = filters.make("stateful", Settings(known=Known(bias=(0.0, 0.0, 1.5 * DEGREE))))
    errors = errors_deg(f.run(samples), truth)
    assert errors.max() < (5.0 if mag_every == 1 else 8.0)
    assert abs(f.report.learned_bias_rad_s[2]) < 0.02 * DEGREE
    assert f.report.resting


def test_of_misalignment_and_iron_what_a_motion_or_a_room_may_be_is_not_the_sensors():
    skew = np.array([[0.02, 0.01, 0.0], [0.0, -0.02, 0.01], [0.01, 0.0, 0.02]])
    samples, _ = recording(90.0, misalignment=skew, iron=(10 * MICRO, -8 * MICRO, 6 * MICRO))
    f = filters.make("stateful")
    f.run(samples)
    found = np.array(f.report.misalignment)
    assert np.linalg.norm(found - skew) < 0.5 * np.linalg.norm(skew)
    assert np.linalg.norm(found - f.known.misalignment) < 0.2 * np.linalg.norm(found)
    assert np.array(f.known.hard_iron) == pytest.approx(np.array((10, -8, 6)) * MICRO, rel=0.1)
    samples, _ = recording(90.0, misalignment=0.1 * skew, iron=(MICRO, -MICRO, MICRO))
    f.run(samples)
    assert np.linalg.norm(f.report.misalignment) > 0.002
    assert f.known.misalignment == ((0.0, 0.0, 0.0),) * 3
    assert f.known.hard_iron == (0.0, 0.0, 0.0)


def test_what_was_known_does_not_fade_where_nothing_is_learned_of_it():
    known = Known((0.0, 0.0, 0.0), ((0.02, 0.0, 0.0),) * 3, 0.01, (5 * MICRO, 0.0, 0.0))
    samples, _ = recording(10.0, motion=MOTIONS["rest"], iron=known.hard_iron)
    for _ in range(3):
        f = filters.make("stateful", Settings(known=known))
        f.run(samples)
        known = f.known
    assert np.array(known.misalignment)[:, 0] == pytest.approx([0.02] * 3, abs=1e-4)
    assert known.hard_iron == pytest.approx((5 * MICRO, 0.0, 0.0), abs=0.05 * MICRO)
    assert known.mag_delay == pytest.approx(0.01, abs=1e-3)


@pytest.mark.parametrize("name", ["learn_bias", "learn_misalignment", "learn_mag"])
def test_what_is_not_learned_stays_as_it_was_known(name):
    known = Known((0.01, 0.0, 0.0), ((0.001, 0.0, 0.0),) * 3, 0.01, (MICRO, 0.0, 0.0))
    samples, _ = recording(20.0)
    f = filters.make("stateful", Settings(known=known, **{name: False}))
    f.run(samples)
    found = f.report
    kept = {
        "learn_bias": found.learned_bias_rad_s == known.bias,
        "learn_misalignment": np.array(found.misalignment)
        == pytest.approx(np.array(known.misalignment), abs=1e-12),
        "learn_mag": (found.mag_delay_s, found.hard_iron) == (known.mag_delay, known.hard_iron),
    }
    assert [part for part, same in kept.items() if same] == [name]


# Six axes, slow and dying magnetometers


def test_six_axes_keep_tilt_and_drift_no_faster_than_the_bias_left_over(learning):
    samples, truth = recording(60.0, bias=(0.0, 0.0, 0.3 * DEGREE))
    samples.mag[:] = np.nan
    estimate = learning.run(samples)
    assert inclination_deg(estimate, truth)[500:].max() < 0.5
    assert errors_deg(estimate, truth).max() < 5.0  # 18° without a word about the bias
    assert not learning.report.heading_from_mag
    assert learning.report.heading_stddev_rad == math.inf


def test_a_magnetometer_that_dies_leaves_what_it_taught(learning):
    samples, truth = recording(120.0, bias=(0.5 * DEGREE, 0.0, -0.5 * DEGREE))
    samples.mag[6000:] = np.nan
    alive = learning.run(Samples(*(part[:6000] for part in vars(samples).values())))
    sure = learning.report.heading_stddev_rad
    assert learning.stddev[1] == sure
    estimate = learning.run(samples)
    assert np.array_equal(estimate[:6000], alive)
    assert errors_deg(estimate, truth)[200:].max() < 2.0  # 60 s of 0.5 °/s would be 30°
    assert not learning.report.heading_from_mag
    assert learning.report.heading_stddev_rad > sure
    assert learning.heading_known


@pytest.mark.parametrize("every", [2, 10, 30])
def test_a_slow_magnetometer_is_enough(learning, every):
    samples, truth = recording(40.0, mag_every=every)
    assert rms(errors_deg(learning.run(samples), truth)[1000:]) < 0.6


def test_use_mag_off_ignores_the_magnetometer():
    samples, truth = recording(20.0)
    samples.mag[:] = (0.0, 1.0, 0.0)
    f = filters.make("stateful", Settings(use_mag=False))
    assert errors_deg(f.run(samples), truth).max() < 2.0
    assert not f.heading_known


def test_a_field_along_gravity_is_not_heading(learning):
    for i in range(100):
        learning.update_mag((0.0, 0.0, 4e-5))
        learning.update_imu((0.0, 0.0, 0.0), (0.0, 0.0, 9.81), 0.0 if i == 0 else 0.01)
    assert learning.report.mag_rejected == 100
    assert not learning.heading_known
    assert difference(learning.rotor, IDENTITY) < 1e-9


def test_the_first_heading_comes_at_once_and_leaves_the_tilt_alone(learning):
    truth = from_axis_angle((0.0, 0.0, 1.0), 2.0)
    accel, mag = felt(truth)
    for i in range(300):
        learning.update_imu((0.0, 0.0, 0.0), accel, 0.0 if i == 0 else 0.01)
    assert not learning.heading_known
    for _ in range(20):  # shaken just now: the low-passed up is 2° off
        learning.update_imu((0.0, 0.0, 0.0), (4.0, 0.0, 9.81), 0.01)
    learning.update_mag(mag)
    learning.update_imu((0.0, 0.0, 0.0), accel, 0.01)
    assert learning.heading_known
    assert difference(learning.rotor, truth) < 0.5 * DEGREE
    for _ in range(500):
        learning.update_mag(mag)
        learning.update_imu((0.0, 0.0, 0.0), accel, 0.01)
    assert difference(learning.rotor, truth) < 1.5 * DEGREE  # what the shake still says


@pytest.mark.parametrize("motion", [MOTIONS["rest"], WILD], ids=["rest", "soon in motion"])
def test_the_start_is_a_mean_of_snapshots(learning, motion):
    samples, truth = recording(4.0, motion=motion)
    # of 1.4° for one snapshot (0.6 µT in 25 µT) a weight of 3 / n leaves a ninth after 2 s
    assert errors_deg(learning.run(samples), truth)[200:].max() < 0.6


def test_a_start_in_motion_converges_within_seconds(learning):
    samples, truth = recording(20.0, start=3.3)
    assert errors_deg(learning.run(samples), truth)[500:].max() < 2.0


# One filter, two speeds


def test_sample_by_sample_and_compiled_are_the_same_filter():
    samples, _ = recording(30.0, mag_every=3, bias=(0.01, 0.0, -0.01), delay=0.01)
    samples.accel[700:720] = 0.0
    samples.gyro[900:905] = np.nan
    # 1e-12: the two sum in another order
    one_by_one = live(samples, filters.make("stateful"))
    assert filters.make("stateful").run(samples) == pytest.approx(one_by_one, abs=1e-12)


def test_both_learn_the_same_from_rest_motion_and_another_field():
    bias = (0.004, 0.0, -0.002)
    samples, _ = recording(60.0, bias=bias, misalignment=np.diag((0.01, -0.01, 0.0)))
    samples.gyro[:1200], samples.accel[:1200] = bias, samples.accel[0]  # for one period it rests
    samples.mag[:1200] = samples.mag[0]
    samples.mag[3000:] *= 1.3
    live_one, compiled_one = filters.make("stateful"), filters.make("stateful")
    one_by_one, at_once = live(samples, live_one), compiled_one.run(samples)
    assert at_once == pytest.approx(one_by_one, abs=1e-11)
    said, compiled_said = live_one.report, compiled_one.report
    assert said.field_changes == compiled_said.field_changes > 0
    assert said.learned_bias_rad_s == pytest.approx(bias, abs=1e-3)
    for name in ("learned_bias_rad_s", "misalignment", "hard_iron", "heading_stddev_rad"):
        found = np.array(getattr(compiled_said, name))
        assert found == pytest.approx(np.array(getattr(said, name)), rel=1e-9, abs=1e-15)


def test_an_amendment_after_a_reset_is_nothing(learning):
    learning.update_imu((0.0, 0.0, 0.0), (0.0, 0.0, 9.81), 0.0)
    learning.reset()
    learning.amend_mag((2e-5, 0.0, -4e-5))
    assert not learning.started


# α


def test_of_clean_samples_none_is_rejected(learning):
    samples, _ = recording(10.0)
    learning.run(samples)
    report = learning.report
    assert (report.gyro_rejected, report.accel_rejected, report.mag_rejected) == (0, 0, 0)


def test_alpha_one_is_the_gyroscope_alone_once_started():
    samples, truth = recording(7.0)
    samples.accel[500:], samples.mag[500:] = (0.0, 5.0, 5.0), (1.0, 1.0, 1.0)
    estimate = filters.make("stateful", Settings(alpha=1.0)).run(samples)
    turned = [rotor.product(rotor.conjugate(tuple(estimate[499])), tuple(q)) for q in estimate]
    meant = [rotor.product(rotor.conjugate(truth[499]), q) for q in truth]
    # a wrong up of 45° teaches a wrong bias as well, which does little in a second
    assert errors_deg(turned[500:600], meant[500:600]).max() < 1.0


@pytest.mark.parametrize(
    "settings", [Settings(alpha=0.0), Settings(alpha=0.0, alpha_rate=0.0), Settings(alpha_rate=0.0)]
)
def test_any_alpha_makes_a_filter(settings):
    samples, truth = recording(30.0)
    assert rms(errors_deg(filters.make("stateful", settings).run(samples), truth)[500:]) < 1.0


def test_a_recording_decimated_loses_at_most_5_percent(learning):
    ideal, truth = recording(60.0, rate=300, bias=(0.01, 0.01, -0.01), delay=0.012, noise=0.0)
    ideal.mag[:] += np.array((3.0, -2.0, 1.0)) * MICRO
    random = np.random.default_rng(1)
    scores = {1: [], 2: [], 3: [], 6: []}
    for _ in range(20):  # each by itself is up to a third better or worse
        normal = random.normal(size=(3, len(ideal), 3))
        noisy = Samples(
            ideal.stamps,
            ideal.gyro + 0.1 * DEGREE * normal[0],
            ideal.accel + 0.05 * normal[1],
            ideal.mag + 0.6 * MICRO * normal[2],
        )
        for every, own in scores.items():
            last = slice(every - 1, None, every)
            few = Samples(
                noisy.stamps[last],
                # rates are means over the step, as a gyroscope's own low-pass makes them
                noisy.gyro.reshape(-1, every, 3).mean(axis=1),
                np.ascontiguousarray(noisy.accel[last]),
                np.ascontiguousarray(noisy.mag[last]),
            )
            seen = slice(900 // every, None, 60 // every)
            own.append(rms(errors_deg(learning.run(few)[seen], truth[last][seen])))
    whole, *decimated = (np.mean(own) for own in scores.values())
    assert max(decimated) < 1.05 * whole


@pytest.mark.parametrize("rate", [25, 50, 200])
def test_alpha_means_the_same_at_every_rate(rate):
    # half a radian off by a wrong up that ends at 4 s: see what is left of it 3 s later
    samples, _ = recording(7.01, rate=rate, motion=MOTIONS["rest"])
    samples.accel[: 4 * rate] = 9.81 * np.array((math.sin(0.1), 0.0, math.cos(0.1)))
    samples.mag[:] = np.nan
    last = filters.make("stateful").run(samples)[-1]
    samples, _ = recording(7.01, rate=100, motion=MOTIONS["rest"])
    samples.accel[:400] = 9.81 * np.array((math.sin(0.1), 0.0, math.cos(0.1)))
    samples.mag[:] = np.nan
    same = filters.make("stateful").run(samples)[-1]
    assert difference(tuple(last), tuple(same)) < 0.01


# Bad samples, restarts, long runs

BAD = [0.0, math.nan, math.inf, -math.inf, 1e200, -1e308]


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("sensor", ["gyro", "accel", "mag"])
def test_a_bad_sample_costs_next_to_nothing(learning, sensor, bad):
    samples, truth = recording(8.0)
    whole = learning.run(samples)
    getattr(samples, sensor)[400] = bad
    estimate = learning.run(samples)
    # a rate of 160 °/s taken for 0 loses 1.6°
    assert errors_deg(estimate, [tuple(q) for q in whole])[400:].max() < 2.0
    getattr(samples, sensor)[:50] = bad
    assert errors_deg(learning.run(samples), truth)[250:].max() < 2.0


number = st.floats(allow_nan=True, allow_infinity=True)
triple = st.tuples(number, number, number)
small = st.floats(-20.0, 20.0)
likely = st.tuples(small, small, small)


@given(
    st.lists(
        st.tuples(
            st.one_of(triple, likely),
            st.one_of(triple, likely),
            st.one_of(triple, likely),
            st.one_of(st.floats(0.0, 2.0), st.just(0.0), st.just(0.5)),
        ),
        max_size=60,
    )
)
def test_whatever_comes_in_a_unit_rotor_comes_out(inputs):
    f = StatefulFilter()
    for gyro, accel, mag, dt in inputs:
        f.update_mag(mag)
        q = f.update_imu(gyro, accel, dt)
        assert sum(x * x for x in q) == pytest.approx(1.0, abs=1e-9)


def test_a_restart_keeps_what_was_learned_and_forgets_the_field(learning):
    bias = (1.0 * DEGREE, -1.0 * DEGREE, 0.5 * DEGREE)
    samples, _ = recording(40.0, bias=bias, delay=0.012)
    learning.run(samples)
    before = learning.report
    truth = from_axis_angle((0.0, 0.0, 1.0), 2.5)
    accel, mag = felt(truth)
    mag = tuple(1.5 * value for value in mag)
    last = learning.rotor
    learning.update_mag(mag)
    first = learning.update_imu(bias, accel, 0.0)
    assert difference(first, truth) < 1e-4  # the delay of what is left of the bias
    assert np.dot(first, last) >= 0.0
    for _ in range(300):
        learning.update_mag(mag)
        learning.update_imu(bias, accel, 0.01)
    after = learning.report
    assert after.mag_trust > 0.9
    assert after.learned_bias_rad_s == pytest.approx(before.learned_bias_rad_s, abs=0.05 * DEGREE)
    assert after.mag_delay_s == pytest.approx(before.mag_delay_s, abs=0.002)
    assert difference(learning.rotor, truth) < 1.0 * DEGREE


def test_a_restart_without_a_magnetometer_waits_for_its_own_sample(learning):
    samples, _ = recording(10.3)
    learning.run(samples)
    learning.update_imu((0.0, 0.0, 0.0), (0.0, 0.0, 9.81), 0.0)
    assert not learning.heading_known
    truth = from_axis_angle((0.0, 0.0, 1.0), -2.0)
    accel, mag = felt(truth)
    learning.update_imu((0.0, 0.0, 0.0), accel, 0.01)
    learning.update_mag(mag)
    learning.update_imu((0.0, 0.0, 0.0), accel, 0.01)
    assert difference(learning.rotor, truth) < 0.5 * DEGREE


@pytest.mark.parametrize("lost", [0.1, 0.3, 0.6, 0.9])
def test_in_motion_a_gap_costs_little_and_not_for_long(learning, lost):
    samples, truth = recording(60.0)
    seconds = np.arange(len(samples)) / 100
    kept = (seconds % 10.0 >= lost) | (seconds < 10.0)
    few = Samples(samples.stamps[kept], *(part[kept] for part in _columns(samples)))
    errors = errors_deg(learning.run(few), np.array(truth)[kept])
    after = np.flatnonzero(np.diff(few.stamps) > 20_000_000) + 1
    assert len(after) == 5
    # With the second sample; up to 67 if the rate after it is taken to have been its own.
    assert errors[after + 1].max() < 6.0
    assert errors[after + 300].max() < 3.0


@pytest.mark.parametrize(("alpha", "strength"), [(Settings.alpha, 2.0), (1.0, 1.0)])
def test_a_gap_beside_a_rejected_field_or_at_alpha_1_corrects_no_heading(alpha, strength):
    samples, truth = recording(70.0)
    turned = rotor.from_axis_angle((0.0, 0.0, 1.0), 80.0 * DEGREE)  # from 60 s on
    samples.mag[6000:] = [
        strength * np.array(felt(rotor.product(turned, truth[i]))[1]) for i in range(6000, 7000)
    ]
    kept = np.ones(len(samples), bool)
    kept[6500:6530] = False
    few = Samples(samples.stamps[kept], *(part[kept] for part in _columns(samples)))
    f = filters.make("stateful", Settings(alpha=alpha))
    errors = errors_deg(f.run(few), np.array(truth)[kept])
    assert errors[6550] < errors[6499] + 6.0  # up to 70 if a gap were a new start


def test_rates_that_are_none_for_long_make_unsure_and_teach_nothing(learning):
    samples, truth = recording(60.0)
    samples.gyro[3000:3300] = np.nan
    told = []
    rotors = live(samples, learning, lambda: told.append(learning.stddev))
    tilt, heading = np.degrees(np.array(told).T)
    assert heading[3299] > 3.0 * heading[2999]
    assert tilt[3299] > 1.5 * tilt[2999]
    assert np.abs(learning.bias).max() < 0.1 * DEGREE
    assert errors_deg(rotors, truth)[3700:].max() < 2.0


def test_a_first_field_much_too_weak_does_not_stop_the_learning_of_iron(learning):
    iron = np.array((4.0, -3.0, 4.0)) * MICRO
    samples, _ = recording(120.0, iron=iron)
    samples.mag[:2] *= 1e-3
    learning.run(samples)
    assert learning.report.hard_iron == pytest.approx(iron, abs=1.5 * MICRO)


@pytest.mark.parametrize("lost", [5, 10])
def test_a_glitch_after_a_gap_is_taken_back(learning, lost):
    samples, truth = recording(40.0)
    kept = np.ones(len(samples), bool)
    kept[3000 : 3000 + lost] = False
    few = Samples(samples.stamps[kept], *(part[kept] for part in _columns(samples)))
    few.gyro[3000] = 30.0
    errors = errors_deg(learning.run(few), np.array(truth)[kept])
    assert errors[3003] < 8.0  # up to 157 if what it did with the gap stayed
    assert errors[3300] < 4.0


def test_a_gap_is_told_at_once_and_not_for_ever(learning):
    samples, _ = recording(45.0, bias=(0.01, -0.02, 0.01))
    kept = np.ones(len(samples), bool)
    kept[3000:3050] = False
    few = Samples(samples.stamps[kept], *(part[kept] for part in _columns(samples)))
    told = []
    live(few, learning, lambda: told.append(learning.stddev))
    for deviation in np.array(told).T:
        before, later = deviation[2999], deviation[-1]
        assert min(deviation[3000:3010]) > 1.5 * before
        assert later < 1.3 * before


def test_at_rest_a_gap_makes_a_little_unsure(learning):
    samples, truth = recording(40.0, motion=MOTIONS["rest"])
    kept = np.ones(len(samples), bool)
    kept[3000:3080] = False
    few = Samples(samples.stamps[kept], *(part[kept] for part in _columns(samples)))
    told = []
    errors = errors_deg(
        live(few, learning, lambda: told.append(learning.stddev[1])), np.array(truth)[kept]
    )
    assert errors[3000:].max() < 1.0
    assert 1.3 * told[2999] < told[3002] < 10.0 * DEGREE


def test_samples_that_come_seldom_are_no_gaps():
    assert not any(is_gap(dt, dt) or is_gap(2.0 * dt, dt) for dt in (0.01, 0.1, 0.5))
    assert not is_gap(0.02, 0.002)  # too short for much to happen in it
    assert not is_gap(0.5, 0.0)  # the first step
    assert is_gap(0.035, 0.01)


def test_gaps_and_dropped_samples_are_bridged(learning):
    samples, truth = recording(60.0)
    kept = np.random.default_rng(2).random(len(samples)) > 0.3
    kept[2000:5000] = False  # 30 s without a sample
    few = Samples(*(part[kept] for part in vars(samples).values()))
    errors = errors_deg(learning.run(few), list(itertools.compress(truth, kept)))
    after = int(kept[:5000].sum())
    assert errors[500:after].max() < 2.0
    assert errors[after + 200 :].max() < 2.0


def test_a_day_neither_drifts_nor_grows():
    pytest.importorskip("numba", reason="a day takes ten minutes uncompiled")
    rate, period = 20, 12.0
    samples, truth = recording(period * 10, rate=rate)
    f = StatefulFilter()
    f.run(samples)
    day = 24 * 3600
    passes = round(day / (period * 10)) // 10
    stamps = np.arange(len(samples) * passes) * (1_000_000_000 // rate) + 1_000_000_000
    for _ in range(10):  # the tenth part of a day each, without a new start in between
        many = Samples(stamps, *(np.tile(p, (passes, 1)) for p in _columns(samples)))
        estimate = f.run(many)
    last = estimate[-len(samples) :]
    assert np.abs(np.sum(last**2, axis=1) - 1.0).max() < 1e-9
    assert rms(errors_deg(last, truth)) < 0.5
    assert len(f._memory) == SIZE


def _columns(samples):
    return samples.gyro, samples.accel, samples.mag


# Settings and report


def test_settings_apply_from_the_next_sample(learning):
    samples, _ = recording(10.0)
    live(samples, learning)
    learning.settings = replace(learning.settings, use_mag=False)
    learning.update_mag((0.0, 1.0, 0.0))
    before = learning.rotor
    learning.update_imu((0.0, 0.0, 0.0), tuple(samples.accel[-1].tolist()), 0.01)
    assert difference(learning.rotor, before) < 0.1 * DEGREE
    assert not learning.report.heading_from_mag


def test_rejections_are_counted(learning):
    good = ((0.0, 0.0, 0.0), (0.0, 0.0, 9.81))
    learning.update_imu(*good, 0.0)
    learning.update_imu(NAN, good[1], 0.01)
    learning.update_imu(good[0], (1e5, 0.0, 0.0), 0.01)
    learning.update_mag((0.0, 0.0, 0.0))
    learning.update_imu(*good, 0.01)
    report = learning.report
    assert (report.gyro_rejected, report.accel_rejected, report.mag_rejected) == (1, 1, 1)


def test_who_learns_no_more_keeps_what_was_learned(learning):
    learning.run(recording(20.0, bias=(0.01, -0.01, 0.02))[0])
    before = learning.bias
    names = "learn_bias", "learn_misalignment", "learn_mag", "weigh_mag"
    learning.settings = replace(learning.settings, **dict.fromkeys(names, False))
    learning.settings = replace(learning.settings, alpha=0.99)
    assert before == pytest.approx((0.01, -0.01, 0.02), abs=2e-3)
    assert learning.bias == before
    learning.reset()
    assert learning.bias == (0.0, 0.0, 0.0)
