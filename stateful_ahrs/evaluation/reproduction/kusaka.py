"""T. Kusaka and T. Tanaka, "Stateful Rotor for Continuity of Quaternion", Sensors 22, 2022."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from ... import filters
from ...filters.samples import Array
from ...filters.settings import Settings
from ...mpu9250.motion import motion
from ...mpu9250.world import IDEAL
from ...rotor import (
    IDENTITY,
    Rotor,
    Vector,
    angle,
    blend,
    conjugate,
    dot,
    fast_angle,
    follow,
    from_axis_angle,
    from_rate,
    product,
    rotate,
)
from ...snapshot.dcm import dcm, from_columns
from ...snapshot.directions import directions, reference
from ...snapshot.fqa import fqa
from ...snapshot.saam import saam
from ..metrics import rmse_deg
from ..score import Trial, estimate, prepare
from ..svg import Scale
from .counting import ADD, DIVIDE, MULTIPLY, OPERATIONS, ROOT, operations
from .page import (
    AS_PRINTED,
    MEASURED,
    WRONG,
    Claim,
    Section,
    at_most,
    refuted,
    shown,
)
from .sheet import elements, panel, sheet, thinned
from .simulated import simulated

Snapshot = Callable[[Vector, Vector], tuple[bool, Rotor]]

ONE_TWO_THREE: Vector = (1.0 / math.sqrt(14.0), 2.0 / math.sqrt(14.0), 3.0 / math.sqrt(14.0))
UNIT = Scale(-1.05, 1.05)
UNIT_TICKS = [(-1.0, "−1"), (0.0, "0"), (1.0, "1")]
TURN_TICKS = [(float(d), f"{d}°".replace("-", "−")) for d in range(-360, 361, 120)]
TURN = Scale(-360.0, 360.0)
NORTH, UP = (0.5, 0.0, -math.sqrt(0.75)), (0.0, 0.0, 9.81)  # of a dip of 60°
JUMP = 0.5  # of an element from one row to the next, which no motion here makes
EXPERIMENT = Settings(alpha=math.exp(-0.1 / 3.0), alpha_rate=0.0)  # 3 s at its Δt = 0.1 s
SLOW = Settings(alpha=math.exp(-0.01 / 12.0))  # 12 s


def jumps(rotors: Array) -> int:
    """How often an element of rotors (n, 4) jumps."""
    return int((np.abs(np.diff(rotors, axis=0)).max(axis=1) > JUMP).sum())


def figure_1() -> Section:
    """The discontinuity of eq. 1 where the angle is known within a turn alone."""
    degrees = np.linspace(-360.0, 360.0, 721)
    wrapped = (degrees + 180.0) % 360.0 - 180.0
    continuous, found = (
        np.array([from_axis_angle(ONE_TWO_THREE, math.radians(d)) for d in angles])
        for angles in (degrees, wrapped)
    )
    chart = panel(
        "q(θ) about (1, 2, 3): eq. 1, and what would be continuous (dashed)",
        [*elements(degrees, found), *elements(degrees, continuous, "dashed")],
        TURN,
        UNIT,
        TURN_TICKS,
        UNIT_TICKS,
    )
    return Section(
        "Figure 1: the rotor of eq. 1 is not continuous",
        "θ runs from −360° to 360° and is known within ±180° alone.",
        [Claim("jumps of the rotor", "2, at ±180°", str(jumps(found)), shown(jumps(found) == 2))],
        figures={"kusaka-1": sheet("Figure 1", [chart], 1)},
    )


def followed(rotors: Array, state: Rotor) -> Array:
    """The stateful rotors (n, 4), eq. 3–4, from this state on."""
    found = []
    for q in rotors.tolist():
        state = follow(tuple(q), state)
        found.append(state)
    return np.array(found)


def figures_3_and_4() -> Section:
    """The stateful rotor, from both signs of the first state."""
    degrees = np.linspace(-360.0, 360.0, 721)
    wrapped = (degrees + 180.0) % 360.0 - 180.0
    rotors = np.array([from_axis_angle(ONE_TWO_THREE, math.radians(d)) for d in wrapped])
    near = tuple(rotors[0].tolist())
    close, far = followed(rotors, near), followed(rotors, tuple(-x for x in near))
    charts = [
        panel(title, elements(degrees, own), TURN, UNIT, TURN_TICKS, UNIT_TICKS)
        for title, own in (("figure 3: a near first state", close), ("figure 4: a far one", far))
    ]
    return Section(
        "Figures 3 and 4: the stateful rotor is",
        "The same rotors by eq. 3–4, from a first state near the first rotor and far from it.",
        [
            Claim("jumps, near state", "none", str(jumps(close)), shown(jumps(close) == 0)),
            Claim("jumps, far state", "none", str(jumps(far)), shown(jumps(far) == 0)),
            Claim(
                "far state gives the opposite rotors",
                "yes",
                "yes" if np.array_equal(close, -far) else "no",
                shown(np.array_equal(close, -far)),
            ),
        ],
        figures={"kusaka-3-4": sheet("Figures 3 and 4", charts)},
    )


def figure_6() -> Section:
    """The fast angle (eq. 19)."""
    w = np.linspace(-1.0, 1.0, 20001)
    rotors = [(float(c), math.sqrt(1.0 - float(c) * float(c)), 0.0, 0.0) for c in w]
    error = np.degrees([fast_angle(q) - angle(q) for q in rotors])
    worst = float(np.abs(error).max())
    both = [
        ("exact", thinned(w), thinned(np.degrees([angle(q) for q in rotors])), "grey wide"),
        ("eq. 19", thinned(w), thinned(np.degrees([fast_angle(q) for q in rotors])), "z"),
    ]
    charts = [
        panel("angle over w, degrees", both, Scale(-1.0, 1.0), Scale(0.0, 360.0)),
        panel(
            "error of eq. 19 over w, degrees",
            [("", thinned(w), thinned(error), "x")],
            Scale(-1.0, 1.0),
            Scale(-0.6, 0.6),
        ),
    ]
    return Section(
        "Figure 6: the angle without arccos",
        "Eq. 19 with β = 0.351 over all w.",
        [
            Claim(
                "largest error",
                "below 0.5°",
                f"{worst:.3f}°",
                shown(worst < 0.5),
            )
        ],
        figures={"kusaka-6": sheet("Figure 6", charts)},
    )


def two_turns() -> tuple[Array, Array]:
    """Angles (n,) in degrees from −360 to 360, and the rotors of section 3.1 (n, 4)."""
    degrees = np.linspace(-360.0, 360.0, 1441)
    rotors = []
    for d in degrees.tolist():
        part = min(max((d + 120.0) / 240.0, 0.0), 1.0)
        axis = [(1.0 - part) * x + part * z for x, z in zip(ONE_TWO_THREE, (0, 0, 1), strict=True)]
        length = math.hypot(*axis)
        x, y, z = (c / length for c in axis)
        rotors.append(from_axis_angle((x, y, z), math.radians(d)))
    return degrees, np.array(rotors)


def snapshots(snapshot: Snapshot, rotors: Array) -> Array:
    """What a snapshot makes of these attitudes, zero where it has none."""
    found = []
    for q in rotors.tolist():
        to_sensor = conjugate(tuple(q))
        has, rotor = snapshot(rotate(to_sensor, UP), rotate(to_sensor, NORTH))
        found.append(rotor if has else (0.0, 0.0, 0.0, 0.0))
    return np.array(found)


def figures_7_to_9() -> Section:
    """Three snapshots, stateless and stateful."""
    degrees, rotors = two_turns()
    charts, claims = [], []
    known: dict[str, Array] = {}
    for figure, snapshot in ((7, dcm), (8, fqa), (9, saam)):
        name = snapshot.__name__.upper()
        stateless = snapshots(snapshot, rotors)
        stateful = known[name] = followed(stateless, IDENTITY)
        charts += [
            panel(
                f"figure {figure}: {name}, {kind}",
                elements(degrees, own),
                TURN,
                UNIT,
                TURN_TICKS,
                UNIT_TICKS,
            )
            for kind, own in (("stateless", stateless), ("stateful", stateful))
        ]
        if snapshot is saam:
            about_z = degrees >= 120.0
            none = int((~stateless[about_z].any(axis=1)).sum())
            claims += [
                Claim(
                    "figure 9: SAAM about (0, 0, 1)",
                    "(0, 0, 0, 0)",
                    f"no rotor at {none} of {about_z.sum()} attitudes",
                    shown(none == about_z.sum()),
                )
            ]
            continue
        both = f"{jumps(stateless)} stateless, {jumps(stateful)} stateful"
        claims.append(
            Claim(
                f"figure {figure}: jumps of {name}",
                "some stateless, none stateful",
                both,
                shown(jumps(stateless) > 0 == jumps(stateful)),
            )
        )
    error = max(
        1.0 - abs(dot(tuple(p), tuple(q)))
        for p, q in zip(known["DCM"].tolist(), rotors.tolist(), strict=True)
    )
    apart = float(np.abs(known["DCM"] - known["FQA"]).max())
    claims += [
        Claim("DCM − FQA, largest element", "the same", f"{apart:.0e}", shown(apart < 1e-9)),
        Claim("DCM − truth, 1 less the cosine", "", f"{error:.0e}", MEASURED),
    ]
    return Section(
        "Figures 7, 8 and 9: snapshots, stateless and stateful",
        "θ runs from −360° to 360°, about (1, 2, 3) up to −120°, about (0, 0, 1) from 120° on, and "
        "about an axis on its way in between; the first state is (1, 0, 0, 0).",
        claims,
        figures={"kusaka-7-9": sheet("Figures 7 to 9", charts)},
    )


@cache
def experiment() -> Trial:
    """The paper's experiment: about y and then about z, a turn each in 4 s, Δt = 0.1 s."""
    return prepare(simulated(motion("turns"), 10.0, 10.0, name="turns"))


