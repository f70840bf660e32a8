"""Calibrations as YAML."""

from __future__ import annotations

import contextlib
import math
import os
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..filters.settings import NOTHING, Known
from ..rotor import Vector
from .calibration import UNIT, Calibration, CalibrationError, Correction, Matrix, now

WORST_CONDITION = 1e3  # of a matrix; a real one is below 10


class _Section(NamedTuple):
    """What a sensor is called in the file."""

    name: str
    offset: str
    matrix: str | None
    unit: str


SECTIONS = {
    "gyro": _Section("gyroscope", "bias", None, "rad/s"),
    "accel": _Section("accelerometer", "offset", "matrix", "m/s²"),
    "mag": _Section("magnetometer", "hard_iron", "soft_iron", "tesla"),
}
HEADER = """\
# A sensor's calibration (calibration_file). `calibrate` writes what `imu_driver` corrects:
#   angular rate   = raw - bias                      rad/s
#   specific force = matrix (raw - offset)           m/s²
#   magnetic field = soft_iron (raw - hard_iron)     tesla
# `fusion` writes what it learned and corrects itself (learned):
#   angular rate   = (1 + misalignment) (given - bias)
#   magnetic field = given - hard_iron, magnetometer_delay seconds ago
"""
LARGEST = {"bias": 0.5, "misalignment": 0.1, "mag_delay": 0.1, "hard_iron": 1e-3}  # learned, SI
LEARNED = {
    "bias": "bias",
    "misalignment": "misalignment",
    "mag_delay": "magnetometer_delay",
    "hard_iron": "hard_iron",
}  # what they are called in the file


def load(path: Path | str) -> Calibration:
    """Read a file; `CalibrationError` where it is missing or not what `save` writes."""
    path = Path(path)
    yaml = _yaml(f"reading {path}")
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise CalibrationError(
            f"{path}: no such file; `calibrate gyro|accel|mag -o {path}` writes it."
        ) from None
    except OSError as error:
        raise CalibrationError(f"{path} cannot be read: {error.strerror or error}.") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise CalibrationError(f"{path} is not YAML ({reason}).") from None
    try:
        return _calibration(content)
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from None


def exists(path: Path | str) -> bool:
    """Whether there is something at the path; `CalibrationError` where one may not look."""
    try:
        return Path(path).exists()
    except OSError as error:
        raise CalibrationError(f"{path} cannot be read: {error.strerror or error}.") from None


def save(calibration: Calibration, path: Path | str) -> None:
    """Write the file, whole or not at all; `CalibrationError` where that is not possible."""
    path = Path(path)
    yaml = _yaml(f"writing {path}")
    content: dict[str, Any] = {"sensor": calibration.sensor} if calibration.sensor else {}
    for attribute, section in SECTIONS.items():
        correction: Correction = getattr(calibration, attribute)
        if correction != Correction():
            content[section.name] = _entries(section, correction)
    if calibration.learned != NOTHING:
        content["learned"] = {
            **({"date": calibration.learned_date} if calibration.learned_date else {}),
            **{name: _plain(getattr(calibration.learned, key)) for key, name in LEARNED.items()},
        }
    text = HEADER + yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=100)
    try:
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", dir=path.parent, prefix=f".{path.name}.", delete=False
        ) as draft:
            draft.write(text)
        try:
            os.chmod(draft.name, 0o644)
            os.replace(draft.name, path)
        except OSError:
            with contextlib.suppress(OSError):
                os.unlink(draft.name)
            raise
    except OSError as error:
        raise CalibrationError(f"{path} cannot be written: {error.strerror or error}.") from None


def _yaml(purpose: str) -> Any:
    try:
        import yaml  # type: ignore[import-untyped]
    except ModuleNotFoundError:
        raise CalibrationError(
            f"{purpose} needs the Python package PyYAML: install python3-yaml, "
            "or pip install 'stateful_ahrs[calibration]'."
        ) from None
    return yaml


def _entries(section: _Section, correction: Correction) -> dict[str, Any]:
    entries: dict[str, Any] = {}
    if correction.date:
        entries["date"] = correction.date
    entries[section.offset] = list(correction.offset)
    if section.matrix:
        entries[section.matrix] = [list(row) for row in correction.matrix]
    if correction.temperature is not None:
        entries["temperature"] = correction.temperature
    if correction.quality:
        entries["quality"] = dict(correction.quality)
    return entries


def _calibration(content: object) -> Calibration:
    names = {section.name: attribute for attribute, section in SECTIONS.items()}
    entries = _mapping(content, "the file", {"sensor", "learned", *names})
    corrections = {
        attribute: _correction(entries[name], SECTIONS[attribute])
        for name, attribute in names.items()
        if name in entries
    }
    learned, date = NOTHING, ""
    if "learned" in entries:
        learned, date = _learned(entries["learned"])
    sensor = _text(entries.get("sensor", ""), "sensor")
    return Calibration(sensor, **corrections, learned=learned, learned_date=date)


