"""Opening a bag: what is refused at once, and how damage is told."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import AhrsError, RecordingError
from .needs import needed_for

if TYPE_CHECKING:
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

BAGS = (".mcap", ".db3", ".bag")
REMEDIES = {
    ".mcap": "`mcap recover` may repair it",
    ".db3": "`sqlite3 FILE .recover` may repair it",
    ".bag": "`rosbag reindex` may repair it",
    "folder": "`ros2 bag reindex` may repair it",
}


def require(path: Path, suffixes: Collection[str]) -> None:
    """Raise RecordingError if there is no folder and no file with one of the suffixes to read."""
    if not path.exists():
        raise RecordingError(f"{path}: no such file or folder.")
    if not os.access(path, os.R_OK):
        raise RecordingError(f"{path}: permission denied.")
    if path.is_dir():
        for file in path.iterdir():
            if file.is_file() and not os.access(file, os.R_OK):
                raise RecordingError(f"{file}: permission denied.")
        return
    if path.suffix not in suffixes:
        raise RecordingError(
            f"{path.name}: unknown suffix {path.suffix!r}, expected a rosbag2 folder, "
            f"{', '.join(suffixes)}."
        )
    if path.stat().st_size == 0:
        raise RecordingError(f"{path.name} is empty.")


def reader(path: Path) -> Reader1 | Reader2:
    """A reader, to be opened, of a rosbag2 folder, .mcap, .db3 or ROS 1 .bag that is finished."""
    with needed_for(f"reading {path.name}"):
        from rosbags.rosbag1 import Reader as Reader1
        from rosbags.rosbag2 import Reader as Reader2
    _refuse_unfinished(path)
    return Reader1(path) if is_ros1(path) else Reader2(path)


def is_ros1(path: Path) -> bool:
    """Whether it is a bag of ROS 1."""
    return path.suffix == ".bag" and not path.is_dir()


@contextmanager
def damage_told(path: Path) -> Iterator[None]:
    """Turn whatever a library meets in a file that is not what it says into a sentence."""
    try:
        yield
    except AhrsError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split()).rstrip(".") or "its records make no sense"
        remedy = REMEDIES["folder" if path.is_dir() else path.suffix]
        raise RecordingError(f"{path.name} is damaged or not a bag ({reason}); {remedy}.") from None


def _refuse_unfinished(path: Path) -> None:
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        raise RecordingError(
            f"{path.resolve().name} is a folder without metadata.yaml, expected a rosbag2 folder; "
            f"if its recording was cut short, {REMEDIES['folder']}."
        )
    for database in path.glob("*.db3") if path.is_dir() else [path]:
        log = database.with_name(database.name + "-wal")
        if log.is_file() and log.stat().st_size:
            raise RecordingError(
                f"{database.name} is not finished: {log.name} holds messages that are not in it "
                "yet; stop its recorder, or open it once with sqlite3 to merge them."
            )
        with database.open("rb") as file:
            head = file.read(100)
        if head.startswith(b"SQLite format 3\0"):  # which reads what is missing as zeros
            promised = int.from_bytes(head[16:18], "big") * int.from_bytes(head[28:32], "big")
            size = database.stat().st_size
            if size < promised:
                raise RecordingError(
                    f"{database.name} is cut short: it has {size} of {promised} bytes; "
                    f"{REMEDIES['.db3']}."
                )
