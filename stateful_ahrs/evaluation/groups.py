"""Groups of trials, as BROAD names them in the ``trials.json`` beside its files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path


def groups(paths: Mapping[str, Path]) -> dict[str, list[str]]:
    """The recordings of each group, for recordings with their files.

    A recording of which no ``trials.json`` beside it knows is a group of its own. Groups of the
    same recordings are one, with all their names.
    """
    members: dict[str, list[str]] = {}
    for recording, path in paths.items():
        for group in _groups_of(path) or [recording]:
            members.setdefault(group, []).append(recording)
    names: dict[tuple[str, ...], list[str]] = {}
    for group, own in members.items():
        names.setdefault(tuple(own), []).append(group)
    order = sorted(names.items(), key=lambda item: -len(item[0]))
    return {", ".join(group): list(own) for own, group in order}


def _groups_of(path: Path) -> list[str]:
    try:
        told = json.loads((path.parent / "trials.json").read_text(encoding="utf-8"))
        found = told["trials"][path.stem]["groups"]
    except (OSError, ValueError, LookupError, TypeError):
        return []  # there is none, or it is about something else
    return [str(group) for group in found] if isinstance(found, list) else []
