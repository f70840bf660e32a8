"""evaluate: filters over recordings, against the truth where it is known."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from ..command import exit_with_sentence
from ..errors import AhrsError
from ..filters.compiled import cold
from ..recordings import Progress
from ..recordings.progress import bar
from .best import best_alphas
from .options import Job, job_of
from .score import Result
from .table import as_json, write_csv, write_table
from .view import View
from .work import Outcome, Task, compile_filter, evaluate_task, joined, view_task
from .workers import Workers, part

STDOUT = "standard output"
FEW = 3  # filters; more are compiled in several processes, as that takes seconds for each
WORTH = 100_000_000  # bytes of recordings × runs: below it, one process is done before two start


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code 0: all done; 1: a recording could not be used; 2: usage."""
    return exit_with_sentence("evaluate", lambda: _evaluate(job_of(argv), argv))


def _evaluate(job: Job, argv: Sequence[str] | None) -> int:
    one = len(job.recordings) == 1
    title = Path(job.recordings[0]).name if one else f"{len(job.recordings)} recordings"
    drawn = job.plot is not None or job.report is not None
    with bar(f"evaluating {title}") as progress, Workers(_jobs(job), job.scheduler) as workers:
        outcomes = _outcomes(job, workers, part(progress, 0.0, 0.6 if drawn else 1.0))
        results = [result for outcome in outcomes for result in outcome.results]
        views = _views(job, outcomes, results, workers, part(progress, 0.6, 0.4)) if drawn else []
    for outcome in outcomes:
        if outcome.error or outcome.remark:
            _say(outcome.error or outcome.remark)
    named = zip(outcomes, job.recordings, strict=True)
    paths = {outcome.recording: Path(path) for outcome, path in named}
    _write(job, results, views, paths, argv)
    for best in best_alphas(results):
        _say(best)
    return int(any(outcome.error for outcome in outcomes))


def _jobs(job: Job) -> int | None:
    """How many processes at most; None for one on each core."""
    most = len(job.recordings) * len(job.filters)
    if job.jobs is not None:
        return min(job.jobs, most)
    work = sum(map(_size, job.recordings)) * len(job.filters) * len(job.settings)
    return None if most > 1 and (work > WORTH or (len(job.filters) > FEW and cold())) else 1


def _size(recording: str) -> int:
    """Bytes; 0 for what cannot be read, which will be told later."""
    path = Path(recording)
    try:
        files = path.iterdir() if path.is_dir() else [path]
        return sum(file.stat().st_size for file in files)
    except OSError:
        return 0


def _outcomes(job: Job, workers: Workers, progress: Progress | None) -> list[Outcome]:
    """What came of each recording, in parts where there are more workers than recordings."""
    if not workers.here:
        workers.each(compile_filter, job.filters, part(progress, 0.0, 0.2))
        progress = part(progress, 0.2, 0.8)
    share = math.ceil(len(job.filters) / math.ceil(workers.size / len(job.recordings)))
    runs = [(name, tuple(job.settings)) for name in job.filters]
    shares = [tuple(runs[start : start + share]) for start in range(0, len(runs), share)]
    if job.scheduler is not None:  # its workers are at home in other folders
        job = replace(job, recordings=[str(Path(path).absolute()) for path in job.recordings])
    tasks = [
        Task(path, own, job.reference, tuple(job.estimates) if own is shares[-1] else ())
        for path in job.recordings
        for own in shares
    ]
    done = workers.each(evaluate_task, tasks, progress)
    outcomes = [joined(done[n : n + len(shares)]) for n in range(0, len(done), len(shares))]
    names: set[str] = set()
    for n, (path, outcome) in enumerate(zip(job.recordings, outcomes, strict=True)):
        if outcome.recording in names:
            outcomes[n] = outcome.renamed(path)
        names.add(outcomes[n].recording)
    return outcomes


def _views(
    job: Job,
    outcomes: Sequence[Outcome],
    results: Sequence[Result],
    workers: Workers,
    progress: Progress | None,
) -> list[View]:
    """What is drawn of each recording that could be used, each filter with its best α."""
    best = {found.filter: found.alpha for found in best_alphas(results)}
    first = job.settings[0]
    chosen = [(name, (replace(first, alpha=best.get(name, first.alpha)),)) for name in job.filters]
    tasks = [
        Task(path, tuple(chosen), job.reference, tuple(job.estimates))
        for path, outcome in zip(job.recordings, outcomes, strict=True)
        if not outcome.error
    ]
    views = workers.each(view_task, tasks, progress)
    names = [outcome.recording for outcome in outcomes if not outcome.error]
    return [replace(view, name=name) for view, name in zip(views, names, strict=True)]


def _write(
    job: Job,
    results: Sequence[Result],
    views: Sequence[View],
    paths: Mapping[str, Path],
    argv: Sequence[str] | None,
) -> None:
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
    if job.csv:
        with _written(job.csv), job.csv.open("w") as file:
            write_csv(results, file)
    if job.plot and views:
        from .figure import draw

        with bar(f"drawing {job.plot.name}"), _written(job.plot):
            draw(views, job.plot)
    if job.report and results:
        from .report import report

        page = report(
            results, views, paths, ["evaluate", *(sys.argv[1:] if argv is None else argv)]
        )
        with _written(job.report):
            job.report.write_text(page, encoding="utf-8")


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


if __name__ == "__main__":
    sys.exit(main())
