"""evaluate: what it prints, writes and refuses."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from turning import turning, write_csv

from stateful_ahrs import filters
from stateful_ahrs.errors import RecordingError, UsageError
from stateful_ahrs.evaluation import score as scoring
from stateful_ahrs.evaluation.best import best_alphas, best_of_each
from stateful_ahrs.evaluation.evaluate import main
from stateful_ahrs.evaluation.metrics import Rmse
from stateful_ahrs.evaluation.options import job_of, sweep
from stateful_ahrs.evaluation.score import (
    Result,
    prepare,
    score,
    scores,
    short_alpha,
    time_constant,
)
from stateful_ahrs.evaluation.table import as_json, write_table
from stateful_ahrs.filters.frames import WorldFrame
from stateful_ahrs.filters.stateful import Settings
from stateful_ahrs.rotor import IDENTITY, product

ROOT = Path(__file__).parents[1]
BAGS = Path(__file__).parent / "bags"
BROAD = ROOT.parent / "shared" / "data" / "broad"


@pytest.fixture
def table(tmp_path) -> str:
    return write_csv(tmp_path / "turning.csv", turning())


def results_of(capsys, *argv: str) -> list[dict]:
    assert main([*argv, "--json", "-"]) == 0
    return json.loads(capsys.readouterr().out)["results"]


# What it finds


def test_all_filters_are_those_of_the_registry():
    assert job_of(["x.csv", "--filters", "all"]).filters == list(filters.FILTERS)


def test_json_has_the_keys_of_the_contract_and_numbers_in_them(table, capsys):
    (result,) = results_of(capsys, table, "--filters", "paper", "--alpha", "0.99")
    assert list(result) == [
        *("recording", "filter", "alpha", "samples"),
        *("rmse_deg", "sign_flips", "ns_per_sample"),
    ]
    assert list(result["rmse_deg"]) == ["total", "heading", "inclination"]
    assert (result["recording"], result["filter"]) == ("turning", "paper")
    assert (result["alpha"], result["samples"], result["sign_flips"]) == (0.99, 300, 0)
    assert all(isinstance(angle, float) for angle in result["rmse_deg"].values())
    assert result["ns_per_sample"] > 0.0


def test_without_noise_the_filter_is_right_in_enu(table, capsys):
    (result,) = results_of(capsys, table)
    # The rates stand at the end of their steps; a wrong frame or side would cost 90° or more.
    assert result["rmse_deg"]["total"] < 0.05


def test_a_known_heading_error_is_found_as_such(tmp_path):
    recording = turning()
    east = (math.cos(0.1), 0.0, 0.0, math.sin(0.1))  # 0.2 rad about the vertical
    reference = np.stack(product(east, tuple(recording.reference.T)), axis=1)
    found = score(prepare(replace(recording, reference=reference)), "stateful", Settings()).rmse
    assert found.heading == pytest.approx(math.degrees(0.2), abs=0.05)
    assert found.inclination < 0.05


def test_the_simulators_bag_shows_why_the_rotor_must_be_stateful(capsys):
    pytest.importorskip("rosbags")
    names = "stateful,paper,paper_stateless"
    found = {
        result["filter"]: result["rmse_deg"]["total"]
        for result in results_of(capsys, str(BAGS / "turns"), "--filters", names)
    }
    # The bag holds the paper's experiment with the noise of the sensor.
    assert found["stateful"] < 1.0
    assert found["paper"] < 2.0
    assert found["paper_stateless"] > 5.0


@pytest.mark.skipif(not BROAD.is_dir(), reason="the BROAD trials are not beside the checkout")
def test_the_papers_filter_scores_at_most_12_5_degrees_on_broad(capsys):
    pytest.importorskip("scipy")
    trials = sorted(map(str, BROAD.glob("*.mat")))
    alpha = str(math.exp(-0.01 / 12.0))  # a time constant of 12 s at 100 Hz
    results = results_of(capsys, *trials, "--filters", "paper", "--alpha", alpha)
    assert len(results) == len(trials) == 15
    assert np.mean([result["rmse_deg"]["total"] for result in results]) < 12.5


def test_without_a_reference_rmse_is_null(tmp_path, capsys):
    path = write_csv(tmp_path / "blind.csv", turning(), "gam")
    assert main([path, "--json", "-"]) == 0
    written = capsys.readouterr()
    assert json.loads(written.out)["results"][0]["rmse_deg"] is None
    said = "evaluate: blind has no reference, so its errors are unknown (columns qw, qx, qy, qz)"
    assert said in written.err
    assert main([path]) == 0
    assert capsys.readouterr().out.splitlines()[1].split()[5:8] == ["-", "-", "-"]


def test_six_axes_are_scored_and_the_heading_explained(tmp_path, capsys):
    path = write_csv(tmp_path / "six.csv", turning(), "gaq")
    assert main([path]) == 0
    written = capsys.readouterr()
    assert "six has no magnetometer samples" in written.err
    assert float(written.out.splitlines()[1].split()[7]) < 0.05  # inclination needs none


def test_samples_that_are_not_finite_cost_nothing_but_themselves(tmp_path, capsys):
    recording = turning()
    recording.gyro[100] = recording.accel[150] = recording.mag[200] = np.nan
    recording.reference[:50] = np.nan
    (result,) = results_of(capsys, write_csv(tmp_path / "holes.csv", recording))
    # One held rate of 1 rad/s that wanders by 0.01 rad/s in the sample.
    assert result["rmse_deg"]["total"] < 0.1
    assert result["samples"] == 300


def test_a_reference_at_its_own_rate_is_brought_to_the_samples():
    recording = turning()
    slow = replace(
        recording,
        reference_stamps=recording.stamps[::7] + 0,
        reference=recording.reference[::7],
    )
    found = score(prepare(slow), "stateful", Settings()).rmse.total
    exact = score(prepare(recording), "stateful", Settings()).rmse.total
    # 1 rad/s that turns by 1 rad/s within 70 ms bends by 0.07²/8 rad.
    assert found == pytest.approx(exact, abs=math.degrees(0.07**2 / 8.0))


def test_a_sample_that_every_filter_skips_is_not_scored():
    recording = turning()
    stamps = recording.stamps.copy()
    stamps[200] = stamps[199]
    wrong = recording.reference.copy()
    wrong[200] = (0.0, 1.0, 0.0, 0.0)
    trial = prepare(replace(recording, stamps=stamps, mag_stamps=stamps, reference=wrong))
    assert not trial.truth.counts[200]
    assert trial.truth.counts.sum() == 299


def test_alpha_is_for_each_sample_when_its_rate_is_zero(table, capsys):
    run = filters.make("paper", Settings(alpha=0.9, alpha_rate=0.0))
    expected = prepare(turning())
    rotors = WorldFrame("enu").all(run.run(expected.samples))
    (result,) = results_of(
        capsys, table, "--filters", "paper", "--alpha", "0.9", "--alpha-rate", "0"
    )
    total = scoring.rmse_deg(rotors, expected.truth).total
    assert result["rmse_deg"]["total"] == pytest.approx(total, rel=1e-9)
    settings = Settings(alpha=0.9, alpha_rate=0.0)
    assert time_constant(settings, expected.samples) == pytest.approx(-0.01 / math.log(0.9))


def test_compiling_is_not_counted_as_time_of_the_filter(monkeypatch):
    now = 0.0

    class Slow:
        """Takes 100 s to compile and 1 s to run."""

        compiled = uses_alpha = False

        def run(self, samples):
            nonlocal now
            now += 1.0 if self.compiled else 100.0
            self.compiled = True
            return np.tile(IDENTITY, (len(samples), 1))

    monkeypatch.setitem(filters.FILTERS, "slow", lambda settings: Slow())
    monkeypatch.setattr(scoring.time, "perf_counter", lambda: now)
    result = score(prepare(turning(100)), "slow", Settings())
    assert result.ns_per_sample == pytest.approx(1e9 / 100)


def test_sign_flips_are_those_of_the_filters_rotors(monkeypatch):
    class Flipping:
        uses_alpha = True

        def run(self, samples):
            rotors = np.tile(IDENTITY, (len(samples), 1))
            rotors[10:20] *= -1.0
            return rotors

    monkeypatch.setitem(filters.FILTERS, "flipping", lambda settings: Flipping())
    assert score(prepare(turning()), "flipping", Settings()).sign_flips == 2


# Sweeps


def test_a_sweep_has_its_ends_exactly_and_equal_ratios_of_1_minus_alpha():
    values = sweep("0.1:0.9999:30")  # 1 - (1 - 0.1) is not 0.1
    rest = 1.0 - np.array(values)
    assert (values[0], values[-1], len(values)) == (0.1, 0.9999, 30)
    assert rest[1:] / rest[:-1] == pytest.approx(np.full(29, (1e-4 / 0.9) ** (1 / 29)), rel=1e-9)


def test_a_sweep_may_run_down_and_from_zero():
    assert sweep("0.9:0:2") == [0.9, 0.0]


def test_a_sweep_gives_each_filter_each_alpha(table, capsys):
    found = results_of(capsys, table, "--filters", "stateful,paper", "--alpha", "0.9:0.999:3")
    assert [(result["filter"], result["alpha"]) for result in found] == [
        (name, alpha) for name in ("stateful", "paper") for alpha in sweep("0.9:0.999:3")
    ]


def test_the_best_alpha_of_a_sweep_is_marked_and_told(table, tmp_path, capsys):
    csv, file = str(tmp_path / "x.csv"), str(tmp_path / "x.json")
    assert main([table, "--alpha", "0:0.99:4", "--json", file, "--csv", csv]) == 0
    written = capsys.readouterr()
    found = json.loads(Path(file).read_text())
    totals = {result["alpha"]: result["rmse_deg"]["total"] for result in found["results"]}
    (best,) = found["best"]
    assert best["alpha"] == min(totals, key=totals.__getitem__)
    assert (best["by"], best["error_deg"]) == ("reference", totals[best["alpha"]])
    marked = [line for line in written.out.splitlines() if "*" in line]
    assert [line.split()[2] for line in marked] == [f"{short_alpha(best['alpha'])}*"]
    assert "the best alpha of stateful by the total error against the reference: " in written.err


def test_without_a_reference_alpha_is_ranked_by_self_consistency_and_that_is_said(tmp_path, capsys):
    path = write_csv(tmp_path / "blind.csv", turning(600), "gam")
    assert main([path, "--alpha", "0:0.99:4", "--json", "-"]) == 0
    written = capsys.readouterr()
    found = json.loads(written.out)
    innovations = {result["alpha"]: result["innovation_deg"] for result in found["results"]}
    assert found["best"][0]["alpha"] == min(innovations, key=innovations.__getitem__)
    assert found["best"][0]["by"] == "self-consistency"
    assert all(result["rmse_deg"] is None for result in found["results"])
    assert "by self-consistency, as there is no reference: " in written.err
    assert "innovation" in written.err.splitlines()[1]


def test_an_end_of_the_sweep_that_is_best_is_told_as_such(table, capsys):
    settings = [Settings(alpha=alpha) for alpha in (0.2, 0.1, 0.0)]
    found = [
        result(filter="f", alpha=each.alpha, rmse=Rmse(each.alpha + 1.0, 0.0, 0.0))
        for each in settings
    ]
    (best,) = best_alphas(found)
    assert (best.alpha, best.at_end) == (0.0, True)
    assert "That is an end of the sweep" in str(best)
    assert "end of the sweep" not in str(replace(best, alpha=0.1))


def test_the_best_alpha_of_several_recordings_has_the_least_mean_where_the_truth_is_known():
    found = [
        result(recording=name, alpha=alpha, rmse=rmse, innovation=innovation)
        for name, errors in {"a": (1.0, 2.0, 9.0), "b": (9.0, 3.0, 1.0), "blind": (0, 0, 0)}.items()
        for alpha, error in zip((0.5, 0.6, 0.7), errors, strict=True)
        for rmse, innovation in [
            (None, 10.0 * alpha) if name == "blind" else (Rmse(error, 0.0, 0.0), None)
        ]
    ]
    (best,) = best_alphas(found)
    assert (best.alpha, best.error, best.recordings, best.by) == (0.6, 2.5, 2, "reference")
    assert {(one.recording, one.alpha) for one in best_of_each(found)} == {
        ("a", 0.5),
        ("b", 0.7),
        ("blind", 0.5),
    }


def test_a_filter_in_which_alpha_plays_no_role_has_one_row(monkeypatch):
    settings = [Settings(alpha=alpha) for alpha in sweep("0.9:0.99:9")]
    for chosen in (settings, settings[:1]):
        for name in ("ekf", "gyro"):
            (found,) = scores(prepare(turning(50)), name, chosen)
            assert (found.alpha, found.time_constant) == (None, None)
    assert len(list(scores(prepare(turning(50)), "paper", settings))) == 9


def test_a_sweep_of_one_recording_takes_each_alpha_once(monkeypatch):
    runs = []

    class Counted:
        uses_alpha = True

        def __init__(self, settings):
            self.alpha = settings.alpha

        def run(self, samples):
            if len(samples) > 1:  # the first sample alone compiles it
                runs.append(self.alpha)
            return np.tile((self.alpha, 1.0, 0.0, 0.0), (len(samples), 1))

    monkeypatch.setitem(filters.FILTERS, "counted", Counted)
    settings = [Settings(alpha=alpha) for alpha in sweep("0.9:0.99:9")]
    found = list(scores(prepare(turning(50)), "counted", settings))
    assert [row.alpha for row in found] == sorted(runs) == sweep("0.9:0.99:9")


# Bad recordings: exit code 1, and the others are still evaluated


def test_a_bad_recording_is_named_and_the_others_are_still_evaluated(table, tmp_path, capsys):
    assert main(["absent.mat", table]) == 1
    written = capsys.readouterr()
    assert written.err == "evaluate: absent.mat: no such file or folder.\n"
    assert written.out.splitlines()[1].startswith("turning ")


def test_json_is_written_even_if_no_recording_could_be_used(tmp_path, capsys):
    assert main(["absent.mat", "--json", "-"]) == 1
    assert json.loads(capsys.readouterr().out) == {"results": []}


def test_a_recording_of_nan_is_refused_with_a_sentence(tmp_path, capsys):
    recording = turning(30)
    recording.accel[:] = np.nan
    assert main([write_csv(tmp_path / "nothing.csv", recording)]) == 1
    assert capsys.readouterr().err == (
        "evaluate: nothing: none of its 30 IMU samples has finite rates and accelerations.\n"
    )


def test_a_recording_without_samples_is_refused():
    empty = turning(0)
    shaped = replace(empty, gyro=np.empty((0, 3)), accel=np.empty((0, 3)), mag=np.empty((0, 3)))
    with pytest.raises(RecordingError, match="none of its 0 IMU samples"):
        prepare(replace(shaped, reference_stamps=None, reference=None))


def test_a_reference_of_another_time_is_refused_with_both_times():
    recording = turning()
    late = recording.stamps + 60 * 10**9
    with pytest.raises(RecordingError, match=r"from 1\.000 to 3\.990 s .* from 61\.000 to 63\.990"):
        prepare(replace(recording, reference_stamps=late))


def test_a_reference_that_is_never_known_is_refused():
    recording = turning()
    with pytest.raises(RecordingError, match="none of the 300 rotors of its reference is finite"):
        prepare(replace(recording, reference=np.full((300, 4), np.nan)))


def test_a_reference_that_never_counts_is_refused():
    with pytest.raises(RecordingError, match="unknown in all the phases that count"):
        prepare(replace(turning(), movement=np.zeros(300, bool)))


def test_loops_that_cannot_be_matched_are_refused():
    recording = turning()
    looped = np.concatenate([recording.stamps[:150], recording.stamps[:150]])
    received = recording.stamps
    with pytest.raises(RecordingError, match=r"jump back 1 time .* reference 0 times"):
        prepare(
            replace(
                recording,
                stamps=looped,
                received=received,
                mag_received=received,
                reference_received=received,
            )
        )


# Usage: exit code 2


@pytest.mark.parametrize(
    ("argv", "sentence"),
    [
        ([], "the following arguments are required: RECORDING"),
        (["x.csv", "--speed", "9"], "unrecognized arguments: --speed 9"),
        (["x.csv", "--filters", "stateful,madgwick"], "there is no filter 'madgwick'; there are "),
        (["x.csv", "--filters", ","], "--filters needs a name: stateful, "),
        (["x.csv", "--alpha", "1.2"], "alpha must be between 0 and 1, got 1.2."),
        (["x.csv", "--alpha", "nan"], "alpha must be between 0 and 1, got nan."),
        (["x.csv", "--alpha", "high"], "--alpha must be a number or START:STOP:COUNT"),
        (["x.csv", "--alpha", "0.9:0.99"], "--alpha must be a number or START:STOP:COUNT"),
        (["x.csv", "--alpha", "0.9:1:9"], "a sweep of alpha goes from 0 to below 1"),
        (["x.csv", "--alpha", "nan:0.9:9"], "a sweep of alpha goes from 0 to below 1"),
        (["x.csv", "--alpha", "0.9:0.99:1"], "a sweep of alpha has 2 to 1000 values"),
        (["x.csv", "--alpha", "0.9:0.99:1000000"], "a sweep of alpha has 2 to 1000 values"),
        (["x.csv", "--alpha-rate", "-1"], "alpha_rate must be between 0"),
        (["x.csv", "--alpha-rate", "nan"], "alpha_rate must be between 0"),
        (["x.csv", "--alpha-rate", "often"], "argument --alpha-rate: invalid float value: 'often'"),
        (["x.csv", "--json", "no/such/x.json"], "--json no/such/x.json: there is no folder"),
        (["x.csv", "--json", "."], "--json . is a folder"),
        (["x.csv", "--csv", "no/such/x.csv"], "--csv no/such/x.csv: there is no folder"),
        (["x.csv", "--jobs", "0"], "--jobs must be at least 1, got 0."),
        (["x.csv", "--jobs", "two"], "argument --jobs: invalid int value: 'two'"),
        (["x.csv", "--plot", "x.gif"], "--plot x.gif: the name must end in .png, .svg, .pdf."),
        (["x.csv", "--plot", "x.png", "--alpha", "0.9:0.99:3"], "--plot draws one alpha"),
    ],
)
def test_wrong_usage_is_one_sentence_and_exit_code_2(argv, sentence, capsys):
    assert main(argv) == 2
    written = capsys.readouterr()
    assert written.err.startswith(f"evaluate: {sentence}")
    assert written.err.count("\n") == 1
    assert written.err.endswith(".\n")
    assert written.out == ""


def test_every_filter_that_exists_is_named_when_one_does_not(capsys):
    assert main(["x.csv", "--filters", "nope"]) == 2
    sentence = capsys.readouterr().err
    assert all(name in sentence for name in filters.FILTERS)


def test_a_file_that_cannot_be_written_is_one_sentence(table, tmp_path, capsys):
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    assert main([table, "--json", "/dev/full"]) == 1
    assert capsys.readouterr().err == (
        "evaluate: /dev/full cannot be written: No space left on device.\n"
    )


def test_a_bad_sweep_raises_before_any_work():
    with pytest.raises(UsageError):
        sweep("0.9:0.99:two")


# What is printed


def result(**fields) -> Result:
    given = {
        "recording": "01_a_long_name_for_a_recording_of_a_day_in_the_field",
        "filter": "paper_stateless",
        "alpha": 0.9991670,
        "time_constant": 12.0,
        "samples": 57000,
        "rmse": Rmse(10.0, 6.0, 8.0),
        "sign_flips": 3,
        "ns_per_sample": 61.5,
    }
    return Result(**{**given, **fields})


def run(*argv: str, stdout: int = subprocess.PIPE) -> subprocess.Popen[str]:
    """The command as a process of its own."""
    environment = {**os.environ, "COLUMNS": "30", "PYTHONPATH": str(ROOT)}
    command = "import sys; from stateful_ahrs.evaluation.evaluate import main; sys.exit(main())"
    return subprocess.Popen(
        [sys.executable, "-c", command, *argv],
        env=environment,
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_a_pipe_gets_a_plain_line_for_each_result_and_nothing_shortened(table):
    process = run(table, "--filters", "paper,paper_stateless")
    out, err = process.communicate(timeout=120)
    assert (process.returncode, err) == (0, "")
    header, *rows = out.splitlines()
    assert header.split() == [
        *("recording", "filter", "alpha", "tau", "(s)", "samples"),
        *("total", "heading", "inclination", "flips", "ns/sample"),
    ]
    assert [row.split()[:5] for row in rows] == [
        ["turning", "paper", "0.9967", "3.025", "300"],
        ["turning", "paper_stateless", "0.9967", "3.025", "300"],
    ]
    assert all(len(row.split()) == 10 for row in rows)
    assert out.isascii()


@pytest.mark.parametrize("options", [[], ["--json", "-"]])
def test_a_reader_that_leaves_ends_it_quietly(options, table):
    read, write = os.pipe()
    os.close(read)
    process = run(table, *options, stdout=write)
    os.close(write)
    err = process.communicate(timeout=120)[1]
    assert "Traceback" not in err
    assert "Broken" not in err


def test_a_full_disk_behind_stdout_is_one_sentence(table):
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    with open("/dev/full", "w") as full:
        process = run(table, stdout=full.fileno())
        err = process.communicate(timeout=120)[1]
    assert err.splitlines()[0] == (
        "evaluate: standard output cannot be written: No space left on device."
    )
    assert "Traceback" not in err


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("columns", [40, 90, 110, 300])
def test_a_terminal_of_any_width_loses_no_digit(columns, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.setenv("TERM", "dumb")
    terminal = Terminal()
    write_table([result(), result(filter="paper")], terminal)
    shown = terminal.getvalue()
    assert "…" not in shown
    assert "paper_stateless  0.999167       12    57000  10.00     6.00" in shown
    assert "inclination  flips  ns/sample" in shown


def test_several_recordings_have_a_mean_for_each_filter_and_alpha(capsys):
    results = [
        result(recording="a", filter="paper", rmse=Rmse(10.0, 6.0, 8.0)),
        result(recording="a", filter="stateful", rmse=Rmse(1.0, 1.0, 1.0)),
        result(recording="b", filter="paper", rmse=Rmse(20.0, 7.0, 9.0), sign_flips=0),
        result(recording="b", filter="stateful", rmse=Rmse(2.0, 2.0, 2.0)),
    ]
    write_table(results, sys.stdout)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 1 + 4 + 2
    cells = lines[5].split()
    assert cells[:4] == ["mean", "of", "2", "paper"]
    assert cells[7:] == ["15.00", "6.50", "8.50", "1.5", "62"]


def test_the_mean_leaves_out_recordings_without_a_reference(capsys):
    names = ["a", "b", "c"]
    results = [result(recording=name, rmse=Rmse(4.0, 4.0, 4.0)) for name in names]
    write_table([*results, result(recording="blind", rmse=None)], sys.stdout)
    assert capsys.readouterr().out.splitlines()[-1].startswith("mean of 3 ")


def test_one_recording_has_no_mean(table, capsys):
    assert main([table]) == 0
    assert "mean" not in capsys.readouterr().out


def test_json_on_stdout_stands_alone(table, capsys):
    assert main([table, "--json", "-"]) == 0
    written = capsys.readouterr()
    json.loads(written.out)
    assert written.err.startswith("recording ")


def test_json_in_a_file_is_that_of_stdout(table, tmp_path, capsys):
    target = tmp_path / "out.json"
    assert main([table, "--json", str(target)]) == 0
    written = capsys.readouterr()
    assert written.out.startswith("recording ")
    (found,) = json.loads(target.read_text())["results"]
    (other,) = results_of(capsys, table)
    found["ns_per_sample"] = other["ns_per_sample"]
    assert found == other


def test_csv_has_the_same_in_full_precision(table, tmp_path, capsys):
    target = tmp_path / "out.csv"
    argv = (table, "--filters", "stateful,paper", "--csv", str(target), "--json", "-")
    assert main([*argv]) == 0
    results = json.loads(capsys.readouterr().out)["results"]
    rows = list(csv.DictReader(target.open(newline="")))
    assert len(rows) == len(results) == 2
    for row, found in zip(rows, results, strict=True):
        assert (row["recording"], row["filter"]) == (found["recording"], found["filter"])
        for key in ("alpha", "samples", "sign_flips", "ns_per_sample"):
            assert float(row[key]) == found[key]
        for key, angle in found["rmse_deg"].items():
            assert float(row[f"{key}_deg"]) == angle
        assert float(row["time_constant_s"]) == Settings().time_constant
        assert row["innovation_deg"] == ""


def test_json_keeps_alpha_as_it_is():
    alpha = 0.9 + 1e-15
    assert as_json([result(alpha=alpha)])["results"][0]["alpha"] == alpha


def test_recordings_of_one_name_are_told_apart(tmp_path, capsys):
    paths = []
    for folder in ("monday", "tuesday"):
        (tmp_path / folder).mkdir()
        paths.append(write_csv(tmp_path / folder / "walk.csv", turning(50)))
    names = [found["recording"] for found in results_of(capsys, *paths)]
    assert names == ["walk", paths[1]]


@pytest.mark.parametrize(
    ("alpha", "shown"),
    [(0.0, "0"), (0.5, "0.5"), (0.999167, "0.999167"), (0.99999999, "0.99999999"), (1.0, "1")],
)
def test_alpha_is_shown_with_the_digits_that_tell_it_from_one(alpha, shown):
    assert short_alpha(alpha) == shown


# The figure


@pytest.mark.parametrize(
    ("suffix", "begins"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")]
)
def test_a_plot_is_drawn_in_the_form_of_its_suffix(suffix, begins, table, tmp_path):
    pytest.importorskip("matplotlib")
    target = tmp_path / f"figure.{suffix}"
    assert main([table, "--filters", "paper,paper_stateless,gyro", "--plot", str(target)]) == 0
    assert target.read_bytes().startswith(begins)


def test_the_same_plot_is_the_same_file(table, tmp_path):
    pytest.importorskip("matplotlib")
    files = [tmp_path / "one.svg", tmp_path / "two.svg"]
    for file in files:
        assert main([table, "--plot", str(file)]) == 0
    assert files[0].read_bytes() == files[1].read_bytes()


def test_a_plot_names_its_filters_with_their_errors(table, tmp_path, capsys):
    matplotlib = pytest.importorskip("matplotlib")
    target = tmp_path / "figure.svg"
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        assert main([table, "--filters", "stateful,paper_stateless", "--plot", str(target)]) == 0
    drawn = target.read_text()
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[1:]]
    for row in rows:
        assert f"{row[1]}  {float(row[5]):.1f}°" in drawn


@pytest.mark.parametrize("rows", [1, 2, 40])
def test_short_and_blind_recordings_are_drawn_too(rows, tmp_path):
    pytest.importorskip("matplotlib")
    paths = [
        write_csv(tmp_path / "short.csv", turning(rows)),
        write_csv(tmp_path / "blind.csv", turning(rows), "ga"),
    ]
    assert main([*paths, "--plot", str(tmp_path / "figure.png")]) == 0
    assert (tmp_path / "figure.png").stat().st_size > 1000
