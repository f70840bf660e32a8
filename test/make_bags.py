"""Write the fixture bags of the tests: ``python test/make_bags.py``.

They come from the simulated chip and are the same each time they are made.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from simulated import simulated

from stateful_ahrs.recordings import write

BAGS = Path(__file__).parent / "bags"


def main() -> None:
    """Replace all fixture bags."""
    shutil.rmtree(BAGS, ignore_errors=True)
    BAGS.mkdir()
    write(simulated("turns", 9.5), BAGS / "turns", storage="mcap")
    write(simulated("tumble", 2.0, rate=50.0), BAGS / "short", storage="sqlite3")


if __name__ == "__main__":
    main()
