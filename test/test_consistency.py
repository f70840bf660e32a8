"""Ranking α where no truth is known, on simulated sensors whose truth is."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from turning import FIELD_NWU, START, turning

from stateful_ahrs.evaluation import consistency
from stateful_ahrs.evaluation.best import CONSISTENCY, best_alphas
from stateful_ahrs.evaluation.consistency import AHEAD, EVERY, snapshots_ahead
from stateful_ahrs.evaluation.options import sweep
from stateful_ahrs.evaluation.score import prepare, scores
from stateful_ahrs.filters.frames import WorldFrame
from stateful_ahrs.filters.stateful import Settings
from stateful_ahrs.recordings import Recording, load
from stateful_ahrs.rotor import IDENTITY, conjugate, difference, from_axis_angle, product, rotate

RATE = 100  # Hz
SWEEP = "0.9:0.9999:16"
BROAD = Path(__file__).parents[2] / "shared" / "data" / "broad"


def moving(shake: float, bias: float, seed: int = 1, seconds: int = 90) -> Recording:
    """A sensor that tumbles, shaken by ``shake`` m/s² for tenths of a second at a time.

    Its gyroscope has a bias of ``bias`` rad/s about each axis; all sensors have noise.
    """
    random = np.random.default_rng(seed)
    n = seconds * RATE
    noise = random.normal(size=(n, 6))
    slow, quick = math.exp(-1.0 / RATE), math.exp(-1.0 / (0.2 * RATE))
    rate, push = np.zeros(3), np.zeros(3)
    q, gyro, accel, mag, truth = IDENTITY, [], [], [], []
    enu = WorldFrame("enu")
    for row in noise:
        rate = slow * rate + math.sqrt(1.0 - slow**2) * row[:3]
        push = quick * push + math.sqrt(1.0 - quick**2) * row[3:]
        speed = float(np.linalg.norm(rate))
        q = product(q, from_axis_angle(tuple((rate / speed).tolist()), speed / RATE))
        back = conjugate(q)
        up = shake * push + (0.0, 0.0, 9.81)
        gyro.append(rate + bias + 0.005 * random.normal(size=3))
        accel.append(rotate(back, tuple(up.tolist())) + 0.1 * random.normal(size=3))
        mag.append(rotate(back, FIELD_NWU) + 5e-7 * random.normal(size=3))
        truth.append(enu.update(q))
    stamps = START + 10**9 // RATE * np.arange(n, dtype=np.int64)
    return Recording(
        name="moving",
        stamps=stamps,
        gyro=np.array(gyro),
        accel=np.array(accel),
        mag_stamps=stamps,
        mag=np.array(mag),
        reference_stamps=stamps,
        reference=np.array(truth),
    )


def blind(recording: Recording) -> Recording:
    return replace(recording, reference_stamps=None, reference=None)


def swept(recording: Recording):
    settings = [Settings(alpha=alpha) for alpha in sweep(SWEEP)]
    return list(scores(prepare(recording), "paper", settings))


SHAKEN = moving(shake=3.0, bias=0.0)
DRIFTING = moving(shake=0.5, bias=0.03)
BOTH = moving(shake=3.0, bias=0.03)


@pytest.mark.parametrize("recording", [SHAKEN, DRIFTING, BOTH], ids=["shaken", "drifting", "both"])
def test_the_alpha_found_without_a_truth_errs_little_more_than_the_best(recording):
    told = {result.alpha: result.rmse.total for result in swept(recording)}
    (best,) = best_alphas(swept(blind(recording)))
    assert best.by == CONSISTENCY
    assert min(told) < best.alpha < max(told)
    # Neighbours in this sweep differ by a factor of 1.6 in their time constant.
    assert told[best.alpha] < 1.15 * min(told.values())
    assert max(told.values()) > 2.0 * min(told.values())  # so a blind guess would show


@pytest.mark.skipif(not BROAD.is_dir(), reason="the BROAD trials are not beside the checkout")
def test_on_broad_the_alpha_found_without_the_truth_errs_little_more_than_the_best():
    pytest.importorskip("scipy")
    best, found = [], []
    for path in sorted(BROAD.glob("*.mat"))[::3]:
        recording = load(path)
        told = {result.alpha: result.rmse.total for result in swept(recording)}
        (chosen,) = best_alphas(swept(replace(blind(recording), movement=None)))
        best.append(min(told.values()))
        found.append(told[chosen.alpha])
    assert np.mean(found) < 1.1 * np.mean(best)


def test_shaking_asks_for_a_longer_time_constant_than_drift():
    (shaken,), (drifting,) = (best_alphas(swept(blind(r))) for r in (SHAKEN, DRIFTING))
    assert shaken.time_constant > 3.0 * drifting.time_constant


def test_the_innovation_of_the_very_next_sample_would_follow_the_shaking(monkeypatch):
    monkeypatch.setattr(consistency, "AHEAD", 1.0 / RATE)
    found = swept(blind(SHAKEN))
    worst = min(found, key=lambda result: result.innovation)
    assert worst.alpha == min(result.alpha for result in found)


def test_without_noise_the_snapshots_ahead_are_the_truth():
    recording = turning(1000)
    found = snapshots_ahead(prepare(recording).samples)
    rows = np.flatnonzero(found.counts)
    assert len(rows) == pytest.approx((1000 / RATE - AHEAD) / EVERY, abs=2)
    for row in rows.tolist():
        # The gyroscope's rates, at the end of their steps, drift by this in the time ahead.
        apart = difference(tuple(found.rotors[row]), tuple(recording.reference[row]))
        assert apart < math.radians(0.1)


def test_a_magnetometer_that_is_missing_leaves_the_inclination_to_rank_by():
    recording = turning(1000)
    none = replace(blind(recording), mag_stamps=recording.mag_stamps[:0], mag=recording.mag[:0])
    for result in swept(none):
        assert result.innovation < 0.1  # degrees; the heading, from any angle, is far off


def test_what_is_not_finite_is_left_out():
    recording = blind(turning(1000))
    whole = [result.innovation for result in swept(recording)]
    recording.accel[300:340] = recording.mag[500:520] = np.nan
    recording.gyro[700] = np.nan
    # A tenth of a second is 0.1 rad of the way that the mean is taken along.
    assert [result.innovation for result in swept(recording)] == pytest.approx(whole, abs=0.3)


def test_no_snapshot_is_taken_across_a_new_start():
    recording = blind(turning(1000))
    stamps = recording.stamps + np.where(np.arange(1000) < 500, 0, 60 * 10**9)
    samples = prepare(replace(recording, stamps=stamps, mag_stamps=stamps)).samples
    rows = np.flatnonzero(snapshots_ahead(samples).counts)
    before_the_gap = rows[rows < 500]
    assert before_the_gap.max() <= 500 - AHEAD * RATE
    assert rows.max() <= 1000 - AHEAD * RATE
    assert (rows >= 500).any()


def test_a_recording_shorter_than_the_time_ahead_ranks_nothing():
    found = swept(blind(turning(200)))
    assert {result.innovation for result in found} == {None}
    assert best_alphas(found) == []
