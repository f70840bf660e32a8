"""One door for every kind of recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from ..errors import RecordingError
from .bag import load_bag
from .broad import load_broad
from .csv_file import load_csv
from .opening import BAGS, require
from .recording import Progress, Recording

TABLES: dict[str, Callable[[Path, str], Recording]] = {".mat": load_broad, ".csv": load_csv}


def load(
    path: Path | str,
    reference: str | None = None,
    progress: Progress | None = None,
    estimates: Sequence[str] = (),
) -> Recording:
    """Read a rosbag2 folder, an .mcap, a .db3, a ROS 1 .bag, a BROAD .mat or a .csv.

    ``reference`` is the topic of a bag that tells the truth and ``estimates`` are topics to be
    compared with it (see `load_bag`); a table has no topics, and its reference in itself. Raises
    RecordingError for what cannot be read as a whole, TopicError for a missing topic.
    """
    path = Path(path)
    require(path, (*BAGS, *TABLES))
    if path.is_dir():
        return load_bag(path, path.resolve().name, reference, progress, estimates)
    if path.suffix in TABLES:
        asked = [topic for topic in (reference, *estimates) if topic is not None]
        if asked:
            raise RecordingError(f"{path.name} is no bag: it has no topic {asked[0]}.")
        return TABLES[path.suffix](path, path.stem)
    return load_bag(path, path.stem, reference, progress, estimates)
