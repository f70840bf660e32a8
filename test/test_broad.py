"""BROAD trials in, and the same out as bags."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from stateful_ahrs.errors import RecordingError
from stateful_ahrs.recordings import load, samples, write

savemat = pytest.importorskip("scipy.io").savemat

DATA = Path(__file__).parents[2] / "shared" / "data"
TRIALS = sorted((DATA / "broad").glob("*.mat"))
PHIDGETS = DATA / "bags" / "phidgets_imu_upside_down.bag"


def trial(rows: int = 20) -> dict[str, np.ndarray]:
    """The variables of a trial, as they are named and shaped there."""
    random = np.random.default_rng(3)
    rotors = random.normal(size=(rows, 4))
    rotors[:3] = np.nan
    return {
        "imu_gyr": random.normal(size=(rows, 3)),
        "imu_acc": random.normal(size=(rows, 3)),
        "imu_mag": 40.0 * random.normal(size=(rows, 3)),
        "opt_quat": rotors,
        "opt_pos": random.normal(size=(rows, 3)),
        "movement": (np.arange(rows)[:, None] // 7 == 1).astype(np.uint8),
        "sampling_rate": np.array([[2000 / 7]]),
        "info": np.array(["a trial"]),
    }


def test_a_trial_is_read_in_si_units(tmp_path):
    variables = trial()
    savemat(tmp_path / "walk.mat", variables)
    found = load(tmp_path / "walk.mat")
    assert found.name == "walk"
    assert np.array_equal(found.gyro, variables["imu_gyr"])
    assert np.array_equal(found.accel, variables["imu_acc"])
    # 1e-6 is not a binary fraction: one rounding.
    assert np.allclose(found.mag, variables["imu_mag"] / 1e6, rtol=1e-15, atol=0.0)
    assert np.array_equal(found.reference, variables["opt_quat"], equal_nan=True)
    assert found.movement.tolist() == [False] * 7 + [True] * 7 + [False] * 6
    assert np.all(np.diff(found.stamps) == 3_500_000)
    assert found.stamps[0] > 0
    assert np.array_equal(samples(found).mag, found.mag)


def test_stamps_follow_the_rate_without_drift(tmp_path):
    variables = trial() | {"sampling_rate": np.array([[300.0]])}
    savemat(tmp_path / "walk.mat", variables)
    found = load(tmp_path / "walk.mat").stamps
    assert np.array_equal(found - found[0], np.rint(np.arange(20) * 1e9 / 300).astype(np.int64))


def refusal(path: Path) -> str:
    with pytest.raises(RecordingError) as error:
        load(path)
    assert path.name in str(error.value)
    return str(error.value)


def test_another_matlab_file_says_what_was_found_and_expected(tmp_path):
    savemat(tmp_path / "other.mat", {"gain": 3.0, "names": ["a"]})
    assert refusal(tmp_path / "other.mat") == (
        "other.mat is not a BROAD trial: it holds gain, names; "
        "expected imu_gyr, imu_acc, imu_mag, opt_quat, movement, sampling_rate."
    )


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("imu_acc", np.zeros((19, 3)), r"imu_acc must be numbers of shape \(20, 3\), got float64"),
        ("imu_gyr", np.zeros((0, 3)), r"imu_gyr must be numbers of shape \(n, 3\)"),
        ("imu_gyr", 5.0, r"imu_gyr must be numbers of shape \(1, 3\), got .* shape \(1, 1\)"),
        ("opt_quat", np.zeros((20, 3)), r"opt_quat must be numbers of shape \(20, 4\)"),
        ("imu_mag", ["text"] * 20, r"imu_mag must be numbers"),
        ("movement", {"a": 1}, r"movement must be numbers"),
        ("sampling_rate", 0.0, r"sampling_rate must be one positive number of Hz"),
        ("sampling_rate", np.nan, r"sampling_rate must be one positive number of Hz"),
        ("sampling_rate", [1.0, 2.0], r"sampling_rate must be one positive number of Hz"),
    ],
)
def test_a_trial_with_a_wrong_variable_is_refused(tmp_path, name, value, sentence):
    savemat(tmp_path / "walk.mat", trial() | {name: value})
    assert re.search(sentence, refusal(tmp_path / "walk.mat"))


def test_a_matlab_7_3_file_says_how_to_save_it(tmp_path):
    header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM"
    (tmp_path / "new.mat").write_bytes(header.ljust(512, b"\0") + b"\x89HDF\r\n\x1a\n" + bytes(99))
    assert "new.mat is MATLAB 7.3 (HDF5)" in refusal(tmp_path / "new.mat")


def test_a_trial_cut_short_is_refused(tmp_path):
    savemat(tmp_path / "whole.mat", trial(2000), do_compression=True)
    data = (tmp_path / "whole.mat").read_bytes()
    for n in range(1, 40):
        (tmp_path / "cut.mat").write_bytes(data[: len(data) * n // 40])
        refusal(tmp_path / "cut.mat")


@pytest.mark.skipif(not TRIALS, reason="the BROAD trials are not here")
@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_real_trial_comes_back_from_its_bag_bit_for_bit(tmp_path, storage):
    pytest.importorskip("rosbags")
    out = load(TRIALS[0])
    write(out, tmp_path / "bag", storage)
    found = load(tmp_path / "bag")
    known = ~np.isnan(out.reference).any(axis=1)
    assert np.array_equal(found.stamps, out.stamps)
    assert np.array_equal(found.gyro, out.gyro)
    assert np.array_equal(found.accel, out.accel)
    assert np.array_equal(found.mag, out.mag)
    assert np.array_equal(samples(found).mag, out.mag)
    assert np.array_equal(found.reference_stamps, out.stamps[known])
    assert np.array_equal(found.reference, out.reference[known])
    assert np.array_equal(found.movement, out.movement[known])


@pytest.mark.skipif(not TRIALS, reason="the BROAD trials are not here")
@pytest.mark.parametrize("path", TRIALS, ids=str)
def test_a_real_trial_has_the_physics_of_one(path):
    found = load(path)
    assert len(found) > 40_000 and len(found.mag) == len(found)
    rate = 1e9 / np.diff(found.stamps).mean()
    assert rate == pytest.approx(285.7, abs=0.1)
    at_rest = ~found.movement
    assert np.median(np.linalg.norm(found.accel[at_rest], axis=1)) == pytest.approx(9.8, abs=0.2)
    # The Earth's field in Berlin is 50 µT; indoors and near a magnet it is less or more.
    assert 25e-6 < np.median(np.linalg.norm(found.mag, axis=1)) < 100e-6
    norms = np.linalg.norm(found.reference, axis=1)
    assert np.allclose(norms[~np.isnan(norms)], 1.0, atol=1e-6)


@pytest.mark.skipif(not PHIDGETS.exists(), reason="the ROS 1 bag is not here")
def test_the_upside_down_phidgets_bag_is_read_with_its_holes():
    pytest.importorskip("rosbags")
    found = load(PHIDGETS)
    assert len(found) == len(found.mag) == 13_964
    assert 1e9 / np.median(np.diff(found.stamps)) == pytest.approx(250.0, rel=0.01)
    assert found.accel[:, 2].mean() == pytest.approx(-9.8, abs=0.2)
    assert np.isnan(found.mag).all(axis=1).mean() == pytest.approx(0.5, abs=0.01)
    assert found.reference is None
    rows = samples(found)
    assert len(rows) == len(found)
    # Its recorder took the two topics up to six samples out of step, so that two magnetometer
    # samples sometimes fall to one inertial sample.
    used = np.isfinite(rows.mag).all(axis=1).sum() / np.isfinite(found.mag).all(axis=1).sum()
    assert 0.98 < used <= 1.0
