"""Parameters: declared with descriptors, refused with a sentence, live where they can be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from ..errors import AhrsError, UsageError

Value = bool | int | float | str


@dataclass(frozen=True)
class Spec:
    """One parameter: its name, default, and what a user reads of it."""

    name: str
    default: Value
    description: str
    live: bool = False
    limits: tuple[float, float] | None = None  # gives rqt_reconfigure its slider


class Parameters:
    """The values of a node's parameters, kept true while it runs.

    ``accept`` gets the values as they would be and raises an `AhrsError` to refuse them;
    ``apply`` gets them once they are set.
    """

    def __init__(
        self,
        node: Node,
        specs: list[Spec],
        accept: Callable[[dict[str, Any]], object] = lambda values: None,
        apply: Callable[[dict[str, Any]], None] = lambda values: None,
    ) -> None:
        self._specs = {spec.name: spec for spec in specs}
        self._accept = accept
        self._apply = apply
        self.values: dict[str, Any] = {spec.name: _declare(node, spec) for spec in specs}
        accept(self.values)
        node.add_on_set_parameters_callback(self._on_set)
        node.add_post_set_parameters_callback(self._post_set)

    def __getitem__(self, name: str) -> Any:
        return self.values[name]

    def _merged(self, parameters: list[Parameter]) -> dict[str, Any]:
        changed = {
            parameter.name: _checked(self._specs[parameter.name], parameter.value)
            for parameter in parameters
            if parameter.name in self._specs
        }
        return {**self.values, **changed}

    def _on_set(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            self._accept(self._merged(parameters))
        except AhrsError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _post_set(self, parameters: list[Parameter]) -> None:
        self.values = self._merged(parameters)
        self._apply(self.values)


def warn_of_unknown(node: Node) -> None:
    """Log which parameters were given that the node, made by now, does not have.

    They are not refused, because a file for ``/**`` and a launch file's SetParameter give all of
    theirs to each of several nodes, and nobody can tell them from a slip of the pen.
    """
    known = node.get_parameters_by_prefix("")
    strange = []
    for name in node._parameter_overrides:  # rclpy shows them nowhere else
        if name not in known:
            nearest = "".join(get_close_matches(name, known, n=1))
            strange.append(f"{name} (perhaps {nearest} is meant)" if nearest else name)
    if strange:
        node.get_logger().warning(
            f"ignored, as {node.get_name()} has no such parameter: {', '.join(strange)}."
        )


def _declare(node: Node, spec: Spec) -> Value:
    # With dynamic typing, and limits only afterwards, the check is `_checked`'s, whose reason a
    # user understands.
    first = ParameterDescriptor(dynamic_typing=True)
    value = _checked(spec, node.declare_parameter(spec.name, spec.default, first).value)
    descriptor = ParameterDescriptor(
        description=spec.description, read_only=not spec.live, dynamic_typing=True
    )
    if spec.limits is not None:
        low, high = spec.limits
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    node.set_descriptor(spec.name, descriptor)
    return value


def _checked(spec: Spec, value: Value) -> Value:
    """The value if it has the default's type and keeps the limits; `UsageError` if not."""
    kind = {bool: "a boolean", int: "an integer", float: "a double", str: "a string"}
    if type(value) is not type(spec.default):
        found = f"got {kind.get(type(value), type(value).__name__)} ({value!r})"
        remedy = ""
        if isinstance(spec.default, float) and type(value) is int:
            remedy = f": write {value}.0 instead of {value}"
        elif isinstance(spec.default, int) and type(value) is float and value.is_integer():
            remedy = f": write {value:.0f} instead of {value}"
        raise UsageError(f"{spec.name} must be {kind[type(spec.default)]}, {found}{remedy}.")
    if spec.limits is not None and not spec.limits[0] <= value <= spec.limits[1]:
        low, high = spec.limits
        raise UsageError(f"{spec.name} must be between {low:g} and {high:g}, got {value}.")
    return value
