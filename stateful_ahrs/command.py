"""How every command reads its arguments and ends."""

from __future__ import annotations

import argparse
import io
import sys
from collections.abc import Callable
from typing import NoReturn

from .errors import AhrsError, UsageError


class Parser(argparse.ArgumentParser):
    """An argument parser that raises `UsageError`: one sentence instead of a usage block."""

    def error(self, message: str) -> NoReturn:
        """Raise what is wrong with the arguments."""
        raise UsageError(f"{message}; see {self.prog} --help.")


def exit_with_sentence(name: str, command: Callable[[], int | None]) -> int:
    """Run a command; turn a package error into ``name: sentence`` on stderr and its exit code."""
    for stream in (sys.stdout, sys.stderr):  # where there are no Greek letters, no error either
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    try:
        return command() or 0
    except AhrsError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 0
