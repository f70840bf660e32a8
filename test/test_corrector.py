"""The driver's corrections: from a file, and the gyroscope's bias on request."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("yaml", reason="PyYAML is not installed")

from stateful_ahrs.filters.rest import MovedError
from stateful_ahrs.mpu9250.burst import Reading
from stateful_ahrs.mpu9250.calibration import Calibration, CalibrationError, Correction
from stateful_ahrs.mpu9250.calibration_file import load, save
from stateful_ahrs.mpu9250.corrector import Corrector
from stateful_ahrs.rotor import Vector

MAG = Correction((1e-5, 0.0, 0.0), date="2026-03-01T10:00:00+00:00")
START = 1_700_000_000_000_000_000  # ns


def reading(gyro: Vector) -> Reading:
    return Reading(gyro, (0.0, 0.0, 9.8), 31.456, (3e-5, 0.0, -4e-5), False, ())


def rest(corrector: Corrector, gyro: Vector, samples: int = 250) -> Reading:
    """Samples at 100 Hz; the last, corrected."""
    for n in range(samples):
        found = corrector.correct(reading(gyro), START + n * 10_000_000)
    return found


def test_without_a_file_nothing_is_changed_and_nothing_is_said_to_be():
    corrector = Corrector("")
    assert corrector.correct(reading((0.1, 0.2, 0.3)), START) == reading((0.1, 0.2, 0.3))
    assert corrector.report["mag_calibrated"] == "no"


def test_a_file_is_applied_and_told(tmp_path: Path):
    path = tmp_path / "c.yaml"
    save(Calibration("board", mag=MAG), path)
    corrector = Corrector(str(path))
    assert corrector.correct(reading((0.0, 0.0, 0.0)), START).mag == pytest.approx((2e-5, 0, -4e-5))
    assert corrector.report == {
        "calibration_file": str(path),
        "calibration_sensor": "board",
        "gyro_calibrated": "no",
        "accel_calibrated": "no",
        "mag_calibrated": MAG.date,
    }


def test_a_missing_file_is_no_driver(tmp_path: Path):
    with pytest.raises(CalibrationError, match="no such file"):
        Corrector(str(tmp_path / "none.yaml"))


def test_the_bias_is_found_in_the_raw_rates_however_often_it_is_asked_for():
    corrector = Corrector("")
    rest(corrector, (0.01, -0.02, 0.03))
    for _ in range(2):
        assert corrector.calibrate_gyro() == (
            "bias +0.010000 -0.020000 +0.030000 rad/s, until the driver ends."
        )
        assert rest(corrector, (0.01, -0.02, 0.03)).gyro == pytest.approx((0, 0, 0), abs=1e-12)


def test_the_bias_goes_into_the_file_and_the_rest_of_it_stays(tmp_path: Path):
    path = tmp_path / "c.yaml"
    save(Calibration("board", mag=MAG), path)
    corrector = Corrector(str(path))
    rest(corrector, (0.01, -0.02, 0.03))
    assert str(path) in corrector.calibrate_gyro()
    written = load(path)
    assert written.gyro.offset == pytest.approx((0.01, -0.02, 0.03))
    assert written.gyro.temperature == 31.46
    assert (written.sensor, written.mag) == ("board", MAG)


def test_a_file_that_is_gone_bad_changes_nothing(tmp_path: Path):
    path = tmp_path / "c.yaml"
    save(Calibration("board", mag=MAG), path)
    corrector = Corrector(str(path))
    rest(corrector, (0.01, -0.02, 0.03))
    path.write_text("gyro: 1")
    with pytest.raises(CalibrationError, match="unknown key"):
        corrector.calibrate_gyro()
    assert path.read_text() == "gyro: 1"
    assert not corrector.calibration.gyro.changes


def test_a_sensor_that_moves_keeps_its_bias():
    corrector = Corrector("")
    rest(corrector, (0.01, -0.02, 0.03))
    corrector.calibrate_gyro()
    rest(corrector, (1.0, 0.0, 0.0))
    with pytest.raises(MovedError):
        corrector.calibrate_gyro()
    assert corrector.calibration.gyro.offset == pytest.approx((0.01, -0.02, 0.03))
