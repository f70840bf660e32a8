"""Random rotors, vectors and attitudes for property tests."""

from __future__ import annotations

import math

from hypothesis import strategies as st

from stateful_ahrs.rotor import Rotor, Vector, unit

_part = st.floats(-1.0, 1.0)


def vectors(length: float = 1.0) -> st.SearchStrategy[Vector]:
    """Any finite vector with parts up to ``length``."""
    part = st.floats(-length, length)
    return st.tuples(part, part, part)


def rotors() -> st.SearchStrategy[Rotor]:
    """Unit rotors of both signs."""
    parts = st.tuples(_part, _part, _part, _part)
    return parts.filter(lambda q: sum(x * x for x in q) > 1e-3).map(unit)


def axes() -> st.SearchStrategy[Vector]:
    """Unit vectors."""

    def normalised(v: Vector) -> Vector:
        length = math.sqrt(sum(x * x for x in v))
        return (v[0] / length, v[1] / length, v[2] / length)

    return vectors().filter(lambda v: sum(x * x for x in v) > 1e-3).map(normalised)
