"""Which α a sweep found best, and by what."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

from .score import Result, short_alpha

REFERENCE = "reference"
CONSISTENCY = "self-consistency"


@dataclass(frozen=True)
class Best:
    """The best α of a filter over one or several recordings."""

    filter: str
    alpha: float
    time_constant: float | None  # s; None where recordings differ in it
    by: str  # `REFERENCE` or `CONSISTENCY`
    errors: Mapping[float, float]  # of each α, degrees: the mean total error, or innovation
    recordings: int

    @property
    def error(self) -> float:
        """The least of the errors."""
        return self.errors[self.alpha]

    @property
    def at_end(self) -> bool:
        """Whether the best is at an end of the sweep: a better one may lie beyond."""
        return self.alpha in (min(self.errors), max(self.errors))

    def __str__(self) -> str:
        """A sentence that says by what it is the best."""
        tau = "" if self.time_constant is None else f" (tau {self.time_constant:.3g} s)"
        by, what = "the total error against the reference", "RMSE"
        if self.by == CONSISTENCY:
            by, what = "self-consistency, as there is no reference", "innovation"
        mean = f", mean of {self.recordings} recordings" if self.recordings > 1 else ""
        end = ". That is an end of the sweep: a better one may lie beyond" if self.at_end else ""
        return (
            f"the best alpha of {self.filter} by {by}: {short_alpha(self.alpha)}{tau}, "
            f"{what} {self.error:.2f} degrees{mean}{end}."
        )


def best_alphas(results: Iterable[Result]) -> list[Best]:
    """The best α of each filter that has several.

    Recordings with a reference decide; where none has one, the innovation of all does.
    """
    swept: dict[str, list[Result]] = {}
    for result in results:
        if result.alpha is not None and result.error is not None:
            swept.setdefault(result.filter, []).append(result)
    found = (_best(name, own) for name, own in swept.items())
    return [best for best in found if best]


def best_of_each(results: Sequence[Result]) -> set[Result]:
    """The results with the best α of their recording and filter."""
    runs: dict[tuple[str, str], list[Result]] = {}
    for result in results:
        if result.alpha is not None and result.error is not None:
            runs.setdefault((result.recording, result.filter), []).append(result)
    return {min(own, key=_error) for own in runs.values() if len(own) > 1}


def _best(name: str, own: list[Result]) -> Best | None:
    told = [result for result in own if result.rmse]
    by = REFERENCE if told else CONSISTENCY
    rows: dict[float, list[Result]] = {}
    for result in told or own:
        assert result.alpha is not None
        rows.setdefault(result.alpha, []).append(result)
    if len(rows) == 1:
        return None
    errors = {alpha: fmean(map(_error, of_alpha)) for alpha, of_alpha in rows.items()}
    alpha = min(errors, key=errors.__getitem__)
    constants = {result.time_constant for result in rows[alpha]}
    return Best(
        filter=name,
        alpha=alpha,
        time_constant=constants.pop() if len(constants) == 1 else None,
        by=by,
        errors=errors,
        recordings=len(rows[alpha]),
    )


def _error(result: Result) -> float:
    assert result.error is not None
    return result.error
