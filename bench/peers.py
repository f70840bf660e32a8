"""Other packages' filters, from PyPI, each over a whole recording.

They are run as their documentation says, with their own defaults. Where one needs a convention
told, it is chosen in the peer's favour: the one in which it errs least.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stateful_ahrs.filters.frames import WorldFrame
from stateful_ahrs.filters.samples import Array, Samples

GRAVITY = 9.80665  # m/s²


@dataclass(frozen=True)
class Peer:
    """A filter with what it is tried with; ``run(samples, **options)`` gives rotors (n, 4), ENU."""

    name: str
    package: str
    run: Callable[..., Array]
    sweep: tuple[Mapping[str, Any], ...] = field(default=())  # beside the defaults


def period(samples: Samples) -> float:
    """The usual time step, s."""
    return float(np.median(np.diff(samples.stamps))) * 1e-9


def vqf(samples: Samples, **options: float) -> Array:
    """VQF (Laidig and Seel, 2023), online."""
    import vqf as package

    estimator = package.VQF(period(samples), **options)
    found = estimator.updateBatch(samples.gyro, samples.accel, samples.mag)
    return np.asarray(found["quat9D"])


def vqf_six(samples: Samples, **options: float) -> Array:
    """VQF without a magnetometer."""
    import vqf as package

    found = package.VQF(period(samples), **options).updateBatch(samples.gyro, samples.accel)
    return np.asarray(found["quat6D"])


def imufusion(samples: Samples, **options: float) -> Array:
    """The revised Madgwick filter of x-io."""
    import imufusion as package

    ahrs, settings = package.Ahrs(), package.AhrsSettings()
    settings.convention = package.CONVENTION_ENU
    settings.sample_rate = 1.0 / period(samples)
    for name, value in options.items():
        setattr(settings, name, value)
    ahrs.set_settings(settings)
    gyro, accel, mag = np.degrees(samples.gyro), samples.accel / GRAVITY, samples.mag * 1e6
    rotors = np.empty((len(samples), 4))
    for i in range(len(samples)):
        ahrs.update(gyro[i], accel[i], mag[i])
        rotors[i] = ahrs.get_quaternion()
    return rotors


def madgwick(samples: Samples, **options: float) -> Array:
    """Madgwick (2010) as in ahrs; NWU."""
    return _from_nwu(_ahrs("Madgwick", samples, options))


def mahony(samples: Samples, **options: float) -> Array:
    """Mahony (2008) as in ahrs; ENU."""
    return _ahrs("Mahony", samples, options)


def ekf(samples: Samples, **options: Any) -> Array:
    """The EKF of ahrs, told the dip: NWU where the dip is given as negative and downwards."""
    up = samples.accel / np.linalg.norm(samples.accel, axis=1)[:, None]
    field = samples.mag / np.linalg.norm(samples.mag, axis=1)[:, None]
    sine = float(np.nanmedian(np.einsum("ij,ij->i", up, field)))
    options = {"magnetic_ref": math.degrees(math.asin(sine)), **options}
    return _from_nwu(_ahrs("EKF", samples, options))


def aqua(samples: Samples, **options: Any) -> Array:
    """AQUA (Valenti, 2015) as in ahrs: the conjugate, NWU."""
    return _from_nwu(_ahrs("AQUA", samples, options) * (1.0, -1.0, -1.0, -1.0))


def _ahrs(name: str, samples: Samples, options: Mapping[str, Any]) -> Array:
    import ahrs

    made = getattr(ahrs.filters, name)(
        gyr=samples.gyro,
        acc=samples.accel,
        mag=samples.mag * 1e6,
        frequency=1.0 / period(samples),
        **options,
    )
    return np.asarray(made.Q)


def _from_nwu(rotors: Array) -> Array:
    return WorldFrame("enu").all(np.ascontiguousarray(rotors))


PEERS = (
    Peer(
        "VQF",
        "vqf",
        vqf,
        tuple(
            {"tauAcc": tau_acc, "tauMag": tau_mag}
            for tau_acc in (1.5, 3.0, 6.0)
            for tau_mag in (4.0, 9.0, 15.0, 25.0)
        ),
    ),
    Peer(
        "imufusion",
        "imufusion",
        imufusion,
        tuple(
            {"gain": gain, **rejection}
            for gain in (0.03, 0.1, 0.25, 0.5)
            for rejection in (
                {},
                {
                    "gyroscope_range": 2000.0,
                    "acceleration_rejection": 10.0,
                    "magnetic_rejection": 10.0,
                    "rejection_timeout": 5.0,
                },
            )
        ),
    ),
    Peer("Madgwick", "ahrs", madgwick, tuple({"gain": gain} for gain in (0.005, 0.01, 0.02, 0.08))),
    Peer(
        "Mahony",
        "ahrs",
        mahony,
        tuple({"k_P": k_p, "k_I": k_i} for k_p in (0.1, 0.3) for k_i in (1e-6, 0.03)),
    ),
    Peer(
        "EKF",
        "ahrs",
        ekf,
        tuple({"noises": [0.3**2, (0.5 * k) ** 2, (0.8 * k) ** 2]} for k in (2.0, 5.0, 10.0)),
    ),
    Peer("AQUA", "ahrs", aqua, tuple({"alpha": gain, "beta": gain} for gain in (3e-4, 1e-3, 3e-3))),
)
