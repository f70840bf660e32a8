"""convert: public data sets and ROS 1 bags → rosbag2."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..command import Parser, exit_with_sentence
from ..errors import AhrsError, UsageError
from ..filters.samples import Stamps
from ..words import counted
from .load import load
from .progress import bar
from .recording import Recording
from .write import write


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code 0: all done; 1: a recording could not be used; 2: usage."""
    return exit_with_sentence("convert", lambda: _convert(_options(argv)))


def _options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(prog="convert", description="Convert recordings to rosbag2.")
    parser.add_argument(
        "inputs",
        nargs="+",
        type=Path,
        metavar="INPUT",
        help="rosbag2 folder, .mcap, .db3, ROS 1 .bag, BROAD .mat or .csv",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="OUT",
        help="the bag; for several inputs the folder that receives them",
    )
    parser.add_argument("--storage", choices=("mcap", "sqlite3"), default="mcap")
    parser.add_argument("--reference", metavar="TOPIC", help="the true orientation in the inputs")
    parser.add_argument("--overwrite", action="store_true", help="replace bags that exist")
    return parser.parse_args(argv)


def _convert(options: argparse.Namespace) -> int:
    failed = 0
    for source, folder in _targets(options.inputs, options.output):
        try:
            with bar(f"reading {source.name}") as progress:
                recording = load(source, options.reference, progress)
            with bar(f"writing {folder.name}") as progress:
                write(
                    recording,
                    folder,
                    options.storage,
                    overwrite=options.overwrite,
                    progress=progress,
                )
        except AhrsError as error:
            print(f"convert: {error}", file=sys.stderr)
            failed = 1
            continue
        print(f"{recording.name}: {_summary(recording)}, written to {folder}", flush=True)
        if recording.left_out:
            print(f"{recording.name}: left out {', '.join(recording.left_out)}", flush=True)
    return failed


def _targets(inputs: Sequence[Path], output: Path) -> list[tuple[Path, Path]]:
    """Each input with the folder of its bag."""
    names = [path.resolve().name if path.is_dir() else path.stem for path in inputs]
    folders = [output] if len(inputs) == 1 else [output / name for name in names]
    for n, folder in enumerate(folders):
        if folder in folders[:n]:
            twin = inputs[folders.index(folder)]
            raise UsageError(f"{twin} and {inputs[n]} would both be written to {folder}.")
        for path in inputs:
            if folder.resolve() in (path.resolve(), *path.resolve().parents):
                raise UsageError(f"{folder} would replace the input {path}; choose another OUT.")
    return list(zip(inputs, folders, strict=True))


def _summary(recording: Recording) -> str:
    parts = [
        f"{counted(len(recording), 'sample')} in {_seconds(recording.stamps):.1f} s",
        f"inertial {_rate(recording.stamps)}",
        f"magnetometer {_rate(recording.mag_stamps)}",
    ]
    if recording.reference_stamps is not None:
        parts.append(f"reference {_rate(recording.reference_stamps)}")
    return ", ".join(parts)


def _seconds(stamps: Stamps) -> float:
    return float(stamps[-1] - stamps[0]) * 1e-9 if len(stamps) else 0.0


def _rate(stamps: Stamps) -> str:
    """The rate of the usual step."""
    if len(stamps) < 2:
        return "none" if not len(stamps) else "once"
    step = float(np.median(np.diff(stamps))) * 1e-9
    return f"{1.0 / step:.1f} Hz" if step > 0.0 else "0 Hz"


if __name__ == "__main__":
    sys.exit(main())
