"""evaluate over several processes, and over the workers of a Dask scheduler."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from turning import turning, write_csv

from stateful_ahrs.errors import AhrsError
from stateful_ahrs.evaluation import evaluate, workers
from stateful_ahrs.evaluation.evaluate import main
from stateful_ahrs.evaluation.options import job_of
from stateful_ahrs.evaluation.workers import Workers, part

ROOT = Path(__file__).parents[1]


@pytest.fixture
def tables(tmp_path) -> list[str]:
    paths = []
    for folder in ("monday", "tuesday", "friday"):
        (tmp_path / folder).mkdir()
        paths.append(write_csv(tmp_path / folder / "walk.csv", turning(200)))
    return paths


def results_of(capsys, *argv: str, code: int = 0) -> list[dict]:
    """The results but for their times."""
    assert main([*argv, "--json", "-"]) == code
    rows = json.loads(capsys.readouterr().out)["results"]
    return [{key: row[key] for key in row if key != "ns_per_sample"} for row in rows]


def twice(number, progress):
    if progress:
        progress(0.5)
    return 2 * number


def killed(number, progress):
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.parametrize("sweep", ["0.99", "0.9:0.999:3"])
def test_several_processes_find_what_one_does_in_the_same_order(sweep, tables, capsys):
    pytest.importorskip("joblib")
    options = ("--filters", "stateful,paper,paper_stateless", "--alpha", sweep)
    alone = results_of(capsys, *tables, *options, "--jobs", "1")
    assert results_of(capsys, *tables, *options, "--jobs", "2") == alone
    assert results_of(capsys, tables[0], *options, "--jobs", "2") == alone[: len(alone) // 3]


def test_a_bad_recording_stops_no_other_process(tables, capsys):
    pytest.importorskip("joblib")
    assert main(["absent.csv", *tables, "--jobs", "2"]) == 1
    written = capsys.readouterr()
    assert written.err == "evaluate: absent.csv: no such file or folder.\n"
    assert len(written.out.splitlines()) == 1 + 3 + 1


def test_progress_is_that_of_the_whole():
    told: list[float] = []
    with Workers(1) as here:
        assert here.each(twice, [1, 2, 3, 4], part(told.append, 0.5, 0.5)) == [2, 4, 6, 8]
    assert told == [0.5625, 0.6875, 0.8125, 0.9375]


def test_progress_counts_what_other_processes_did():
    pytest.importorskip("joblib")
    told: list[float] = []
    with Workers(2) as two:
        assert two.each(twice, [1, 2, 3, 4], told.append) == [2, 4, 6, 8]
    assert told[-1] == 1.0
    assert told == sorted(told)


def test_a_worker_that_is_killed_is_one_sentence():
    pytest.importorskip("joblib")
    with Workers(2) as two, pytest.raises(AhrsError, match="a worker process was killed"):
        two.each(killed, [1, 2])


def test_without_joblib_one_process_does_it_unless_more_are_asked_for(tables, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "joblib", None)
    with Workers(None) as one:
        assert one.here
    assert main([*tables, "--jobs", "2"]) == 1
    assert capsys.readouterr().err == (
        "evaluate: --jobs needs the Python package joblib: "
        "pip install 'stateful_ahrs[parallel]' brings it.\n"
    )


def test_a_plain_evaluation_imports_nothing_that_it_does_not_need(tables):
    command = (
        "import sys; from stateful_ahrs.evaluation.evaluate import main; assert main() == 0; "
        "print({*sys.modules} & {'joblib', 'dask', 'distributed', 'matplotlib'})"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", command, *tables],
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.stdout.splitlines()[-1] == "set()"


def test_a_scheduler_that_is_not_there_is_one_sentence(capsys, monkeypatch):
    pytest.importorskip("joblib")
    pytest.importorskip("distributed")
    monkeypatch.setattr(workers, "PATIENCE", 0.5)
    assert main(["x.csv", "--scheduler", "tcp://127.0.0.1:1"]) == 1
    error = capsys.readouterr().err
    assert error.startswith("evaluate: --scheduler tcp://127.0.0.1:1: no Dask scheduler answers (")
    assert error.count("\n") == 1


def test_dask_takes_over_with_one_option(tables, capsys, monkeypatch, tmp_path):
    pytest.importorskip("joblib")
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed")
    # The workers are processes of their own, at home in another folder.
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.chdir(tmp_path)
    names = [str(Path(path).relative_to(tmp_path)) for path in tables]
    options = ("--filters", "stateful,paper", "--report", str(tmp_path / "report.html"))
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, local_directory=str(tmp_path)
    ) as cluster:
        alone = results_of(capsys, *names, *options, "--jobs", "1")
        assert not cluster.scheduler.transition_log
        found = results_of(capsys, *names, *options, "--scheduler", cluster.scheduler_address)
        # Two filters to compile, then three recordings to evaluate and three to draw.
        finished = {
            key for key, _, state, *_ in cluster.scheduler.transition_log if state == "memory"
        }
    assert len(finished) == 8
    assert [row["rmse_deg"] for row in found] == [row["rmse_deg"] for row in alone]
    assert (tmp_path / "report.html").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("cold", "filters", "jobs"), [(True, "all", None), (True, "paper,gyro", 1), (False, "all", 1)]
)
def test_many_filters_that_are_not_compiled_yet_are_in_several_processes(
    cold, filters, jobs, monkeypatch
):
    monkeypatch.setattr(evaluate, "cold", lambda: cold)
    assert evaluate._jobs(job_of(["x.csv", "--filters", filters])) == jobs
    asked = job_of(["x.csv", "--filters", filters, "--jobs", "1"])
    assert evaluate._jobs(asked) == 1
