"""Libraries that only some uses need, imported where they are used."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ..errors import AhrsError


@contextmanager
def needed_for(purpose: str) -> Iterator[None]:
    """Turn a failed import into a sentence that says what to install."""
    try:
        yield
    except ModuleNotFoundError as error:
        name = (error.name or "").partition(".")[0]
        raise AhrsError(f"{purpose} needs the Python package {name}: pip install {name}.") from None
