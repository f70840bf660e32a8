"""Recordings as plain tables."""

from __future__ import annotations

import csv
from array import array
from collections.abc import Iterator
from decimal import Decimal
from operator import itemgetter
from pathlib import Path

import numpy as np

from ..errors import RecordingError
from ..words import counted
from .recording import START, Recording

GYRO, ACCEL, MAG = ("gx", "gy", "gz"), ("ax", "ay", "az"), ("mx", "my", "mz")
ROTOR = ("qw", "qx", "qy", "qz")
EXPECTED = "stamp_ns or t, gx, gy, gz, ax, ay, az and, if known, mx, my, mz and qw, qx, qy, qz"


def load_csv(path: Path, name: str) -> Recording:
    """Read comma-separated values under a header, one row for each inertial sample.

    ``stamp_ns`` (ns, whole) or ``t`` (s, of any origin); ``gx, gy, gz`` rad/s; ``ax, ay, az``
    m/s²; optional ``mx, my, mz`` tesla and ``qw, qx, qy, qz``, the reference, sensor → ENU. An
    empty cell is NaN; three of the magnetometer or four of the reference: no sample in this row.
    Other columns are left out. Times ``t`` that do not begin above zero are moved to begin at
    one second, because a stamp of zero means "unset" in ROS.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            return _read(csv.reader(file), path.name, name)
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(f"{path.name} is not comma-separated text ({error}).") from None


def _read(reader: Iterator[list[str]], file: str, name: str) -> Recording:
    header = [cell.strip() for cell in next(reader, [])]
    clock = next((key for key in ("stamp_ns", "t") if key in header), None)
    groups = [g for g in (GYRO, ACCEL, MAG, ROTOR) if g in (GYRO, ACCEL) or set(g) & set(header)]
    keys = [key for group in groups for key in group]
    missing = [key for key in keys if key not in header]
    if clock is None or missing:
        lacking = ", ".join(([] if clock else ["stamp_ns or t"]) + missing)
        raise RecordingError(
            f"{file} lacks {lacking}; its header is {','.join(header)[:200] or 'empty'!r}, "
            f"expected {EXPECTED}."
        )
    stamps, cells = array("q"), array("d")
    pick = itemgetter(*(header.index(key) for key in keys))
    at = header.index(clock)
    for line, row in enumerate(reader, start=2):
        if not row:
            continue
        try:
            stamps.append(int(row[at]) if clock == "stamp_ns" else round(Decimal(row[at]) * 10**9))
            cells.extend([float(cell or "nan") for cell in pick(row)])
        except IndexError:
            raise RecordingError(
                f"{file}, line {line}: {counted(len(row), 'cell')}, expected {len(header)}."
            ) from None
        except (ValueError, ArithmeticError):
            raise RecordingError(f"{file}, line {line}: {_odd(row, header, keys, clock)}") from None
    if not stamps:
        raise RecordingError(f"{file} has a header and no rows.")

    times = np.array(stamps, dtype=np.int64)
    if times.min() <= 0:
        if clock == "stamp_ns":
            raise RecordingError(f"{file}: stamp_ns must be above zero, got {times.min()}.")
        times += START - times.min()
    values = np.array(cells).reshape(len(times), len(keys))
    received = times[0] + np.cumsum(np.diff(times, prepend=times[0]).clip(min=0))  # in row order
    columns = {group: values[:, [keys.index(key) for key in group]] for group in groups}
    mag = columns.get(MAG, np.full((len(times), 3), np.nan))
    sensed = ~np.isnan(mag).all(axis=1)
    rotors = columns.get(ROTOR, np.full((len(times), 4), np.nan))
    known = ~np.isnan(rotors).all(axis=1)
    told = bool(known.any())
    return Recording(
        name=name,
        stamps=times,
        gyro=columns[GYRO],
        accel=columns[ACCEL],
        mag_stamps=times[sensed],
        mag=mag[sensed],
        reference_stamps=times[known] if told else None,
        reference=rotors[known] if told else None,
        received=received,
        mag_received=received[sensed],
        reference_received=received[known] if told else None,
        left_out=tuple(key for key in header if key not in (*keys, clock)),
    )


def _odd(row: list[str], header: list[str], keys: list[str], clock: str) -> str:
    """Say which cell is not what it should be."""
    for key, kind in [(clock, int if clock == "stamp_ns" else float), *((k, float) for k in keys)]:
        cell = row[header.index(key)]
        try:
            kind(cell or ("nan" if key != clock else ""))
        except ValueError:
            whole = "a whole number of ns" if kind is int else "a number"
            return f"{key} is {cell!r}, expected {whole}."
    return f"{clock} is {row[header.index(clock)]!r}, which is no time."