def figure_12() -> Section:
    """The complementary filter, stateless and stateful."""
    trial = experiment()
    time = 1e-9 * (trial.samples.stamps - trial.samples.stamps[0])
    pairs = zip(trial.samples.accel.tolist(), trial.samples.mag.tolist(), strict=True)
    raw, last = [], IDENTITY
    for a, m in pairs:
        found, rotor = dcm(tuple(a), tuple(m))
        last = rotor if found else last
        raw.append(last)
    gyro = filters.make("gyro", EXPERIMENT).run(trial.samples)
    stateful = filters.make("paper", EXPERIMENT).run(trial.samples)
    stateless = filters.make("paper_stateless", EXPERIMENT).run(trial.samples)
    seconds = Scale(0.0, 10.0)
    rows = {
        "q_rs, accelerometer and magnetometer": (np.array(raw), followed(np.array(raw), IDENTITY)),
        "q_rω, gyroscope": (gyro, gyro),
        "q_rc, both": (stateless, stateful),
    }
    charts = [
        panel(f"{title}: {kind}", elements(time, own), seconds, UNIT, None, UNIT_TICKS)
        for title, pair in rows.items()
        for kind, own in zip(("stateless", "stateful"), pair, strict=True)
    ]
    errors = {
        name: rmse_deg(estimate(trial, filters.make(name, EXPERIMENT)), trial.truth).total
        for name in ("paper", "paper_stateless")
        if trial.truth
    }
    return Section(
        "Figure 12: the complementary filter, stateless and stateful",
        "A turn about y and one about z in 4 s each, Δt = 0.1 s as in the paper, from the "
        "simulated chip; α for a time constant of 3 s (the paper's α is not printed).",
        [
            Claim(
                "stateless",
                "the synthesis failed",
                f"{errors['paper_stateless']:.1f}° RMSE",
                shown(errors["paper_stateless"] > 10.0),
            ),
            Claim(
                "stateful",
                "performed reliably",
                f"{errors['paper']:.1f}° RMSE",
                shown(errors["paper"] < 5.0),
            ),
        ],
        figures={"kusaka-12": sheet("Figure 12", charts)},
    )


