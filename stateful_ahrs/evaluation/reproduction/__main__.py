"""Write docs/reproduction.md: ``python -m stateful_ahrs.evaluation.reproduction``."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from functools import cache, partial
from pathlib import Path

from ...command import Parser, exit_with_sentence
from ...errors import UsageError
from ...recordings import load
from ..score import Trial, prepare
from . import ee615, everything, kckf, kusaka, saam
from .page import Part, write


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code 0: the page is written; 2: usage."""
    return exit_with_sentence("reproduce", lambda: _reproduce(argv))


def _reproduce(argv: Sequence[str] | None) -> int:
    parser = Parser(prog="reproduce", description="Make the papers' figures and tables anew.")
    parser.add_argument("--data", default="", metavar="FOLDER", help="of BROAD's .mat files")
    parser.add_argument("--docs", type=Path, default=Path("docs"), metavar="FOLDER")
    given = parser.parse_args(argv)
    files = sorted(Path(given.data).glob("*.mat")) if given.data else []
    if given.data and not files:
        raise UsageError(f"--data {given.data}: there is no .mat file of BROAD in it.")
    if not given.docs.is_dir():
        raise UsageError(f"--docs {given.docs} is not a folder.")

    write(parts(files), given.docs, bool(files), lambda line: print(line, flush=True))
    return 0


def parts(files: Sequence[Path]) -> Mapping[str, Sequence[Part]]:
    """What the page is made of; ``files`` are BROAD's."""

    @cache
    def trials() -> list[Trial]:
        return [prepare(load(str(file))) for file in files]

    return {
        "Kusaka and Tanaka 2022: the stateful rotor": [
            Part("kusaka-1", kusaka.figure_1),
            Part("kusaka-3-4", kusaka.figures_3_and_4),
            Part("kusaka-6", kusaka.figure_6),
            Part("kusaka-7-9", kusaka.figures_7_to_9),
            Part("kusaka-12", kusaka.figure_12),
            Part("kusaka-13", kusaka.figure_13),
            Part("kusaka-table-1", kusaka.table_1),
            Part("kusaka-table-2", kusaka.table_2),
            Part("kusaka-eq-14", kusaka.product_side),
            Part("kusaka-eq-14-broad", partial(kusaka.product_side_on, trials), broad=True),
        ],
        "Wu et al. 2018: SAAM": [
            Part("saam-table-1", saam.table_i),
            Part("saam-table-2", saam.table_ii),
            Part("saam-table-3", saam.table_iii),
            Part("saam-table-4", saam.table_iv),
            Part("saam-singular", saam.singular_surface),
        ],
        "EE615 2023: complementary filters": [Part("ee615-1", ee615.figure_1)],
        "Yamagishi and Jing: KCKF": [
            Part("kckf-counts", kckf.counts),
            Part("kckf-times", kckf.times_section),
            Part("kckf-table-3", partial(kckf.table_iii, trials), broad=True),
            Part("kckf-reference", partial(kckf.reference, trials), broad=True),
        ],
        "All of them": [Part("broad", partial(everything.everything, trials), broad=True)],
    }


if __name__ == "__main__":
    sys.exit(main())
