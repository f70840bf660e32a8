"""Where tasks are done: in this process, in several of this machine, or on a Dask cluster."""

from __future__ import annotations

import os
import signal
import threading
import warnings
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from importlib.util import find_spec
from typing import Any, TypeVar

from ..errors import AhrsError
from ..recordings import Progress

Task = TypeVar("Task")
Done = TypeVar("Done")

PACKAGE = __name__.partition(".")[0]
PATIENCE = 10.0  # s, for a scheduler to answer


class Workers:
    """Does tasks; ``size`` of them at a time.

    ``jobs`` processes, None for one on each core if joblib is there to start them. With the
    address of a Dask ``scheduler`` its workers do them, which must see the recordings under the
    same paths and, as the scheduler, have this package; if they have one core in all, joblib
    does the tasks here.
    """

    def __init__(self, jobs: int | None = 1, scheduler: str | None = None) -> None:
        self._jobs = jobs
        self._scheduler = scheduler
        self._backend: dict[str, Any] = {"backend": "loky"}
        self._opened = ExitStack()
        self.size = 1

    def __enter__(self) -> Workers:
        """Raise AhrsError where joblib, Dask or the scheduler is missing."""
        if self._scheduler is not None:
            self.size = self._connect(self._scheduler)
        elif self._jobs != 1:
            self.size = self._processes(self._jobs)
        return self

    def __exit__(self, *_: object) -> None:
        self._opened.close()

    @property
    def here(self) -> bool:
        """Whether this process does the tasks."""
        return self.size == 1 and self._scheduler is None

    def each(
        self,
        function: Callable[[Task, Progress | None], Done],
        tasks: Sequence[Task],
        progress: Progress | None = None,
    ) -> list[Done]:
        """What the function returns for each task.

        Function, tasks and what it returns must be picklable. It is called with a `Progress` of
        its own where this process does the task, else with None.
        """
        if self.here:
            return [
                function(task, part(progress, number / len(tasks), 1.0 / len(tasks)))
                for number, task in enumerate(tasks)
            ]
        import joblib  # type: ignore[import-untyped]
        from joblib.externals.loky.process_executor import (  # type: ignore[import-untyped]
            TerminatedWorkerError,
        )

        class Counted(joblib.Parallel):  # type: ignore[misc]
            def print_progress(self) -> None:  # joblib calls it when a task is done
                if progress:
                    progress(self.n_completed_tasks / len(tasks))

        try:
            with joblib.parallel_config(**self._backend), warnings.catch_warnings():
                # of a worker that has grown: another takes its place
                warnings.filterwarnings("ignore", "A worker stopped while", UserWarning)
                counted = Counted(n_jobs=self.size, batch_size=1)
                done: list[Done] = counted(
                    joblib.delayed(_do)(function, task, os.getpid()) for task in tasks
                )
        except TerminatedWorkerError:
            raise AhrsError(
                "a worker process was killed, as happens where memory is short; "
                "try with fewer --jobs."
            ) from None
        return done

    def _processes(self, jobs: int | None) -> int:
        try:
            import joblib
        except ModuleNotFoundError as error:
            if jobs is None:
                return 1
            raise _missing("--jobs", error, "parallel") from None
        return jobs or int(joblib.cpu_count())

    def _connect(self, address: str) -> int:
        try:
            import joblib  # noqa: F401
            from distributed import Client
        except ModuleNotFoundError as error:
            raise _missing("--scheduler", error, "cluster") from None
        try:
            client: Any = self._opened.enter_context(Client(address, timeout=PATIENCE))  # type: ignore[no-untyped-call]
        except (OSError, ValueError) as error:
            raise AhrsError(
                f"--scheduler {address}: no Dask scheduler answers ({error})."
            ) from None
        found = {
            **client.run(find_spec, PACKAGE),
            address: client.run_on_scheduler(find_spec, PACKAGE),
        }
        for where, package in found.items():
            if package is None:
                raise AhrsError(f"--scheduler {address}: {where} lacks the package {PACKAGE}.")
        self._backend = {"backend": "dask", "client": client}
        cores = sum(client.ncores().values())
        if not cores:
            raise AhrsError(
                f"--scheduler {address}: it has no workers; start some with dask worker."
            )
        return int(cores)


def part(progress: Progress | None, start: float, size: float) -> Progress | None:
    """The progress of a part of the work, told as that of the whole."""
    return progress and (lambda done: progress(start + size * done))


def _do(function: Callable[[Task, None], Done], task: Task, asked_by: int) -> Done:
    """Do a task that a process asked for."""
    if os.getpid() != asked_by and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends a worker without a traceback
    return function(task, None)


def _missing(option: str, error: ModuleNotFoundError, extra: str) -> AhrsError:
    return AhrsError(
        f"{option} needs the Python package {error.name}: "
        f"pip install 'stateful_ahrs[{extra}]' brings it."
    )
