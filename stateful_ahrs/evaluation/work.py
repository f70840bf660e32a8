"""What a worker does with one recording: load it, run filters over it, send back what is small."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .. import filters
from ..errors import AhrsError, UsageError
from ..filters.samples import Samples
from ..filters.stateful import Settings
from ..recordings import Progress, load
from .score import Result, Trial, prepare, score_estimate, scores
from .view import View, look
from .workers import part


@dataclass(frozen=True)
class Task:
    """A recording and what to run over it."""

    path: str
    runs: tuple[tuple[str, tuple[Settings, ...]], ...]  # filters, each with one or several α
    reference: str | None = None
    estimates: tuple[str, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """What came of a recording."""

    recording: str
    results: tuple[Result, ...] = ()
    remark: str | None = None  # what the user should know of the results
    error: str | None = None  # why the recording could not be used

    def renamed(self, name: str) -> Outcome:
        """The same under another name."""
        results = tuple(replace(result, recording=name) for result in self.results)
        remark = self.remark and self.remark.replace(self.recording, name, 1)
        return Outcome(name, results, remark, self.error)


def joined(parts: Sequence[Outcome]) -> Outcome:
    """The outcome of a recording from those of its parts."""
    first, *_ = parts
    return next((part for part in parts if part.error), None) or replace(
        first, results=tuple(result for part in parts for result in part.results)
    )


def compile_filter(name: str, progress: Progress | None = None) -> None:
    """Run a filter over one sample, which compiles it and leaves it in numba's cache."""
    once = np.ones((1, 3))
    filters.make(name).run(Samples(np.ones(1, np.int64), once, once, once))


def evaluate_task(task: Task, progress: Progress | None = None) -> Outcome:
    """The results of all runs of the task; only a `UsageError` is raised."""
    try:
        trial = _trial(task, progress)
        results: list[Result] = []
        for done, (name, settings) in enumerate(task.runs):
            results += scores(trial, name, settings)
            if progress:
                progress(0.5 + 0.5 * (done + 1) / len(task.runs))
        results += [score_estimate(trial, topic) for topic in task.estimates]
    except UsageError:
        raise
    except AhrsError as error:
        return Outcome(task.path, error=str(error))
    return Outcome(trial.name, tuple(results), _remark(trial, task.path))


def view_task(task: Task, progress: Progress | None = None) -> View:
    """What is drawn of a recording, with the first settings of each filter."""
    chosen = {name: settings[0] for name, settings in task.runs}
    return look(_trial(task, progress), chosen)


def _trial(task: Task, progress: Progress | None) -> Trial:
    loading = part(progress, 0.0, 0.5)
    return prepare(load(task.path, task.reference, loading, task.estimates))


def _remark(trial: Trial, path: str) -> str | None:
    name = trial.name
    said = [f"{name}: {choice}" for choice in trial.choices]
    if trial.truth is None:
        where = "columns qw, qx, qy, qz" if path.endswith(".csv") else "see --reference"
        said.append(f"{name} has no reference, so its errors are unknown ({where}).")
    elif not trial.has_mag:
        said.append(f"{name} has no magnetometer samples: its heading starts at any angle.")
    return " ".join(said) or None