def figure_13() -> Section:
    """The angle by eq. 19."""
    trial = experiment()
    time = 1e-9 * (trial.samples.stamps - trial.samples.stamps[0])
    runs = {
        "gyro": filters.make("gyro", EXPERIMENT).run(trial.samples),
        "paper_stateless": filters.make("paper_stateless", EXPERIMENT).run(trial.samples),
        "paper": filters.make("paper", EXPERIMENT).run(trial.samples),
    }
    angles = {
        name: np.degrees([fast_angle(tuple(q)) for q in run.tolist()]) for name, run in runs.items()
    }
    chart = panel(
        "angle by eq. 19, degrees",
        [
            ("gyroscope", time, angles["gyro"], "grey wide"),
            ("stateless", time, angles["paper_stateless"], "x"),
            ("stateful", time, angles["paper"], "z"),
        ],
        Scale(0.0, 10.0),
        Scale(0.0, 360.0),
        None,
        [(90.0 * n, f"{90 * n}°") for n in range(5)],
    )
    apart = {
        name: float(np.abs(angles[name] - angles["gyro"]).max())
        for name in ("paper", "paper_stateless")
    }
    return Section(
        "Figure 13: the angle",
        "The same recording. As in the paper the angle is within 360°: where the first turn ends "
        "it comes back to the axis's other side, which `Turn` in `rotor.py` counts on over.",
        [
            Claim(
                "stateful: farthest from the gyroscope's angle",
                "close to it",
                f"{apart['paper']:.1f}°",
                shown(apart["paper"] < 10.0),
            ),
            Claim(
                "stateless: farthest from the gyroscope's angle",
                "far from it",
                f"{apart['paper_stateless']:.1f}°",
                shown(apart["paper_stateless"] > 90.0),
            ),
        ],
        figures={"kusaka-13": sheet("Figure 13", [chart], 1)},
    )


