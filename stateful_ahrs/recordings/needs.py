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
        raise AhrsError(
            f"{purpose} needs the Python package {error.name}: "
            "pip install 'stateful_ahrs[bags]' brings it."
        ) from None
