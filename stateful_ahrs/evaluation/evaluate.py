"""evaluate: filters over recordings, against the truth where it is known."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .. import filters
from ..command import Parser, exit_with_sentence
from ..errors import AhrsError, UsageError
from ..filters.stateful import Settings
from ..recordings import Progress, load
from ..recordings.progress import bar
from .score import Result, Trial, prepare, score
from .table import as_json, write_table

LONGEST_SWEEP = 1000
STDOUT = "standard output"
EPILOG = """\
total, heading and inclination are root mean square errors in degrees, by BROAD's metric: nothing
is aligned, and only rows with a known reference count (in BROAD, those in motion). Sign flips
count the steps at which the rotor changes its hemisphere. ns/sample is the filter alone, compiled
where numba is installed. Exit codes: 0 done; 1 a recording could not be used, the others were;
2 usage."""


@dataclass(frozen=True)
class Job:
    """What the command line asks for."""

    recordings: list[str]
    filters: list[str]
    settings: list[Settings]  # one for each α
    reference: str | None
    json: str | None
    plot: Path | None


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code 0: all done; 1: a recording could not be used; 2: usage."""
    return exit_with_sentence("evaluate", lambda: _evaluate(_job(argv)))


def _job(argv: Sequence[str] | None) -> Job:
    parser = Parser(
        prog="evaluate",
        description="Run filters over recordings and compare them with the truth.",
        epilog=EPILOG,
    )
    parser.add_argument(
        "recordings",
        nargs="+",
        metavar="RECORDING",
        help="rosbag2 folder, .mcap, .db3, ROS 1 .bag, BROAD .mat or .csv",
    )
    parser.add_argument(
        "--filters",
        default="stateful",
        metavar="A,B,...",
        help=f"of {', '.join(filters.FILTERS)}; or all (default: %(default)s)",
    )
    parser.add_argument(
        "--alpha",
        default=str(Settings.alpha),
        metavar="V|START:STOP:COUNT",
        help="weight of the gyroscope, 0 to 1 (default: %(default)s), or a sweep of COUNT values "
        "with 1 - alpha, and so nearly the time constant, in equal ratios",
    )
    parser.add_argument(
        "--alpha-rate",
        type=float,
        default=Settings.alpha_rate,
        metavar="HZ",
        help="alpha holds for 1/HZ seconds (default: %(default)g); 0: for each sample",
    )
    parser.add_argument(
        "--reference",
        metavar="TOPIC",
        help="a bag's true orientation (default: ground_truth, if there is one)",
    )
    parser.add_argument("--json", metavar="FILE|-", help="write the results as JSON; - is stdout")
    parser.add_argument(
        "--plot",
        type=Path,
        metavar="FILE",
        help="draw errors over time and the rotor's elements: .png, .svg or .pdf",
    )
    given = parser.parse_args(argv)
    settings = [Settings(alpha=alpha, alpha_rate=given.alpha_rate) for alpha in sweep(given.alpha)]
    job = Job(
        list(dict.fromkeys(given.recordings)),
        _filters(given.filters),
        settings,
        given.reference,
        given.json,
        given.plot,
    )
    if job.json not in (None, "-"):
        _must_be_writable("--json", Path(job.json))
    if job.plot:
        from .figure import check_plot

        check_plot(job.plot, len(job.recordings), len(job.settings))
        _must_be_writable("--plot", job.plot)
    return job


def sweep(text: str) -> list[float]:
    """The values of α that ``V`` or ``START:STOP:COUNT`` names.

    A sweep is even in log(1 − α), which for α near 1 is minus the log of the time constant:
    each value has the same part more of it than the last.
    """
    try:
        start, *rest = text.split(":")
        if not rest:
            return [float(start)]
        stop, count = rest
        first, last, n = float(start), float(stop), int(count)
    except ValueError:
        raise UsageError(
            f"--alpha must be a number or START:STOP:COUNT (as 0.99:0.9999:30), got {text!r}."
        ) from None
    if not (0.0 <= first < 1.0 and 0.0 <= last < 1.0):
        raise UsageError(f"a sweep of alpha goes from 0 to below 1, got {text!r}.")
    if not 2 <= n <= LONGEST_SWEEP:
        raise UsageError(f"a sweep of alpha has 2 to {LONGEST_SWEEP} values, got {text!r}.")
    inner = 1.0 - np.geomspace(1.0 - first, 1.0 - last, n)[1:-1]
    return [first, *inner.tolist(), last]


def _filters(text: str) -> list[str]:
    if text == "all":
        return list(filters.FILTERS)
    names = list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if not names:
        raise UsageError(f"--filters needs a name: {', '.join(filters.FILTERS)}, or all.")
    for name in names:
        filters.make(name)
    return names


def _must_be_writable(option: str, path: Path) -> None:
    if path.is_dir():
        raise UsageError(f"{option} {path} is a folder, expected a file.")
    if not path.parent.is_dir():
        raise UsageError(f"{option} {path}: there is no folder {path.parent}.")


def _evaluate(job: Job) -> int:
    results: list[Result] = []
    trials: list[Trial] = []
    failed = 0
    for path in job.recordings:
        try:
            with bar(f"evaluating {Path(path).name}") as progress:
                trial = _trial(path, job, progress)
                if trial.name in {result.recording for result in results}:
                    trial = replace(trial, name=path)
                results += _results(trial, job, progress)
        except UsageError:
            raise
        except AhrsError as error:
            _say(error)
            failed = 1
            continue
        if trial.truth is None:
            _say(f"{trial.name} has no reference, so its errors are unknown (see --reference).")
        elif not trial.has_mag:
            _say(f"{trial.name} has no magnetometer samples: its heading starts at any angle.")
        if job.plot:
            trials.append(trial)
    if job.json:
        text = json.dumps(as_json(results), indent=2, allow_nan=False) + "\n"
        with _written(job.json if job.json != "-" else STDOUT):
            if job.json == "-":
                sys.stdout.write(text)
                sys.stdout.flush()
            else:
                Path(job.json).write_text(text)
    if results:
        with _written(STDOUT):
            write_table(results, sys.stderr if job.json == "-" else sys.stdout)
            sys.stdout.flush()
    if job.plot and trials:
        from .figure import draw

        with bar(f"drawing {job.plot.name}"), _written(job.plot):
            draw(trials, job.filters, job.settings[0], job.plot)
    return failed


def _trial(path: str, job: Job, progress: Progress | None) -> Trial:
    half = progress and (lambda done: progress(0.5 * done))
    return prepare(load(path, job.reference, half))


def _results(trial: Trial, job: Job, progress: Progress | None) -> Iterator[Result]:
    runs = [(name, settings) for name in job.filters for settings in job.settings]
    for done, (name, settings) in enumerate(runs):
        if progress:
            progress(0.5 + 0.5 * done / len(runs))
        yield score(trial, name, settings)


def _say(sentence: object) -> None:
    print(f"evaluate: {sentence}", file=sys.stderr, flush=True)


@contextmanager
def _written(name: Path | str) -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise AhrsError(f"{name} cannot be written: {error.strerror or error}.") from None
