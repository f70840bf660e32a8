"""P. J. Rathour and T. S. Pagare, "Sensor Fusion Using Complementary Filter", EE615, 2023."""

from __future__ import annotations

import numpy as np

from ... import filters
from ...filters.frames import WorldFrame
from ...filters.samples import Array
from ...filters.settings import Settings
from ...mpu9250.motion import Motion, Turn, X, Y, Z
from ...rotor import conjugate, euler, product
from ..metrics import Rmse, rmse_deg
from ..score import estimate, prepare
from ..svg import Scale
from .page import MEASURED, Claim, Section, refuted, shown
from .sheet import panel, sheet, thinned
from .simulated import simulated

RATE, SECONDS = 200.0, 24.0
SWING = 0.9  # rad
# As its recording, which is not to be had: swings in pitch, then yaw, then roll.
SWINGS = Motion(
    *(
        Turn(axis, angle, 1.0 + 7.5 * n + start, duration)
        for n, axis in enumerate((Y, Z, X))
        for angle, start, duration in ((SWING, 0, 1.5), (-2 * SWING, 1.5, 3), (SWING, 4.5, 1.5))
    )
)
# Its α is the weight of the accelerometer in each sample.
LERP_ALPHA = Settings(alpha=1.0 - 0.02, alpha_rate=0.0, use_mag=False)
AQUA_ALPHA = Settings(alpha=1.0 - 0.01, alpha_rate=0.0, use_mag=False)
WITH_MAG = {
    "lerp": Settings(alpha=0.98, alpha_rate=0.0),
    "aqua": Settings(alpha=0.99, alpha_rate=0.0),
}


def figure_1() -> Section:
    """The three filters of figure 1, and what two of them are when mended."""
    trial = prepare(simulated(SWINGS, SECONDS, RATE, name="swings"))
    assert trial.truth
    time = 1e-9 * (trial.samples.stamps - trial.samples.stamps[0])
    runs = {
        "(a) the default: `aqua` without magnetometer": ("aqua", AQUA_ALPHA),
        "(b) without correction: `lerp_as_printed`": ("lerp_as_printed", LERP_ALPHA),
        "(c) with correction: `aqua_as_printed`": ("aqua_as_printed", AQUA_ALPHA),
        "(b) mended, nine axes: `lerp`": ("lerp", WITH_MAG["lerp"]),
        "(c) mended, nine axes: `aqua`": ("aqua", WITH_MAG["aqua"]),
    }
    truth = _angles(trial.truth.rotors)
    charts, errors = [], {}
    for title, (name, settings) in runs.items():
        rotors = estimate(trial, filters.make(name, settings))
        errors[title] = rmse_deg(rotors, trial.truth)
        curves = [("", time, column, "grey wide") for column in truth.T] + [
            (angle, time, column, kind)
            for angle, kind, column in zip(
                ("roll", "pitch", "yaw"), "xyz", _angles(rotors).T, strict=True
            )
        ]
        charts.append(
            panel(
                title.replace("`", ""),
                [(n, thinned(t), thinned(v), k) for n, t, v, k in curves],
                Scale(0.0, SECONDS),
                Scale(-90.0, 90.0),
                None,
                [(45.0 * n, f"{45 * n}°".replace("-", "−")) for n in range(-2, 3)],
            )
        )
    default, lerp, listing, lerp_mended, aqua_mended = errors.values()
    return Section(
        "Figure 1: three complementary filters",
        "`rpy_9axis.mat` is MATLAB's and not to be had; as in it the sensor swings in pitch, "
        "yaw and roll, here the simulated chip at 200 Hz. MATLAB's `complementaryFilter` is "
        "closed; in its place stands what it documents, Valenti's filter, with gain 0.01. "
        "Angles in degrees, the truth in grey; errors are RMSE, total (heading, inclination).",
        [
            Claim("(a) default", "", _error(default), MEASURED),
            Claim(
                "(b) LERP, eq. 8–11",
                "somewhat accurate",
                _error(lerp),
                refuted(lerp.heading > 5.0, "ψ = 0 drags yaw to zero"),
            ),
            Claim(
                "(c) AQUA, the listing",
                "highly accurate with correction",
                _error(listing),
                refuted(_never_corrects(), "it never corrects, it is the gyroscope alone"),
            ),
            Claim("(b) mended", "", _error(lerp_mended), shown(lerp_mended.total < 3.0)),
            Claim("(c) mended", "", _error(aqua_mended), shown(aqua_mended.total < 3.0)),
        ],
        figures={"ee615-1": sheet("EE615, figure 1", charts)},
    )


def _error(found: Rmse) -> str:
    total, heading, inclination = found
    return f"{total:.2f}° ({heading:.2f}°, {inclination:.2f}°)"


def _angles(rotors: Array) -> Array:
    """Roll, pitch and yaw (n, 3) in degrees, yaw from north, of rotors in ENU."""
    back = conjugate(WorldFrame("enu").rotor)
    found = [euler(product(back, tuple(q))) for q in rotors.tolist()]
    degrees: Array = np.degrees(found)
    return degrees


def _never_corrects() -> bool:
    """Whether the listing gives the same rotors whichever way the accelerometer points."""
    samples = prepare(simulated(SWINGS, 4.0, RATE)).samples
    one = filters.make("aqua_as_printed", AQUA_ALPHA).run(samples)
    samples.accel[:] = samples.accel[:, ::-1]
    return np.array_equal(one, filters.make("aqua_as_printed", AQUA_ALPHA).run(samples))
