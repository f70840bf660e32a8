"""The executable `convert`."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from recorded import START, Bag, recording

from stateful_ahrs.recordings import load, write
from stateful_ahrs.recordings.convert import main

pytest.importorskip("rosbags")

COMMAND = [sys.executable, "-c", "from stateful_ahrs.recordings.convert import main; exit(main())"]


@pytest.fixture
def walk(tmp_path) -> Path:
    """A ROS 1 bag with more in it than a recording takes."""
    with Bag(tmp_path / "walk.bag") as bag:
        for n in range(5):
            bag.add("/imu/data_raw", bag.imu(START + 10_000_000 * n), START + 10_000_000 * n)
            bag.add("/imu/mag", bag.mag(START), START + 10_000_000 * n)
        odometry = bag.truth("nav_msgs/msg/Odometry", START, (0.0, 1.0, 0.0, 0.0))
        bag.add("/odom", odometry, START)
    return tmp_path / "walk.bag"


@pytest.mark.parametrize(("storage", "suffix"), [("mcap", ".mcap"), ("sqlite3", ".db3")])
def test_one_input_becomes_one_bag(walk, tmp_path, capsys, storage, suffix):
    out = tmp_path / "new" / "bag"
    assert main([str(walk), "-o", str(out), "--storage", storage]) == 0
    assert sorted(path.name for path in out.iterdir()) == [f"bag{suffix}", "metadata.yaml"]
    assert np.array_equal(load(out).stamps, load(walk).stamps)
    assert capsys.readouterr().out.splitlines() == [
        f"walk: 5 samples in 0.0 s, inertial 100.0 Hz, magnetometer 0 Hz, written to {out}",
        "walk: left out /odom (nav_msgs/msg/Odometry)",
    ]


def test_a_reference_topic_of_another_type_becomes_ground_truth(walk, tmp_path, capsys):
    assert main([str(walk), "-o", str(tmp_path / "bag"), "--reference", "/odom"]) == 0
    assert load(tmp_path / "bag").reference.tolist() == [[0.0, 1.0, 0.0, 0.0]]
    assert "left out" not in capsys.readouterr().out


def test_several_inputs_become_a_bag_each_and_a_bad_one_does_not_stop_the_rest(
    walk, tmp_path, capsys
):
    write(recording(), tmp_path / "noise")
    (tmp_path / "bad.mcap").write_bytes(b"nothing of the kind")
    inputs = [str(tmp_path / name) for name in ("noise", "bad.mcap", "gone.mat", "walk.bag")]
    assert main([*inputs, "-o", str(tmp_path / "out")]) == 1
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["noise", "walk"]
    assert len(load(tmp_path / "out" / "noise")) == 50
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 2
    assert errors[0].startswith("convert: bad.mcap is damaged or not a bag (")
    assert errors[1] == f"convert: {tmp_path / 'gone.mat'}: no such file or folder."


def test_an_existing_bag_is_kept_unless_told_otherwise(walk, tmp_path, capsys):
    out = tmp_path / "bag"
    write(recording(), out)
    assert main([str(walk), "-o", str(out)]) == 1
    assert capsys.readouterr().err == f"convert: {out} exists already; --overwrite replaces it.\n"
    assert len(load(out)) == 50
    assert main([str(walk), "-o", str(out), "--overwrite"]) == 0
    assert len(load(out)) == 5


def test_an_input_is_never_overwritten(tmp_path, capsys):
    write(recording(), tmp_path / "noise")
    for source in ("noise", "noise/noise.mcap"):
        command = [str(tmp_path / source), "-o", str(tmp_path / "noise"), "--overwrite"]
        assert main(command) == 2
        assert "would replace the input" in capsys.readouterr().err
    assert len(load(tmp_path / "noise")) == 50


def test_two_inputs_of_one_name_are_a_matter_of_usage(walk, tmp_path, capsys):
    (tmp_path / "other").mkdir()
    assert main([str(walk), str(tmp_path / "other" / "walk.csv"), "-o", str(tmp_path / "o")]) == 2
    assert "would both be written to" in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize("arguments", [[], ["walk.bag"], ["walk.bag", "-o", "x", "--storage", "y"]])
def test_usage_is_exit_code_2(arguments):
    done = subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert done.stderr.startswith("convert: ") and "see convert --help" in done.stderr


def test_the_command_is_quiet_but_for_its_result_where_no_terminal_looks(walk, tmp_path):
    done = subprocess.run(
        [*COMMAND, walk, "-o", tmp_path / "bag"], capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("walk: 5 samples")


def test_long_work_shows_a_bar_in_a_terminal(tmp_path):
    write(recording(20_000), tmp_path / "noise")
    terminal, stderr = pty.openpty()
    with subprocess.Popen(
        [*COMMAND, tmp_path / "noise", "-o", tmp_path / "bag"],
        stdout=subprocess.DEVNULL,
        stderr=stderr,
        env=os.environ | {"TERM": "xterm", "COLUMNS": "100"},
    ) as running:
        os.close(stderr)
        shown = b""
        while True:
            try:
                part = os.read(terminal, 4096)
            except OSError:  # EIO: the other end is closed
                break
            if not part:
                break
            shown += part
    os.close(terminal)
    assert running.returncode == 0
    assert b"reading noise" in shown and b"writing bag" in shown
    assert b"%" in shown
