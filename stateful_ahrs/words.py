"""How sentences that users read are put together."""

from __future__ import annotations


def counted(number: int, one: str, several: str | None = None) -> str:
    """A number before what it counts: "1 sample", "2 samples", "0 samples are"."""
    return f"{number} {one if number == 1 else several or one + 's'}"
