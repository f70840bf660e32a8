"""One door for every kind of recording."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from ..errors import RecordingError
from .bag import load_bag
from .broad import load_broad
from .csv_file import load_csv
from .recording import Progress, Recording

TABLES: dict[str, Callable[[Path, str], Recording]] = {".mat": load_broad, ".csv": load_csv}
BAGS = (".mcap", ".db3", ".bag")


def load(
    path: Path | str, reference: str | None = None, progress: Progress | None = None
) -> Recording:
    """Read a rosbag2 folder, an .mcap, a .db3, a ROS 1 .bag, a BROAD .mat or a .csv.

    ``reference`` is the topic of a bag that tells the truth (see `load_bag`); tables have none.
    Raises RecordingError for what cannot be read as a whole, TopicError for a missing topic.
    """
    path = Path(path)
    name = path.resolve().name
    if not path.exists():
        raise RecordingError(f"{path}: no such file or folder.")
    if not os.access(path, os.R_OK):
        raise RecordingError(f"{path}: permission denied.")
    if not path.is_dir():
        name = path.stem
        if path.suffix not in (*TABLES, *BAGS):
            raise RecordingError(
                f"{path.name}: unknown suffix {path.suffix!r}, expected a rosbag2 folder, "
                f"{', '.join((*BAGS, *TABLES))}."
            )
        if path.stat().st_size == 0:
            raise RecordingError(f"{path.name} is empty.")
        if path.suffix in TABLES:
            return TABLES[path.suffix](path, name)
    return load_bag(path, name, reference, progress)
