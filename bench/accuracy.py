"""How accurate the filters are beside other packages' (`make accuracy`), into docs/accuracy.md.

BROAD's metric on the trials in a folder: each filter with its defaults, each peer with its
defaults and swept; the groups of trials; and what is made worse on purpose.
"""

from __future__ import annotations

import argparse
import functools
import json
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

import joblib
import numpy as np

from stateful_ahrs import filters
from stateful_ahrs.evaluation.groups import groups
from stateful_ahrs.evaluation.metrics import Rmse, Truth, rmse_deg
from stateful_ahrs.evaluation.score import Trial, prepare
from stateful_ahrs.filters.frames import WorldFrame
from stateful_ahrs.filters.samples import Array, Samples
from stateful_ahrs.filters.settings import DEFAULTS
from stateful_ahrs.recordings import load
from stateful_ahrs.recordings.progress import bar
from stateful_ahrs.rotor import conjugate, product, rotate

from .peers import PEERS, Peer, vqf, vqf_six

TABLES = ("filters", "groups", "worse")  # as they are marked in the page
PAGE = Path(__file__).parents[1] / "docs" / "accuracy.md"
OURS = "stateful"
TAU_12 = 0.999167  # α of 12 s
SLOW_HEADING = 0.9995  # α of 20 s
BESIDE = ("VQF", vqf)
Method = tuple[str, Mapping[str, Any]]  # a name, and options

TAUGHT = ("learn_misalignment", "learn_mag", "learn_bias", "weigh_mag")
PARTS: tuple[Mapping[str, Any], ...] = (  # of ours, switched off
    {"learn_misalignment": False},
    {"learn_mag": False},
    *(dict.fromkeys(TAUGHT[:n], False) for n in range(2, len(TAUGHT) + 1)),
    {"weigh_mag": False},
    {"low_pass": False},
    {"alpha_heading": SLOW_HEADING},
    {"alpha": TAU_12},
)

GROUPS = (
    *("rotation", "translation", "slow", "fast", "tapping", "vibration"),
    *("stationary_magnet", "attached_magnet", "office_environment", "mixed"),
)

Worse = Callable[[Trial], Trial]


class Run(NamedTuple):
    """What is done with one trial."""

    trial: str
    method: str
    options: Mapping[str, Any]
    worse: str


# What is made worse on purpose


def every(n: int) -> Worse:
    """Every nth sample."""

    def decimated(trial: Trial) -> Trial:
        rows = slice(None, None, n)
        return _rows(trial, rows)

    return decimated


def gaps(lost: float, each: float) -> Worse:
    """So many seconds without a sample in each so many."""

    def with_gaps(trial: Trial) -> Trial:
        stamps = trial.samples.stamps
        since = (stamps - stamps[0]) * 1e-9
        return _rows(trial, np.flatnonzero((since % each > lost) | (since < lost)))

    return with_gaps


def iron(field: Sequence[float], seconds: float = np.inf) -> Worse:
    """A magnet on the body (µT), for the first seconds or for ever."""

    def with_iron(trial: Trial) -> Trial:
        samples = trial.samples
        since = (samples.stamps - samples.stamps[0]) * 1e-9
        mag = samples.mag + np.where((since < seconds)[:, None], 1e-6 * np.array(field), 0.0)
        return replace(trial, samples=replace(samples, mag=mag))

    return with_iron


def another_field(turn_deg: float, times: float, begin: float, seconds: float) -> Worse:
    """A field turned about the vertical and so many times as strong, ``begin`` s into motion."""

    def with_another(trial: Trial) -> Trial:
        assert trial.truth
        samples, q = trial.samples, tuple(trial.truth.rotors.T)
        half = 0.5 * np.radians(turn_deg)
        turn = product(conjugate(q), product((np.cos(half), 0.0, 0.0, np.sin(half)), q))
        mag = times * np.stack(rotate(turn, tuple(samples.mag.T)), axis=1)
        since = (samples.stamps - samples.stamps[np.argmax(trial.truth.counts)]) * 1e-9
        there = (since >= begin) & (since < begin + seconds) & np.isfinite(mag[:, 0])
        return replace(
            trial, samples=replace(samples, mag=np.where(there[:, None], mag, samples.mag))
        )

    return with_another


def in_motion(later: float = 0.0) -> Worse:
    """Begin where the motion does, or some seconds later."""

    def cut(trial: Trial) -> Trial:
        assert trial.truth
        samples = trial.samples
        first = int(np.argmax(trial.truth.counts))
        begin = samples.stamps[first] + int(later * 1e9)
        return _rows(trial, slice(int(np.searchsorted(samples.stamps, begin)), None))

    return cut


def both(one: Worse, other: Worse) -> Worse:
    """One after the other."""
    return lambda trial: other(one(trial))


