"""A calibration changes what it names, and its file is read back as it was, or refused."""

from __future__ import annotations

import os
import stat
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stateful_ahrs.filters.settings import Known
from stateful_ahrs.mpu9250.burst import Reading
from stateful_ahrs.mpu9250.calibration import Calibration, CalibrationError, Correction

yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")

from strategies import vectors

from stateful_ahrs.mpu9250.calibration_file import load, merged, save, save_learned

GOLDEN = Path(__file__).parent / "golden" / "calibration.yaml"
WHOLE = Calibration(
    sensor="imu_link",
    gyro=Correction(
        offset=(0.0125, -0.02, 0.003),
        date="2026-03-01T10:00:00+00:00",
        temperature=31.5,
        quality={"samples": 1000, "seconds": 5.0, "spread_deg_s": 0.17},
    ),
    accel=Correction(
        offset=(0.5, -0.25, 0.125),
        matrix=((1.01, 0.002, 0.0), (0.002, 0.98, -0.001), (0.0, -0.001, 1.0)),
        date="2026-03-01T10:05:00+00:00",
        temperature=32.0,
        quality={"positions": 9, "residual_percent": 0.05, "condition": 1.9},
    ),
    mag=Correction(
        offset=(0.00015, -0.00011, 7.5e-05),
        matrix=((1.1, 0.03, -0.02), (0.03, 0.93, 0.04), (-0.02, 0.04, 0.98)),
        date="2026-03-01T10:10:00+00:00",
        quality={"samples": 3200, "coverage_percent": 91.7, "condition": 3.77},
    ),
)
READING = Reading((0.1, 0.2, 0.3), (1.0, 2.0, 9.0), 25.0, (2e-5, 0.0, -4e-5), False, ("gyro x",))


def test_without_corrections_a_reading_stays_as_it_is():
    assert Calibration().apply(READING) == READING


def test_each_sensor_gets_its_own_correction_and_the_rest_of_the_reading_stays():
    corrected = WHOLE.apply(READING)
    assert corrected.gyro == pytest.approx((0.0875, 0.22, 0.297))
    assert corrected.accel == pytest.approx((0.5095, 2.197125, 8.87275))
    assert corrected.mag == pytest.approx(
        (
            1.1 * -1.3e-4 + 0.03 * 1.1e-4 - 0.02 * -1.15e-4,
            0.03 * -1.3e-4 + 0.93 * 1.1e-4 + 0.04 * -1.15e-4,
            -0.02 * -1.3e-4 + 0.04 * 1.1e-4 + 0.98 * -1.15e-4,
        )
    )
    assert corrected[2:3] + corrected[4:] == READING[2:3] + READING[4:]


def test_a_reading_without_a_magnetometer_stays_without_one():
    assert WHOLE.apply(READING._replace(mag=None)).mag is None


def test_the_golden_file_is_what_is_written_and_what_is_read(tmp_path: Path):
    save(WHOLE, tmp_path / "calibration.yaml")
    assert (tmp_path / "calibration.yaml").read_text() == GOLDEN.read_text()
    assert load(GOLDEN) == WHOLE


@given(vectors(1e3), vectors(1e-4), st.text(max_size=20), st.text(max_size=20))
def test_what_is_written_is_read_back_exactly(tmp_path_factory, bias, iron, sensor, date):
    path = tmp_path_factory.mktemp("yaml") / "c.yaml"
    before = Calibration(sensor, gyro=Correction(bias, date=date), mag=Correction(iron))
    save(before, path)
    assert load(path) == before


def test_a_new_correction_takes_the_place_of_the_sensors_own_and_of_no_other(tmp_path: Path):
    path = tmp_path / "c.yaml"
    save(WHOLE, path)
    new = Correction((1e-5, 0.0, 0.0))
    after = merged(path, "", mag=new)
    assert after == Calibration("imu_link", WHOLE.gyro, WHOLE.accel, new)


def test_merging_into_no_file_is_a_beginning(tmp_path: Path):
    new = Correction((0.1, 0.0, 0.0))
    assert merged(tmp_path / "none.yaml", "board", gyro=new) == Calibration("board", gyro=new)


def test_others_may_read_the_file_and_no_draft_is_left(tmp_path: Path):
    save(WHOLE, tmp_path / "c.yaml")
    assert stat.S_IMODE((tmp_path / "c.yaml").stat().st_mode) == 0o644
    assert os.listdir(tmp_path) == ["c.yaml"]


