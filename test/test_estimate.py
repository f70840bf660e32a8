"""evaluate --estimate: an orientation that is already in the bag, in the same table."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags")

from recorded import Bag
from turning import turning, write_csv

from stateful_ahrs.evaluation.evaluate import main
from stateful_ahrs.recordings import load
from stateful_ahrs.recordings.wire import ROTORS
from stateful_ahrs.rotor import Rotor, from_axis_angle, negative, product

UP = (0.0, 0.0, 1.0)
WRONG = 0.2  # rad, about the vertical
SECOND = 10**9


def write_bag(
    path: Path,
    estimate: str,
    kind: str = "sensor_msgs/msg/Imu",
    *,
    truth: bool = True,
    every: int = 1,
    flipped: range = range(0),
    unreported: str = "",
) -> str:
    """A bag of `turning`, and on ``estimate`` its truth turned by `WRONG` about the vertical."""
    recording = turning()
    with Bag(path) as bag:
        rows = zip(
            recording.stamps.tolist(),
            recording.gyro.tolist(),
            recording.accel.tolist(),
            recording.mag.tolist(),
            recording.reference.tolist(),
            strict=True,
        )
        for n, (stamp, gyro, accel, mag, reference) in enumerate(rows):
            bag.add("/imu/data_raw", bag.imu(stamp, gyro, accel), stamp)
            bag.add("/imu/mag", bag.mag(stamp, mag), stamp)
            if truth:
                of = "geometry_msgs/QuaternionStamped"
                bag.add("/ground_truth", bag.truth(of, stamp, reference), stamp)
            if n % every:
                continue
            rotor: Rotor = product(from_axis_angle(UP, WRONG), tuple(reference))
            rotor = negative(rotor) if n in flipped else rotor
            if unreported:
                message = bag.imu(stamp, gyro, accel, rotor, unreported=unreported)
            else:
                message = bag.truth(kind.replace("/msg/", "/"), stamp, rotor)
            bag.add(estimate, message, stamp)
    return str(path)


def rows_of(capsys, *argv: str) -> dict[str, dict]:
    assert main([*argv, "--json", "-"]) == 0
    return {row["filter"]: row for row in json.loads(capsys.readouterr().out)["results"]}


@pytest.mark.parametrize("kind", ROTORS)
def test_an_orientation_of_any_type_is_a_row_named_after_its_topic(kind, tmp_path, capsys):
    bag = write_bag(tmp_path / "bag", "/imu/data", kind, flipped=range(100, 200))
    rows = rows_of(capsys, bag, "--estimate", "imu/data")
    assert list(rows) == ["stateful", "imu/data"]
    row = rows["imu/data"]
    assert row["rmse_deg"]["heading"] == pytest.approx(math.degrees(WRONG), abs=1e-9)
    assert row["rmse_deg"]["inclination"] == pytest.approx(0.0, abs=1e-9)
    assert (row["samples"], row["sign_flips"]) == (300, 2)
    assert row["alpha"] is row["ns_per_sample"] is None
    assert rows["stateful"]["rmse_deg"]["total"] < 0.05


def test_its_row_in_the_table_has_dashes_where_settings_stand(tmp_path, capsys):
    assert main([write_bag(tmp_path / "bag", "/other/odom"), "--estimate", "/other/odom"]) == 0
    row = capsys.readouterr().out.splitlines()[-1].split()
    assert row[:5] == ["bag", "/other/odom", "-", "-", "300"]
    assert row[5:] == ["11.46", "11.46", "0.00", "0", "-"]


def test_it_is_scored_at_its_own_stamps(tmp_path, capsys):
    bag = write_bag(tmp_path / "bag", "/slow", every=7)
    row = rows_of(capsys, bag, "--estimate", "/slow")["/slow"]
    assert row["samples"] == 43
    assert row["rmse_deg"]["total"] == pytest.approx(math.degrees(WRONG), abs=1e-9)


def test_several_stand_side_by_side_also_the_reference_itself(tmp_path, capsys):
    bag = write_bag(tmp_path / "bag", "/a")
    rows = rows_of(capsys, bag, "--estimate", "/a", "--estimate", "ground_truth")
    assert list(rows) == ["stateful", "/a", "ground_truth"]
    assert rows["ground_truth"]["rmse_deg"]["total"] == pytest.approx(0.0, abs=1e-9)


def test_of_two_imu_topics_the_one_that_was_taken_is_told(tmp_path, capsys):
    bag = write_bag(tmp_path / "bag", "/imu/data")
    assert main([bag]) == 0
    told = "evaluate: bag: /imu/data_raw is the Imu topic that is taken, not /imu/data.\n"
    assert capsys.readouterr().err == told
    assert main([bag, "--estimate", "/imu/data"]) == 0  # whose topic is no longer open to choice
    assert capsys.readouterr().err == ""


def test_without_a_reference_its_flips_are_still_counted(tmp_path, capsys):
    bag = write_bag(tmp_path / "bag", "/a", truth=False, flipped=range(50, 60))
    row = rows_of(capsys, bag, "--estimate", "/a")["/a"]
    assert (row["rmse_deg"], row["sign_flips"]) == (None, 2)


def test_another_orientation_may_be_the_reference(tmp_path, capsys):
    bag = write_bag(tmp_path / "bag", "/a")
    row = rows_of(capsys, bag, "--estimate", "ground_truth", "--reference", "/a")["ground_truth"]
    assert row["rmse_deg"]["heading"] == pytest.approx(math.degrees(WRONG), abs=1e-9)


def test_an_estimate_is_no_left_out_topic(tmp_path):
    bag = write_bag(tmp_path / "bag", "/a")
    assert load(bag).left_out == ("/a (sensor_msgs/msg/Imu)",)
    assert load(bag, estimates=["/a"]).left_out == ()


@pytest.mark.parametrize(
    ("topic", "sentence"),
    [
        ("/none", "bag has no topic /none. It has: /imu/data_raw (sensor_msgs/msg/Imu), "),
        ("/imu/mag", "bag: /imu/mag (sensor_msgs/msg/MagneticField) has no orientation; an est"),
        ("imu/data_raw", "bag: none of the 300 rotors on imu/data_raw is finite."),
    ],
)
def test_a_topic_that_tells_no_orientation_is_one_sentence(topic, sentence, tmp_path, capsys):
    assert main([write_bag(tmp_path / "bag", "/a"), "--estimate", topic]) == 1
    written = capsys.readouterr()
    assert written.err.startswith(f"evaluate: {sentence}")
    assert written.err.count("\n") == 1


def test_a_reference_of_another_time_is_refused_for_an_estimate_too(tmp_path, capsys):
    recording = turning()
    with Bag(tmp_path / "bag") as bag:
        for stamp, reference in zip(recording.stamps.tolist(), recording.reference, strict=True):
            bag.add("/imu/data_raw", bag.imu(stamp), stamp)
            of = "geometry_msgs/QuaternionStamped"
            bag.add("/ground_truth", bag.truth(of, stamp, tuple(reference)), stamp)
            bag.add("/late", bag.truth(of, stamp + 60 * SECOND, tuple(reference)), stamp)
    assert main([str(tmp_path / "bag"), "--estimate", "/late"]) == 1
    assert "bag: no sample of /late has a reference: " in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--estimate", "--reference"])
def test_a_table_has_no_topics(tmp_path, capsys, option):
    assert main([write_csv(tmp_path / "turning.csv", turning()), option, "imu/data"]) == 1
    expected = "evaluate: turning.csv is no bag: it has no topic imu/data.\n"
    assert capsys.readouterr().err == expected


def test_a_filters_name_is_no_topic(capsys):
    assert main(["x", "--estimate", "stateful"]) == 2
    assert "--estimate stateful: a filter has that name" in capsys.readouterr().err


def test_what_is_read_is_what_was_written(tmp_path):
    stamps, rotors = load(write_bag(tmp_path / "bag", "/a"), estimates=["a"]).estimates["a"]
    recording = turning()
    assert np.array_equal(stamps, recording.stamps)
    turned = np.stack(product(from_axis_angle(UP, WRONG), tuple(recording.reference.T)), axis=1)
    assert np.array_equal(rotors, turned)
