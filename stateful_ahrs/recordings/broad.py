"""BROAD trials in (Laidig, Caruso, Cereatti, Seel, Data 6(7), 2021, doi 10.3390/data6070072)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..errors import RecordingError
from .needs import needed_for
from .recording import START, Recording

SHAPES = {  # of each variable that a trial must have; n rows
    "imu_gyr": 3,  # rad/s
    "imu_acc": 3,  # m/s²
    "imu_mag": 3,  # µT
    "opt_quat": 4,  # w x y z, sensor → ENU; NaN where the cameras lost the body
    "movement": 1,  # 1 in the phases that count
}
RATE = "sampling_rate"  # Hz


def load_broad(path: Path, name: str) -> Recording:
    """Read a BROAD trial; its stamps begin at one second and follow from its sampling rate."""
    variables = _variables(path)
    missing = [key for key in (*SHAPES, RATE) if key not in variables]
    if missing:
        found = ", ".join(key for key in variables if not key.startswith("__")) or "nothing"
        raise RecordingError(
            f"{path.name} is not a BROAD trial: it holds {found}; "
            f"expected {', '.join((*SHAPES, RATE))}."
        )
    rate = variables[RATE]
    if not (_numeric(rate) and rate.size == 1 and 0.0 < rate.item() < 1e6):
        raise RecordingError(f"{path.name}: {RATE} must be one positive number of Hz.")
    columns = {}
    rows = len(np.atleast_1d(variables["imu_gyr"]))
    for key, width in SHAPES.items():
        value = variables[key]
        if not _numeric(value) or value.shape != (rows, width) or rows == 0:
            raise RecordingError(
                f"{path.name}: {key} must be numbers of shape ({rows or 'n'}, {width}), "
                f"got {value.dtype} of shape {value.shape}."
            )
        columns[key] = np.ascontiguousarray(value, dtype=float)
    stamps = START + np.rint(np.arange(rows) * (1e9 / rate.item())).astype(np.int64)
    return Recording(
        name=name,
        stamps=stamps,
        gyro=columns["imu_gyr"],
        accel=columns["imu_acc"],
        mag_stamps=stamps,
        mag=columns["imu_mag"] * 1e-6,
        reference_stamps=stamps,
        reference=columns["opt_quat"],
        movement=columns["movement"][:, 0] > 0.0,
    )


def _variables(path: Path) -> dict[str, Any]:
    with needed_for(f"reading {path.name}"):
        from scipy.io import loadmat  # type: ignore[import-untyped]
    try:
        variables: dict[str, Any] = loadmat(path)
    except NotImplementedError:
        raise RecordingError(
            f"{path.name} is MATLAB 7.3 (HDF5), and BROAD trials are MATLAB 5; "
            "save it in MATLAB with the option '-v7'."
        ) from None
    except Exception as error:  # scipy may meet anything in a file that is not what it says
        reason = " ".join(str(error).split()).rstrip(".") or "it makes no sense"
        raise RecordingError(f"{path.name} is damaged or not a MATLAB file ({reason}).") from None
    return variables


def _numeric(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "fiub"
