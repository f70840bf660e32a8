"""Which standard deviations are published with an orientation."""

import math

import pytest

from stateful_ahrs.filters.certainty import NO_NORTH, USUAL, stddevs

OWN = (0.01, 0.2)


@pytest.mark.parametrize(
    ("own", "heading_known", "chosen", "expected"),
    [
        (OWN, True, -1.0, OWN),
        (None, True, -1.0, (USUAL, USUAL)),
        (None, False, -1.0, (USUAL, NO_NORTH)),
        (OWN, True, 0.1, (0.1, 0.1)),
        (OWN, False, 0.1, (0.1, NO_NORTH)),
        (OWN, True, 0.0, (0.0, 0.0)),
    ],
)
def test_a_choice_comes_before_the_filters_own_and_that_before_the_usual(
    own, heading_known, chosen, expected
):
    assert stddevs(own, heading_known, chosen) == expected


def test_no_heading_is_less_sure_than_one_that_may_be_any():
    assert stddevs((0.01, math.inf), False, -1.0) == (0.01, math.pi)