def _rows(trial: Trial, rows: slice | Array) -> Trial:
    samples, truth = trial.samples, trial.truth
    assert truth
    parts = (samples.stamps, samples.gyro, samples.accel, samples.mag)
    return replace(
        trial,
        samples=Samples(*(np.ascontiguousarray(part[rows]) for part in parts)),
        truth=Truth(truth.rotors[rows], truth.counts[rows]),
    )


WORSE: dict[str, Worse] = {
    "as recorded": lambda trial: trial,
    "every second sample": every(2),
    "every third": every(3),
    "every fifth": every(5),
    "0.05 s lost in each 5 s": gaps(0.05, 5.0),
    "0.2 s lost in each 30 s": gaps(0.2, 30.0),
    "0.5 s lost in each 30 s": gaps(0.5, 30.0),
    "hard iron (3, −2, 4) µT": iron((3, -2, 4)),
    "hard iron (−3, 2, −4) µT": iron((-3, 2, -4)),
    "hard iron (6, −4, 8) µT": iron((6, -4, 8)),
    "(3, −2, 4) µT for the first 20 s": iron((3, -2, 4), 20.0),
    "(15, −10, 20) µT for the first 20 s": iron((15, -10, 20), 20.0),
    "(−30, 20, 10) µT for the first 20 s": iron((-30, 20, 10), 20.0),
    "the last but one, starting in motion": both(in_motion(), iron((15, -10, 20), 20.0)),
    "the last, starting in motion": both(in_motion(), iron((-30, 20, 10), 20.0)),
    "a field 80° off and twice as strong, 60 s long": another_field(80.0, 2.0, 40.0, 60.0),
    "one 30° off and 1.3 times as strong": another_field(30.0, 1.3, 40.0, 60.0),
    "a start in motion": in_motion(),
    "a start 30 s into the motion": in_motion(30.0),
}
NO_MAG = "no magnetometer: inclination"


# Runs


def peers() -> dict[str, Peer]:
    """By name."""
    return {peer.name: peer for peer in PEERS}


def rotors(samples: Samples, method: str, options: Mapping[str, Any], mag: bool = True) -> Array:
    """What a filter of ours or a peer makes of the samples: (n, 4), ENU."""
    if method in filters.FILTERS:
        settings = replace(DEFAULTS, **options)
        found = filters.make(method, settings if mag else replace(settings, use_mag=False))
        return WorldFrame("enu").all(found.run(samples))
    if not mag:
        return vqf_six(samples, **options)
    return peers()[method].run(samples, **options)


@functools.cache
def read(path: Path) -> Trial:
    """Each is read once in each process."""
    return prepare(load(path))


def score(run: Run, folder: Path) -> Rmse:
    """The errors of one run."""
    trial = WORSE.get(run.worse, WORSE["as recorded"])(read(folder / f"{run.trial}.mat"))
    found = rotors(trial.samples, run.method, run.options, mag=run.worse != NO_MAG)
    assert trial.truth
    return rmse_deg(found, trial.truth)


def all_runs(trials: Iterable[str], sweep: bool, only: set[str]) -> list[Run]:
    """The runs of all tables; the slow ones first, so that no core waits at the end."""
    ours: list[Method] = [
        (name, {}) for name in (OURS, "paper", "ekf", "kckf", "fkf", "gdalkf", "aqua")
    ]
    ours += [("paper", {"alpha": TAU_12}), *((OURS, part) for part in PARTS)]
    others: list[Method] = [
        (peer.name, options)
        for peer in reversed(PEERS)
        if not only or peer.name in only
        for options in ({}, *(peer.sweep if sweep else ()))
    ]
    trials = list(trials)
    runs = [Run(t, *method, "as recorded") for method in (*others, *ours) for t in trials]
    runs += [
        Run(trial, method, {}, worse)
        for worse in (*WORSE, NO_MAG)
        if worse != "as recorded"
        for method in (OURS, BESIDE[0])
        if method == OURS or not only or method in only
        for trial in trials
    ]
    return runs


def mean(found: Mapping[str, Rmse]) -> Rmse:
    """Over the trials."""
    return Rmse(*map(fmean, zip(*found.values(), strict=True)))


# Tables


Found = dict[tuple[str, str, str], dict[str, Rmse]]  # method, options, worse → trial → errors


