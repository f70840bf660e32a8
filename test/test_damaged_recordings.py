"""Files that are missing, cut short, damaged or not what their names say: one sentence each.

A part of a recording is never taken for the whole.
"""

from __future__ import annotations

import os
import random
import re
import shutil
import sqlite3
from pathlib import Path

import pytest
from recorded import START, Bag, recording

from stateful_ahrs.errors import RecordingError
from stateful_ahrs.recordings import load, write

pytest.importorskip("rosbags")

ROWS = 300


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> dict[str, Path]:
    """A sound recording of each kind that is one file."""
    folder = tmp_path_factory.mktemp("sound")
    out = recording(ROWS, mag_every=1)
    write(out, folder / "one", "mcap")
    write(out, folder / "two", "sqlite3")
    with Bag(folder / "three.bag") as bag:
        for n in range(ROWS):
            bag.add("/imu/data_raw", bag.imu(START + n), START + n)
            bag.add("/imu/mag", bag.mag(START + n), START + n)
    return {
        ".mcap": folder / "one" / "one.mcap",
        ".db3": folder / "two" / "two.db3",
        ".bag": folder / "three.bag",
    }


def refusal(path: Path) -> str:
    with pytest.raises(RecordingError) as error:
        load(path)
    sentence = str(error.value)
    assert path.name in sentence
    assert "\n" not in sentence and sentence.endswith(".")
    return sentence


@pytest.mark.parametrize("suffix", [".mcap", ".db3", ".bag"])
def test_a_file_cut_short_anywhere_is_refused(sound, suffix, tmp_path):
    data = sound[suffix].read_bytes()
    path = tmp_path / f"cut{suffix}"
    lengths = [len(data) * n // 40 for n in range(1, 40)] + [len(data) - n for n in range(1, 20)]
    for length in [1, 16, 100, *lengths]:
        path.write_bytes(data[:length])
        assert "may repair it" in refusal(path)


@pytest.mark.parametrize("suffix", [".mcap", ".db3", ".bag"])
def test_a_damaged_file_is_refused_or_read_whole(sound, suffix, tmp_path):
    data = sound[suffix].read_bytes()
    path = tmp_path / f"damaged{suffix}"
    chance = random.Random(suffix)
    refused = 0
    for n in range(60):
        damaged = bytearray(data)
        at = chance.randrange(len(data))
        if n % 2:
            damaged[at] ^= 1 << chance.randrange(8)
        else:
            damaged[at : at + 400] = bytes(len(damaged[at : at + 400]))
        path.write_bytes(damaged)
        try:
            found = load(path)
        except RecordingError as error:
            assert path.name in str(error)
            refused += 1
        else:  # nothing but numbers was hit: neither format checks these
            assert (len(found), len(found.mag)) == (ROWS, ROWS)
    assert refused >= 10


@pytest.mark.parametrize("suffix", [".mcap", ".db3", ".bag", ".mat", ".csv"])
def test_an_empty_file_is_refused(tmp_path, suffix):
    (tmp_path / f"walk{suffix}").touch()
    assert refusal(tmp_path / f"walk{suffix}") == f"walk{suffix} is empty."


@pytest.mark.parametrize("suffix", [".mcap", ".db3", ".bag", ".mat"])
def test_a_file_that_is_not_what_its_suffix_says_is_refused(tmp_path, suffix):
    (tmp_path / f"walk{suffix}").write_text("The quick brown fox jumps over the lazy dog.\n" * 99)
    assert re.match(f"walk{suffix} is damaged or not a ", refusal(tmp_path / f"walk{suffix}"))


def test_a_missing_file_is_a_sentence(tmp_path):
    with pytest.raises(RecordingError, match=r"walk\.mcap: no such file or folder\.$"):
        load(tmp_path / "walk.mcap")


def test_an_unknown_suffix_says_what_is_known(tmp_path):
    (tmp_path / "walk.txt").write_text("hello")
    assert refusal(tmp_path / "walk.txt") == (
        "walk.txt: unknown suffix '.txt', expected a rosbag2 folder, .mcap, .db3, .bag, .mat, .csv."
    )


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_that_may_not_be_read_is_a_sentence(tmp_path):
    path = tmp_path / "walk.mcap"
    path.write_bytes(b"x")
    path.chmod(0)
    with pytest.raises(RecordingError, match="permission denied"):
        load(path)


@pytest.fixture
def folder(sound, tmp_path) -> Path:
    shutil.copytree(sound[".mcap"].parent, tmp_path / "one")
    return tmp_path / "one"


def test_a_folder_without_metadata_says_what_may_repair_it(folder):
    (folder / "metadata.yaml").unlink()
    assert "without metadata.yaml, expected a rosbag2 folder" in refusal(folder)


def test_a_folder_whose_metadata_make_no_sense_is_refused(folder):
    for text in ("", "}{", "a: b", "rosbag2_bagfile_information: 3", "\0"):
        (folder / "metadata.yaml").write_text(text)
        assert "may repair it" in refusal(folder)


def test_a_folder_that_lacks_a_file_is_refused(folder):
    (folder / "one.mcap").unlink()
    assert "one.mcap" in refusal(folder)


def test_a_folder_that_promises_more_than_it_holds_is_refused(folder):
    metadata = folder / "metadata.yaml"
    metadata.write_text(
        metadata.read_text().replace(f"message_count: {ROWS}", "message_count: 999")
    )
    assert re.search(r"promises \d+ messages and it has \d+", refusal(folder))


def test_a_database_of_something_else_is_refused(tmp_path):
    with sqlite3.connect(tmp_path / "walk.db3") as database:
        database.execute("CREATE TABLE shopping (milk INTEGER)")
    database.close()
    assert "missing tables" in refusal(tmp_path / "walk.db3")


def test_a_database_that_is_still_being_written_is_refused(sound, tmp_path):
    shutil.copy(sound[".db3"], tmp_path / "live.db3")
    database = sqlite3.connect(tmp_path / "live.db3", isolation_level=None)
    database.execute("PRAGMA journal_mode=WAL")
    database.execute("INSERT INTO messages SELECT NULL, topic_id, timestamp, data FROM messages")
    assert "live.db3 is not finished: live.db3-wal holds messages" in refusal(tmp_path / "live.db3")
    database.close()
    assert len(load(tmp_path / "live.db3")) == 2 * ROWS