FORCE: Vector = (0.3, -2.1, 9.2)  # a sample; the counts are the same for any
FIELD: Vector = (2e-5, 1.1e-5, -3.7e-5)
AXES: tuple[Vector, Vector, Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def counted(name: str, printed: Sequence[int], found: dict[str, int]) -> Claim:
    """A claim on how many operations there are of each kind."""
    ours = [found.get(operation, 0) for operation in OPERATIONS[: len(printed)]]
    return Claim(
        name,
        ", ".join(f"{n} {o}" for n, o in zip(printed, OPERATIONS, strict=False) if n),
        ", ".join(f"{n} {o}" for n, o in zip(ours, OPERATIONS, strict=False) if n),
        at_most(sum(ours), sum(printed)),
    )


def table_1() -> Section:
    """Operations of a snapshot."""
    columns = operations(from_columns, 1.0, *AXES)
    whole = operations(dcm, FORCE, FIELD)
    given = {}
    for snapshot in (saam, fqa):
        given[snapshot] = operations(snapshot, FORCE, FIELD)
        given[snapshot] -= operations(directions, FORCE, FIELD)
        given[snapshot] += operations(reference, FORCE, FIELD)
    return Section(
        "Table 1: operations of a snapshot",
        "Counted on the kernels of `snapshot/`. As in the paper the DCM's row begins after "
        "orthogonalisation, and SAAM's and FQA's with unit vectors. The last row is what the "
        "paper's leaves out: two cross products, the normalisations, and a check of the input. "
        "Half-angle formulas take the place of FQA's cosines.",
        [
            counted("DCM", (13, 5, 1, 1), columns),
            counted("SAAM", (18, 16, 1, 2), given[saam]),
            counted("FQA", (18, 53, 4, 3, 6), given[fqa]),
            Claim(
                "DCM, from the raw samples",
                "",
                ", ".join(f"{whole[o]} {o}" for o in (ADD, MULTIPLY, DIVIDE, ROOT)),
                MEASURED,
            ),
        ],
    )


def table_2() -> Section:
    """Operations of the filter."""
    turn = operations(from_rate, (0.1, 0.2, 0.3), 0.01)
    turn[MULTIPLY] -= 1  # Δt/2
    path = operations(product, IDENTITY, IDENTITY)
    mix = operations(blend, IDENTITY, IDENTITY, 0.9)
    mix[ADD] -= 1  # 1 − α
    both = path + mix
    return Section(
        "Table 2: operations of the filter",
        "Counted on the kernels of `rotor.py`, Δt/2 and 1 − α being known.",
        [
            counted("fast quaternion integration (eq. 12)", (3, 7), turn),
            Claim(
                "complementary filter (eq. 16)",
                "24 +, 16 ×",
                f"{both[ADD]} +, {both[MULTIPLY]} ×",
                refuted((both[ADD], both[MULTIPLY]) == (16, 24), "the two are swapped"),
            ),
        ],
    )


def product_side() -> Section:
    """Eq. 14's product on motion about an axis that moves."""
    tumble = prepare(simulated(motion("tumble"), 20.0, errors=IDEAL, name="tumble"))
    claims = []
    for what, trial in (("one axis at a time", experiment()), ("a moving axis", tumble)):
        assert trial.truth
        settings = EXPERIMENT if trial is experiment() else Settings()
        right, left = (
            rmse_deg(estimate(trial, filters.make(name, settings)), trial.truth).total
            for name in ("paper", "paper_printed")
        )
        claims.append(
            Claim(
                what,
                "on the left (eq. 14)",
                f"left {left:.1f}°, right {right:.1f}°",
                refuted(left > 10.0 * right),
            )
        )
    return Section(
        "Equation 14: the side of the product",
        "A strapped-down gyroscope measures in the sensor's frame, so that its rotor belongs "
        "on the right. The paper's experiment, about one axis at a time, cannot tell. RMSE of "
        "the whole filter (`paper_printed`, `paper`):",
        claims,
    )


def product_side_on(trials: Callable[[], Sequence[Trial]]) -> Section:
    """The same on BROAD, with the stateless filter."""
    printed = {"paper": "", "paper_printed": "eq. 14", "paper_stateless": "fails"}
    verdicts = {"paper": MEASURED, "paper_printed": WRONG, "paper_stateless": AS_PRINTED}
    claims = []
    for name, said in printed.items():
        mean = float(
            np.mean(
                [
                    rmse_deg(estimate(trial, filters.make(name, SLOW)), trial.truth).total
                    for trial in trials()
                    if trial.truth
                ]
            )
        )
        holds = mean < 15.0 if name == "paper" else mean > 50.0
        verdict = verdicts[name] if holds else shown(False)
        claims.append(Claim(f"`{name}`", said, f"{mean:.2f}°", verdict))
    return Section(
        "Equation 14 and statelessness on real motion",
        f"Mean total RMSE over {len(trials())} trials of BROAD, τ = 12 s.",
        claims,
    )
