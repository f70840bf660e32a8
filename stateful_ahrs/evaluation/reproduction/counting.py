"""Kernels on other numbers than floats: some count their operations, some are of single precision.

A kernel is plain Python, so it runs as it is on anything that behaves as a float. Only the
functions of `math` must be others, which `on` sees to.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from ...filters.compiled import kernels_of, twin

ADD, MULTIPLY, DIVIDE, ROOT, TRANSCENDENTAL = OPERATIONS = ("+", "×", "/", "√", "cos")
DIVISION = 4  # floating-point operations, as Yamagishi and Jing count


class Number(float):
    """A float of which every result is one of the same kind; signs and comparisons are free."""

    @classmethod
    def made(cls, value: float, operation: str) -> Number:
        """The number that an operation gave."""
        raise NotImplementedError

    def __neg__(self) -> Number:
        """The opposite."""
        return type(self)(-float(self))

    def __abs__(self) -> Number:
        """The magnitude."""
        return type(self)(abs(float(self)))


def _binary(name: str, operation: str) -> Callable[[Number, Any], Any]:
    plain = getattr(float, name)

    def operate(self: Number, other: Any) -> Any:
        found = plain(self, other)
        return found if found is NotImplemented else self.made(found, operation)

    return operate


for _side in ("", "r"):
    for _name, _operation in (("add", ADD), ("sub", ADD), ("mul", MULTIPLY), ("truediv", DIVIDE)):
        setattr(Number, f"__{_side}{_name}__", _binary(f"__{_side}{_name}__", _operation))


class Counted(Number):
    """A number whose operations are counted."""

    tally: ClassVar[Counter[str]] = Counter()

    @classmethod
    def made(cls, value: float, operation: str) -> Number:
        """Count one."""
        cls.tally[operation] += 1
        return cls(value)


class Single(Number):
    """A number that is rounded to single precision after each operation."""

    @classmethod
    def made(cls, value: float, operation: str) -> Number:
        """Round it."""
        return cls(np.float32(value))


def _functions(kind: type[Number]) -> SimpleNamespace:
    """What stands for the module `math`."""

    def told(function: Callable[..., float], operation: str) -> Callable[..., float]:
        def operate(*values: float) -> float:
            found = function(*values)
            return kind.made(found, operation) if isinstance(values[0], Number) else found

        return operate

    cost = dict.fromkeys(("sin", "cos", "tan", "asin", "acos", "atan", "atan2"), TRANSCENDENTAL)
    own = {name: told(getattr(math, name), kind) for name, kind in {**cost, "sqrt": ROOT}.items()}

    def copysign(value: float, sign: float) -> float:
        return -abs(value) if math.copysign(1.0, sign) < 0.0 else abs(value)

    return SimpleNamespace(**{**vars(math), **own, "copysign": copysign})


def on(kind: type[Number], kernel: Callable[..., Any], **others: Callable[..., Any]) -> Any:
    """The kernel, and all that it calls, on numbers of that kind; ``others`` in place of some."""
    called = {
        name: others.get(name) or on(kind, each, **others)
        for name, each in kernels_of(kernel).items()
    }
    return twin(kernel, {**called, "math": _functions(kind)}, kernel.__qualname__)


def numbers(kind: type[Number], value: Any) -> Any:
    """A float, or tuples of them, as numbers of that kind."""
    if isinstance(value, tuple):
        made = [numbers(kind, each) for each in value]
        return type(value)(*made) if hasattr(value, "_fields") else tuple(made)
    return kind(value)


def operations(
    kernel: Callable[..., Any], *values: Any, **others: Callable[..., Any]
) -> Counter[str]:
    """How many operations of each kind the kernel takes for these values.

    ``others`` stand in for kernels that it calls, and cost nothing on plain floats.
    """
    Counted.tally.clear()
    on(Counted, kernel, **others)(*numbers(Counted, values))
    return Counter(Counted.tally)


def flops(counted: Counter[str]) -> int:
    """Floating-point operations, a division being four (Yamagishi and Jing, section II-D)."""
    return sum(counted.values()) + (DIVISION - 1) * counted[DIVIDE]
