"""Which protocol a stream of bytes is in: by name, or found out from its first records."""

from __future__ import annotations

from collections.abc import Callable

from ..errors import UsageError
from . import registers as reg
from .frame import FrameParser
from .protocols import Parser, Record
from .razor import RazorParser
from .rt_usb import RtUsbBinaryParser, RtUsbTextParser

ENOUGH = 3  # records that no other protocol has made anything of


class EitherParser:
    """Feeds several parsers until one of them is right; from then on that one alone.

    ``name`` is that of the right one, "" as long as it is open. See `Parser`.
    """

    def __init__(self, parsers: dict[str, Parser]) -> None:
        self.name = ""
        self._parsers = parsers
        self._found: dict[str, list[Record]] = {name: [] for name in parsers}

    def feed(self, data: bytes) -> list[Record]:
        """The records of the right parser; those before it was known come with the first."""
        if self.name:
            return self._parsers[self.name].feed(data)
        for name, parser in self._parsers.items():
            self._found[name] += parser.feed(data)
        best = max(self._found, key=lambda name: len(self._found[name]))
        if len(self._found[best]) < ENOUGH:
            return []
        self.name = best
        return self._found[best]

    @property
    def discarded(self) -> int:
        """Bytes that the right parser threw away; as long as it is open, those that all did."""
        if self.name:
            return self._parsers[self.name].discarded
        return min(parser.discarded for parser in self._parsers.values())

    @property
    def who_am_i(self) -> int:
        """The chip, as far as the right parser knows."""
        return self._parsers[self.name].who_am_i if self.name else reg.MPU_9250

    @property
    def complaint(self) -> str:
        """What the right parser says, or the only one that has something to say."""
        if self.name:
            return self._parsers[self.name].complaint
        said = [parser.complaint for parser in self._parsers.values() if parser.complaint]
        return said[0] if len(said) == 1 else ""


PARSERS: dict[str, Callable[[], Parser]] = {
    "frame": FrameParser,
    "razor": RazorParser,
    "rt_usb text": RtUsbTextParser,
    "rt_usb binary": RtUsbBinaryParser,
}
PROTOCOLS = ("auto", "frame", "razor", "rt_usb")


def parser(protocol: str) -> EitherParser:
    """A parser for the protocol of this name; `UsageError` if there is none."""
    if protocol not in PROTOCOLS:
        raise UsageError(f"protocol must be one of {', '.join(PROTOCOLS)}, got {protocol!r}.")
    return EitherParser(
        {name: make() for name, make in PARSERS.items() if protocol in ("auto", name.split()[0])}
    )
