"""What the command line of `evaluate` asks for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .. import filters
from ..command import Parser
from ..errors import UsageError
from ..filters.stateful import Settings
from .consistency import AHEAD

LONGEST_SWEEP = 1000
EPILOG = f"""\
total, heading and inclination are root mean square errors in degrees, by BROAD's metric: nothing
is aligned, and only rows with a known reference count (in BROAD, those in motion). Sign flips
count the steps at which the rotor changes its hemisphere. ns/sample is the filter alone, compiled
where numba is installed; --jobs 1 measures it undisturbed. After a sweep the best alpha is marked
with *: by the total error, or without a reference by self-consistency, how well the rotor
foretells the accelerometer and magnetometer of the next {AHEAD:g} s, whose RMS is the innovation. A
filter in which alpha plays no role has one row. Exit codes: 0 done; 1 a recording could not be
used, the others were; 2 usage."""


@dataclass(frozen=True)
class Job:
    """What is asked for."""

    recordings: list[str]
    filters: list[str]
    settings: list[Settings]  # one for each α
    reference: str | None
    estimates: list[str]
    jobs: int | None
    scheduler: str | None
    json: str | None
    csv: Path | None
    plot: Path | None
    report: Path | None


def job_of(argv: Sequence[str] | None = None) -> Job:
    """Read the arguments; raise UsageError for what makes no sense, before any work."""
    given = _parser().parse_args(argv)
    found = Job(
        recordings=list(dict.fromkeys(given.recordings)),
        filters=_filters(given.filters),
        settings=[
            Settings(alpha=alpha, alpha_rate=given.alpha_rate) for alpha in sweep(given.alpha)
        ],
        reference=given.reference,
        estimates=list(dict.fromkeys(given.estimate)),
        jobs=given.jobs,
        scheduler=given.scheduler,
        json=given.json,
        csv=given.csv,
        plot=given.plot,
        report=given.report,
    )
    for name in found.estimates:
        if name in found.filters:
            raise UsageError(f"--estimate {name}: a filter has that name; give the topic with /.")
    if found.jobs is not None and found.jobs < 1:
        raise UsageError(f"--jobs must be at least 1, got {found.jobs}.")
    if found.json not in (None, "-"):
        _must_be_writable("--json", Path(found.json))
    if found.csv:
        _must_be_writable("--csv", found.csv)
    if found.plot:
        from .figure import check_plot

        check_plot(found.plot, len(found.recordings), len(found.settings))
        _must_be_writable("--plot", found.plot)
    if found.report:
        if found.report.suffix.lower() not in (".html", ".htm"):
            raise UsageError(f"--report {found.report}: the name must end in .html.")
        _must_be_writable("--report", found.report)
    return found


def _parser() -> Parser:
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
    parser.add_argument(
        "--estimate",
        action="append",
        default=[],
        metavar="TOPIC",
        help="score an orientation that is already in the bags, as a row of its own; repeatable",
    )
    parser.add_argument("--json", metavar="FILE|-", help="write the results as JSON; - is stdout")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the results as CSV")
    parser.add_argument(
        "--report",
        type=Path,
        metavar="FILE.html",
        help="write figures and tables as one page that opens offline",
    )
    parser.add_argument(
        "--plot",
        type=Path,
        metavar="FILE",
        help="draw errors over time and the rotor's elements: .png, .svg or .pdf",
    )
    parser.add_argument(
        "--jobs",
        type=int,
        metavar="N",
        help="processes at a time (default: one for each core if the work is worth it)",
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="let the workers of this Dask scheduler do it, as tcp://host:8786",
    )
    return parser


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
