"""The calibration at work: readings in, corrected readings out, the gyroscope's bias on request."""

from __future__ import annotations

import math
import threading
from dataclasses import replace

from ..filters.rest import RestWindow
from . import calibration_file
from .burst import Reading
from .calibration import Calibration, Correction, now


class Corrector:
    """Applies the calibration of a file; without one, readings stay raw."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.calibration = calibration_file.load(path) if path else Calibration()
        self._rest = RestWindow()
        self._lock = threading.Lock()  # samples come in one thread, requests in another
        self._stamp = 0
        self._temperature = math.nan

    def correct(self, reading: Reading, stamp: int) -> Reading:
        """The corrected reading; ``stamp`` in ns."""
        with self._lock:
            self._rest.add(reading.gyro, (stamp - self._stamp) * 1e-9)
            self._stamp, self._temperature = stamp, reading.temperature
        return self.calibration.apply(reading)

    def calibrate_gyro(self) -> str:
        """Take the mean rate of the last 2 s for the bias; a sentence on what became of it.

        It is written into the file, if there is one. `MovedError` if the sensor did not rest,
        `CalibrationError` if the file cannot be written: nothing has changed then.
        """
        with self._lock:
            bias, temperature = self._rest.bias(), self._temperature
        warm = round(temperature, 2) if math.isfinite(temperature) else None
        gyro = Correction(bias, date=now(), temperature=warm)
        if self.path:
            calibration_file.save(calibration_file.merged(self.path, "", gyro=gyro), self.path)
        self.calibration = replace(self.calibration, gyro=gyro)
        numbers = " ".join(f"{value:+.6f}" for value in bias)
        where = f"written to {self.path}" if self.path else "until the driver ends"
        return f"bias {numbers} rad/s, {where}."

    @property
    def report(self) -> dict[str, object]:
        """What /diagnostics shows."""
        found = self.calibration
        return {
            "calibration_file": self.path,
            "calibration_sensor": found.sensor,
            **{
                f"{name}_calibrated": (correction.date or "yes") if correction.changes else "no"
                for name, correction in (
                    ("gyro", found.gyro),
                    ("accel", found.accel),
                    ("mag", found.mag),
                )
            },
        }