MAG = "magnetometer: {hard_iron: [0, 0, 0], soft_iron: "


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "must map .*accelerometer.* got None"),
        ("just words", "must map .* got 'just words'"),
        ("[1, 2]", r"must map .* got \[1, 2\]"),
        ("a: [1", "is not YAML"),
        ("\x00", "is not YAML"),
        ("&a [*a]", "must map"),
        ("gyroscope: {bias: !!python/tuple [1, 2, 3]}", "is not YAML"),
        ("gyro: {bias: [0, 0, 0]}", "unknown key 'gyro'; known: accelerometer, gyroscope"),
        ("3: {}", "unknown key 3"),
        ("gyroscope: 3", "gyroscope must map .* got 3"),
        ("gyroscope: {}", "gyroscope lacks bias"),
        ("gyroscope: {bias: [0, 0, 0], matrix: []}", "unknown key 'matrix'"),
        ("gyroscope: {bias: [0, 0]}", r"gyroscope.bias must be a list of three .* got \[0, 0\]"),
        ("gyroscope: {bias: 1.0}", "must be a list of three numbers, got 1.0"),
        ("gyroscope: {bias: [0, 0, x]}", "must be a number, got 'x'"),
        ("gyroscope: {bias: [0, 0, 1e-5]}", "got '1e-5': YAML wants a dot"),
        ("gyroscope: {bias: [0, 0, true]}", "must be a number, got True"),
        ("gyroscope: {bias: [0, 0, .nan]}", "must be a finite number, got nan"),
        ("gyroscope: {bias: [0, 0, .inf]}", "must be a finite number, got inf"),
        ("gyroscope: {bias: [0, 0, 0], temperature: warm}", "temperature must be a number"),
        ("gyroscope: {bias: [0, 0, 0], date: 2026-03-01}", "date must be a text, .* in quotes"),
        ("gyroscope: {bias: [0, 0, 0], quality: {n: []}}", "quality.n must be a number"),
        ("sensor: 7", "sensor must be a text, got 7"),
        (MAG + "[1, 2, 3]}", r"list of three numbers, got 1"),
        (MAG + "[[1, 0, 0], [0, 1, 0]]}", "must be three rows of three"),
        (MAG + "[[1, 0, 0], [0, 1, 0], [0, 1, 0]]}", "soft_iron is singular"),
        (MAG + "[[0, 0, 0], [0, 0, 0], [0, 0, 0]]}", "soft_iron is singular"),
        (MAG + "[[1, 0, 0], [0, 1, 0], [0, 0, -1]]}", "soft_iron mirrors"),
    ],
)
def test_a_file_that_is_none_is_refused_in_one_sentence(tmp_path: Path, text: str, sentence: str):
    path = tmp_path / "c.yaml"
    path.write_text(text)
    with pytest.raises(CalibrationError, match=sentence) as refused:
        load(path)
    assert str(refused.value).startswith(str(path))
    assert "\n" not in str(refused.value)


def test_bytes_that_are_no_text_are_refused(tmp_path: Path):
    path = tmp_path / "c.yaml"
    path.write_bytes(b"\xff\xfe\xfa\x80")
    with pytest.raises(CalibrationError, match="is not YAML"):
        load(path)


def test_a_missing_file_says_what_writes_it(tmp_path: Path):
    with pytest.raises(CalibrationError, match=r"no such file; `calibrate gyro\|accel\|mag -o"):
        load(tmp_path / "none.yaml")


def test_a_folder_is_no_file(tmp_path: Path):
    with pytest.raises(CalibrationError, match="cannot be read: Is a directory"):
        load(tmp_path)


def test_a_place_that_does_not_exist_cannot_be_written(tmp_path: Path):
    with pytest.raises(CalibrationError, match="cannot be written: No such file"):
        save(WHOLE, tmp_path / "none" / "c.yaml")


def test_corrections_turn_vectors_as_matrices_do():
    x, y, z = Correction((1.0, 2.0, 3.0), WHOLE.mag.matrix).apply((2.0, 2.0, 3.0))
    assert (x, y, z) == (1.1, 0.03, -0.02)


LEARNED = Known((0.01, -0.02, 0.003), ((0.001, 0.0, 0.0),) * 3, 0.012, (1e-6, 2e-6, -3e-6))


def test_what_a_filter_learned_comes_back_and_leaves_the_corrections_alone(tmp_path: Path):
    path = tmp_path / "imu.yaml"
    path.write_bytes(GOLDEN.read_bytes())
    save_learned(path, LEARNED)
    found = load(path)
    assert found.learned == LEARNED
    assert found.learned_date
    assert replace(found, learned=Known(), learned_date="") == load(GOLDEN)


def test_a_file_may_begin_with_what_a_filter_learned(tmp_path: Path):
    save_learned(tmp_path / "imu.yaml", LEARNED)
    assert load(tmp_path / "imu.yaml").learned == LEARNED


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("bias", (0.0, 0.0, -0.6)),
        ("misalignment", ((0.0, 0.11, 0.0),) * 3),
        ("mag_delay", 0.2),
        ("hard_iron", (0.0, 2e-3, 0.0)),
        ("hard_iron", (0.0, float("nan"), 0.0)),
    ],
)
def test_what_no_sensor_can_be_is_neither_saved_nor_loaded(tmp_path: Path, key, value):
    path = tmp_path / "imu.yaml"
    with pytest.raises(CalibrationError, match="beyond any sensor's"):
        save_learned(path, replace(LEARNED, **{key: value}))
    assert not path.exists()
    path.write_text("learned: {magnetometer_delay: 99.0}")
    with pytest.raises(CalibrationError, match=r"imu.yaml: learned.magnetometer_delay is beyond"):
        load(path)


def test_a_new_correction_voids_the_offset_that_was_left_over_from_the_old(tmp_path: Path):
    path = tmp_path / "imu.yaml"
    save_learned(path, LEARNED)
    gyro, mag = merged(path, "", gyro=Correction((0.1, 0.0, 0.0))), merged(path, "", mag=WHOLE.mag)
    assert gyro.learned == replace(LEARNED, bias=(0.0, 0.0, 0.0))
    assert mag.learned == replace(LEARNED, hard_iron=(0.0, 0.0, 0.0))
