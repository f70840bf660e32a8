"""A sensor whose truth is known exactly, as a recording and as a table."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from stateful_ahrs.filters.frames import WorldFrame
from stateful_ahrs.recordings import Recording
from stateful_ahrs.rotor import IDENTITY, conjugate, product, rotate

START = 1_000_000_000  # ns
STEP = 10_000_000  # ns
FIELD_NWU = (2e-5, 0.0, -4e-5)  # tesla


def turning(rows: int = 300, name: str = "turning", level: float = 0.6) -> Recording:
    """A sensor without noise that turns at 1 rad/s about an axis whose level part wanders."""
    q, gyro, accel, mag, truth = IDENTITY, [], [], [], []
    enu = WorldFrame("enu")
    for n in range(rows):
        rate = (level * math.cos(0.01 * n), level * math.sin(0.01 * n), math.sqrt(1.0 - level**2))
        if n:
            half = 0.5e-9 * STEP
            angle = math.sin(half)
            q = product(q, (math.cos(half), *(angle * part for part in rate)))
        back = conjugate(q)
        gyro.append(rate)
        accel.append(rotate(back, (0.0, 0.0, 9.81)))
        mag.append(rotate(back, FIELD_NWU))
        truth.append(enu.update(q))
    stamps = START + STEP * np.arange(rows, dtype=np.int64)
    return Recording(
        name=name,
        stamps=stamps,
        gyro=np.array(gyro),
        accel=np.array(accel),
        mag_stamps=stamps,
        mag=np.array(mag),
        reference_stamps=stamps,
        reference=np.array(truth),
    )


def write_csv(path: Path, recording: Recording, groups: str = "gamq") -> str:
    """A CSV of the streams named by letter: gyro, accel, mag, quaternion."""
    columns = {
        "g": ("gx,gy,gz", recording.gyro),
        "a": ("ax,ay,az", recording.accel),
        "m": ("mx,my,mz", recording.mag),
        "q": ("qw,qx,qy,qz", recording.reference),
    }
    rows = np.hstack([columns[group][1] for group in groups])
    with path.open("w") as file:
        print("stamp_ns", *(columns[group][0] for group in groups), sep=",", file=file)
        for stamp, row in zip(recording.stamps.tolist(), rows.tolist(), strict=True):
            cells = ("" if math.isnan(cell) else repr(cell) for cell in row)
            print(stamp, *cells, sep=",", file=file)
    return str(path)