def key(run: Run) -> tuple[str, str, str]:
    """Of its row."""
    return run.method, json.dumps(run.options, sort_keys=True), run.worse


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """In Markdown."""
    lines = ["| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *rows)]
    return "\n".join(lines)


def methods_table(found: Found) -> str:
    """Ours, each row as it was run, and the peers with defaults and the best of their sweep."""
    rows = []
    names = dict.fromkeys(method for method, _, _ in found)
    for name in sorted(names, key=lambda name: name not in filters.FILTERS):
        own = {
            options: mean(trials)
            for (method, options, worse), trials in found.items()
            if method == name and worse == "as recorded"
        }
        if name in filters.FILTERS:
            rows += [[f"`{name}`", _told(each), *_three(own[each])] for each in own]
            continue
        rows.append([name, _told("{}"), *_three(own["{}"])])
        if len(own) > 1:
            best = min(own, key=lambda options: own[options].total)
            rows.append([name, f"best of {len(own)}: {_told(best)}", *_three(own[best])])
    return table(["filter", "constants", "total", "heading", "inclination"], rows)


def groups_table(found: Found, folder: Path) -> str:
    """Ours beside VQF, both with their defaults."""
    ours, other = (found[name, "{}", "as recorded"] for name in (OURS, BESIDE[0]))
    members = groups({name: folder / f"{name}.mat" for name in ours})
    rows = []
    for group in GROUPS:
        own = next((of for names, of in members.items() if group in names.split(", ")), [])
        if own:
            totals = [f"{fmean(each[trial].total for trial in own):.2f}" for each in (ours, other)]
            rows.append([group.replace("_", " "), str(len(own)), *totals])
    return table(["trials", "", f"`{OURS}`", BESIDE[0]], rows)


def worse_table(found: Found) -> str:
    """Ours beside VQF."""
    rows = []
    for worse in (*WORSE, NO_MAG):
        cells = [mean(found[name, "{}", worse]) for name in (OURS, BESIDE[0])]
        shown = [cell.inclination if worse == NO_MAG else cell.total for cell in cells]
        rows.append([worse, *(f"{value:.2f}" for value in shown)])
    return table(["the same recordings with", f"`{OURS}`", BESIDE[0]], rows)


def _three(rmse: Rmse) -> list[str]:
    return [f"{value:.2f}" for value in rmse]


def _told(options: str) -> str:
    pairs = json.loads(options).items()
    return ", ".join(f"`{name}` {_short(value)}" for name, value in pairs) or "defaults"


def _short(value: Any) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, list):
        return "(" + ", ".join(map(_short, value)) + ")"
    return f"{value:g}"


def put(page: str, name: str, text: str) -> str:
    """The page with what stands between the marks of that name replaced."""
    begin, end = f"<!-- make accuracy: {name} -->\n", "\n<!-- end -->"
    pattern = re.escape(begin) + r".*?" + re.escape(end)
    new, count = re.subn(pattern, lambda _: begin + text + end, page, flags=re.DOTALL)
    if count != 1:
        raise SystemExit(f"{PAGE.name} must have one place marked {begin.strip()!r}, has {count}.")
    return new


def main() -> None:
    """Measure, print, and write into the page."""
    parser = argparse.ArgumentParser(prog="make accuracy", description=__doc__)
    parser.add_argument("folder", type=Path, help="of BROAD trials (.mat) with their trials.json")
    parser.add_argument("--no-sweep", action="store_true", help="peers with their defaults alone")
    parser.add_argument("--peers", default="", help="only these, separated by commas")
    parser.add_argument("--json", type=Path, help="write all figures")
    parser.add_argument("--page", action="store_true", help=f"write the tables into {PAGE.name}")
    options = parser.parse_args()
    trials = sorted(path.stem for path in options.folder.glob("*.mat"))
    if not trials:
        sys.exit(
            f"accuracy: {options.folder} has no .mat: name the folder of BROAD's trials (DATA=)."
        )
    if options.page:
        for name in TABLES:  # before the runs, not after them
            put(PAGE.read_text(), name, "")
    only = {name for name in options.peers.split(",") if name} | {BESIDE[0]}
    if unknown := only - set(peers()):
        sys.exit(f"accuracy: no peer {', '.join(sorted(unknown))}: expected {', '.join(peers())}.")
    runs = all_runs(trials, not options.no_sweep, only if options.peers else set())
    found: Found = {}
    with bar("accuracy") as progress:
        scores = joblib.Parallel(n_jobs=-1, return_as="generator")(
            joblib.delayed(score)(run, options.folder) for run in runs
        )
        for done, (run, rmse) in enumerate(zip(runs, scores, strict=True)):
            found.setdefault(key(run), {})[run.trial] = rmse
            if progress:
                progress((done + 1) / len(runs))
    tables = methods_table(found), groups_table(found, options.folder), worse_table(found)
    print("\n\n".join(tables))
    if options.json:
        rows = [
            {"filter": m, "options": json.loads(o), "recordings_with": w, "trial": t, **r._asdict()}
            for (m, o, w), own in found.items()
            for t, r in own.items()
        ]
        options.json.write_text(json.dumps(rows, indent=1) + "\n")
    if options.page:
        page = PAGE.read_text()
        for name, text in zip(TABLES, tables, strict=True):
            page = put(page, name, text)
        PAGE.write_text(page)


if __name__ == "__main__":
    # By its name, under which the workers find what they are to do.
    from bench import accuracy

    accuracy.main()