def _learned(content: object) -> tuple[Known, str]:
    entries = _mapping(content, "learned", {"date", *LEARNED.values()})
    vectors = {
        key: _vector(entries[key], f"learned.{key}")
        for key in ("bias", "hard_iron")
        if key in entries
    }
    misalignment = NOTHING.misalignment
    if "misalignment" in entries:
        misalignment = _rows(entries["misalignment"], "learned.misalignment")
    where = "magnetometer_delay"
    delay = float(_number(entries.get(where, 0.0), f"learned.{where}"))
    known = Known(misalignment=misalignment, mag_delay=delay, **vectors)
    _believe(known)
    return known, _text(entries.get("date", ""), "learned.date")


def _believe(known: Known) -> None:
    """Raise a `CalibrationError` where no sensor can be so."""
    for key, most in LARGEST.items():
        if not (found := float(np.abs(getattr(known, key)).max())) <= most:
            raise CalibrationError(
                f"learned.{LEARNED[key]} is beyond any sensor's: {found:g}, at most {most:g}."
            )


def _correction(content: object, section: _Section) -> Correction:
    keys = {"date", section.offset, "temperature", "quality"}
    entries = _mapping(content, section.name, keys | ({section.matrix} - {None}))
    if section.offset not in entries:
        raise CalibrationError(f"{section.name} lacks {section.offset} ({section.unit}).")
    matrix = UNIT
    if section.matrix and section.matrix in entries:
        matrix = _matrix(entries[section.matrix], f"{section.name}.{section.matrix}")
    temperature = entries.get("temperature")
    where = f"{section.name}.quality"
    quality = _mapping(entries.get("quality", {}), where, None)
    return Correction(
        offset=_vector(entries[section.offset], f"{section.name}.{section.offset}"),
        matrix=matrix,
        date=_text(entries.get("date", ""), f"{section.name}.date"),
        temperature=(
            None if temperature is None else _number(temperature, f"{section.name}.temperature")
        ),
        quality={name: _number(value, f"{where}.{name}") for name, value in quality.items()},
    )


def _mapping(content: object, where: str, known: set[Any] | None) -> Mapping[str, Any]:
    if not isinstance(content, dict):
        names = "names" if known is None else ", ".join(sorted(known))
        raise CalibrationError(f"{where} must map {names} to values, got {_short(content)}.")
    odd = [key for key in content if not isinstance(key, str) or (known and key not in known)]
    if odd:
        names = "names" if known is None else ", ".join(sorted(known))
        raise CalibrationError(f"{where} has an unknown key {odd[0]!r}; known: {names}.")
    return content


def _text(value: object, where: str) -> str:
    if not isinstance(value, str):
        raise CalibrationError(f"{where} must be a text, got {_short(value)}: put it in quotes.")
    return value


def _number(value: object, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        hint = ""
        with contextlib.suppress(ValueError, TypeError):
            float(value)  # type: ignore[arg-type]
            hint = ": YAML wants a dot and a sign in it, as in 1.0e-5, and no quotes"
        raise CalibrationError(f"{where} must be a number, got {_short(value)}{hint}.")
    if not abs(value) < 1e300:
        raise CalibrationError(f"{where} must be a finite number, got {value}.")
    return value


def _vector(value: object, where: str) -> Vector:
    if not isinstance(value, list) or len(value) != 3:
        raise CalibrationError(f"{where} must be a list of three numbers, got {_short(value)}.")
    x, y, z = (float(_number(part, where)) for part in value)
    return (x, y, z)


def _rows(value: object, where: str) -> Matrix:
    if not isinstance(value, list) or len(value) != 3:
        raise CalibrationError(f"{where} must be three rows of three numbers, got {_short(value)}.")
    first, second, third = (_vector(row, where) for row in value)
    return (first, second, third)


def _matrix(value: object, where: str) -> Matrix:
    matrix = _rows(value, where)
    condition = float(np.linalg.cond(np.array(matrix)))
    if not (math.isfinite(condition) and condition < WORST_CONDITION):
        raise CalibrationError(f"{where} is singular (condition {condition:.3g}).")
    if np.linalg.det(np.array(matrix)) < 0.0:
        raise CalibrationError(f"{where} mirrors: its determinant is below zero.")
    return matrix


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _plain(value: float | tuple[Any, ...]) -> object:
    # + 0.0: of −0.0 nobody would know what it means
    return [_plain(part) for part in value] if isinstance(value, tuple) else float(value) + 0.0


def merged(path: Path | str, sensor: str, **corrections: Correction) -> Calibration:
    """What is in the file, if there is one, with the corrections given in place of its own.

    What had been left over for a filter to learn is void where it was an offset of these.
    """
    before = load(path) if exists(path) else Calibration()
    learned = before.learned
    if "gyro" in corrections:
        learned = replace(learned, bias=NOTHING.bias)
    if "mag" in corrections:
        learned = replace(learned, hard_iron=NOTHING.hard_iron)
    changed: dict[str, Any] = dict(corrections)
    return replace(before, sensor=sensor or before.sensor, learned=learned, **changed)


def save_learned(path: Path | str, learned: Known) -> None:
    """Put what a filter learned into the file, beside what else is in it.

    `CalibrationError` if no sensor can be so, or the file cannot be read or written.
    """
    _believe(learned)
    before = load(path) if exists(path) else Calibration()
    save(replace(before, learned=learned, learned_date=now()), path)
