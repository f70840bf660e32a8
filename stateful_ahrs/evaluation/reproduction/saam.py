"""J. Wu, Z. Zhou, H. Fourati, Y. Cheng, "A Super Fast Attitude Determination Algorithm", 2018."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from ...filters.frames import WORLD_FRAMES
from ...filters.samples import Array
from ...mpu9250.motion import X, Y, Z, motion
from ...rotor import IDENTITY, conjugate, difference, euler, from_axis_angle, product, rotate
from ...snapshot.aqua import aqua
from ...snapshot.dcm import dcm
from ...snapshot.directions import directions, reference
from ...snapshot.fqa import fqa
from ...snapshot.markley import markley
from ...snapshot.saam import saam
from .counting import ADD, DIVIDE, MULTIPLY, ROOT, TRANSCENDENTAL, Single, numbers, on, operations
from .kusaka import FIELD, FORCE, NORTH, UP, counted
from .page import AS_PRINTED, DIFFERENT, MEASURED, Claim, Section, near, refuted, shown
from .simulated import simulated
from .timing import of_snapshots

SNAPSHOTS: dict[str, Callable[..., Any]] = {
    "SAAM": saam,
    "FQA": fqa,
    "Markley": markley,
    "AQUA": aqua,
}
TABLE_I = {
    "SAAM": (18, 16, 1, 2),
    "FQA": (18, 53, 4, 3, 6),
    "Markley": (33, 51, 3, 4),
    "AQUA": (24, 38, 2, 4),
}
TABLE_II = {
    "SAAM": (49.5, 35.5),
    "FQA": (188.0, 83.0),
    "Markley": (116.5, 85.5),
    "AQUA": (93, 63.5),
}
TABLE_III = {"SAAM": "7.01 / 1.19 / 24.73"} | dict.fromkeys(("FQA", "Markley", "AQUA"), "the same")
TABLE_IV = {"SAAM": 1.77239, "FQA": 11.8861, "Markley": 9.1074, "AQUA": 6.5819}  # µs
CYCLES = {ADD: 1.0, MULTIPLY: 1.0, DIVIDE: 1.5, ROOT: 7.0, TRANSCENDENTAL: 15.0}  # section IV


def given_directions(name: str) -> Counter[str]:
    """The operations of a snapshot that begins with unit vectors."""
    own = operations(SNAPSHOTS[name], FORCE, FIELD)
    return own - operations(directions, FORCE, FIELD) + operations(reference, FORCE, FIELD)


def table_i() -> Section:
    """Operations."""
    counts = {name: given_directions(name) for name in SNAPSHOTS}
    totals = {name: sum(own.values()) for name, own in counts.items()}
    claims = [counted(name, TABLE_I[name], counts[name]) for name in SNAPSHOTS]
    claims.append(
        Claim(
            "least of the four",
            "SAAM",
            min(totals, key=totals.__getitem__),
            shown(min(totals, key=totals.__getitem__) == "SAAM"),
        )
    )
    return Section(
        "Table I: operations",
        "Counted on the kernels of `snapshot/`, from unit vectors on. Where they differ from the "
        "printed ones they also handle what the formulas cannot: half angles that do not cancel, "
        "and the attitudes at which a formula is 0/0.",
        claims,
    )


def cycles(operations: Counter[str]) -> float:
    """Processor cycles without a floating-point unit, as section IV weighs them."""
    return sum(CYCLES[operation] * number for operation, number in operations.items())


def table_ii() -> Section:
    """Time complexities: the printed ones from the printed counts, and those of the kernels."""
    claims = []
    for name, (without, _) in TABLE_II.items():
        printed = Counter(dict(zip(CYCLES, TABLE_I[name], strict=False)))
        own = cycles(given_directions(name))
        claims.append(
            Claim(
                f"{name}, without FPU",
                f"{without:g}",
                f"{cycles(printed):g} by table I; {own:g} by the counts here",
                near(cycles(printed), without, 1e-3),
            )
        )
    rest = {
        name: TABLE_II[name][1] - sum(TABLE_I[name][:2]) - 1.5 * TABLE_I[name][2]
        for name in TABLE_II
    }
    claims.append(
        Claim(
            "with FPU: what is left for √ and cos",
            "at most 5 % of the time without",
            ", ".join(f"{name} {value:g}" for name, value in rest.items()),
            refuted(min(rest.values()) < 0.0, "no weights give these figures"),
        )
    )
    return Section(
        "Table II: time complexities",
        "Cycles for each sample with the weights of section IV: + and × 1, / 1.5, √ 7, cos 15.",
        claims,
    )


def table_iii() -> Section:
    """Equal accuracy."""
    recording = simulated(motion("tumble"), 30.0)
    assert recording.reference is not None
    back = conjugate(WORLD_FRAMES["enu"])
    truth = [product(back, tuple(q)) for q in recording.reference.tolist()]
    stamps = dict(zip(recording.mag_stamps.tolist(), recording.mag.tolist(), strict=True))
    rows = [
        (tuple(a), tuple(stamps[stamp]), q)
        for stamp, a, q in zip(
            recording.stamps.tolist(), recording.accel.tolist(), truth, strict=True
        )
        if stamp in stamps and saam(tuple(a), tuple(stamps[stamp]))[0]
    ]
    found = {
        name: [
            math.sqrt(
                np.mean(
                    [
                        math.degrees(_off(euler(kernel(a, m)[1])[n], euler(q)[n])) ** 2
                        for a, m, q in rows
                    ]
                )
            )
            for n in range(3)
        ]
        for name, kernel in SNAPSHOTS.items()
    }
    spread = max(
        abs(x - y) for own in found.values() for x, y in zip(own, found["SAAM"], strict=True)
    )
    claims = [
        Claim(name, TABLE_III[name], " / ".join(f"{x:.12f}" for x in own), MEASURED)
        for name, own in found.items()
    ]
    claims.append(Claim("largest difference", "2e-13°", f"{spread:.0e}°", shown(spread < 1e-9)))
    return Section(
        "Table III: equal accuracy",
        f"RMSE of roll / pitch / yaw in degrees on {len(rows)} samples of the simulated chip "
        "tumbling, all at which SAAM has a rotor. The printed figures are against another device.",
        claims,
    )


def _off(x: float, y: float) -> float:
    return (x - y + math.pi) % (2.0 * math.pi) - math.pi


def table_iv() -> Section:
    """Time ratios."""
    accel, mag = _attitudes(20_000)
    times = of_snapshots({**SNAPSHOTS, "DCM": dcm}, accel, mag)
    claims = []
    for name, printed in TABLE_IV.items():
        if name == "SAAM":
            continue
        ratio, told = times[name] / times["SAAM"], printed / TABLE_IV["SAAM"]
        slower = AS_PRINTED if ratio > 1.2 else DIFFERENT
        verdict = slower if ratio > 0.8 * told else f"{slower} in order, less in size"
        claims.append(Claim(f"{name} / SAAM", f"{told:.1f}", f"{ratio:.2f}", verdict))
    ratio = times["DCM"] / times["SAAM"]
    claims.append(
        Claim(
            "DCM / SAAM (Kusaka and Tanaka: as fast as SAAM)",
            "1",
            f"{ratio:.2f}",
            shown(ratio <= 1.1),
        )
    )
    claims.append(Claim("SAAM", "1.77 µs", f"{times['SAAM']:.0f} ns", MEASURED))
    return Section(
        "Table IV: times",
        "Compiled, over 20 000 samples of a sensor that turns every way, with the "
        "normalisation and check of raw samples that all five need. The printed ratios were "
        "measured on a microcontroller, on which a square root or a cosine costs more of the "
        "whole than here.",
        claims,
    )


def _attitudes(rows: int) -> tuple[Array, Array]:
    time = 0.01 * np.arange(rows)
    q = IDENTITY
    for axis, rate in ((Z, 0.7), (X, 1.1), (Y, 0.3)):
        half = 0.5 * rate * time
        q = product(q, (np.cos(half), *(c * np.sin(half) for c in axis)))
    to_sensor = conjugate(q)
    accel, mag = (np.stack(rotate(to_sensor, v), axis=1) for v in (UP, NORTH))
    return accel, mag


def singular_surface() -> Section:
    """Where SAAM has no rotor, and how bad it is near."""
    none = {}
    for name, kernel in {**SNAPSHOTS, "DCM": dcm}.items():
        none[name] = sum(
            not kernel(rotate(conjugate(q), UP), rotate(conjugate(q), NORTH))[0]
            for axis in ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
            for q in (from_axis_angle(axis, math.radians(d)) for d in range(-180, 180, 5))
        )
    single = {name: _single_error(kernel) for name, kernel in (("SAAM", saam), ("DCM", dcm))}
    others = ", ".join(name for name, number in none.items() if not number)
    return Section(
        "The singular surface",
        "SAAM is −m_N times the column M₁ of Kusaka and Tanaka's eq. 6, whatever the attitude, "
        "so that it vanishes on all of `x = 0`: level at any yaw, facing north at any pitch, "
        "and more. Kusaka and Tanaka name the axis (0, 0, 1) alone; Wu et al. name nothing.",
        [
            Claim(
                "no rotor, level at any yaw or facing north at any pitch",
                "never",
                f"SAAM at {none['SAAM']} of 144 attitudes; {others} at none",
                refuted(none["SAAM"] > 0),
            ),
            Claim(
                "largest error in single precision with x = 1e-5",
                "",
                f"SAAM {single['SAAM']:.1f}°, DCM {single['DCM']:.1g}°",
                MEASURED,
            ),
        ],
    )


def _single_error(kernel: Callable[..., Any]) -> float:
    """The largest error in degrees near the singular surface in single precision."""
    random = np.random.default_rng(1)
    worst = 0.0
    single = on(Single, kernel)
    for _ in range(200):
        w, y, z = random.normal(size=3)
        length = math.sqrt(w * w + y * y + z * z)
        s = math.sqrt(1.0 - 1e-10) / length
        q = (float(s * w), 1e-5, float(s * y), float(s * z))
        vectors = (rotate(conjugate(q), v) for v in (UP, NORTH))
        found, rotor = single(*(numbers(Single, tuple(map(np.float32, v))) for v in vectors))
        if found:
            worst = max(worst, math.degrees(difference(rotor, q)))
    return worst
