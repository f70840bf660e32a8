"""How sure an orientation is, for those who get it: by choice, by the filter, or as usual."""

from __future__ import annotations

import math

USUAL = 0.03  # rad: of a filter that has no word on it
NO_NORTH = math.pi  # rad: of a heading that no magnetometer has told


def stddevs(
    own: tuple[float, float] | None, heading_known: bool, chosen: float
) -> tuple[float, float]:
    """Standard deviations of tilt and heading (rad), heading at most `NO_NORTH`.

    ``chosen`` is for both unless it is negative; else they are the filter's ``own``, if it has any.
    """
    if chosen < 0.0 and own is not None:
        tilt, heading = own
    else:
        tilt = chosen if chosen >= 0.0 else USUAL
        heading = tilt if heading_known else NO_NORTH
    return tilt, min(heading, NO_NORTH)
