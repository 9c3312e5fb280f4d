"""The node's ROS parameters: declared from the one list there is, and judged when they change."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import (
    DECLARATIONS,
    Declaration,
    NodeParameters,
    default_values,
    parameters_of,
    replaced,
)

# What is loaded, recorded or connected when the node is configured.
_WHILE_CONFIGURED = (
    *("robot.", "bag.", "qos.", "odometry.", "rates."),
    *("inertial_frame", "state_source"),
)


class LiveParameters:
    """The parameters of a running node: what may change does so between two plans."""

    def __init__(self, node: Node) -> None:
        """Declare every parameter; overrides go before the values of `config/planner.yaml`.

        Raises:
            InvalidInput: An override that is unknown, of the wrong type or out of its range.
        """
        self.current = _declared(node)
        self.configured = False  # whether those of _WHILE_CONFIGURED are in use
        node.add_on_set_parameters_callback(self._judge)
        node.add_post_set_parameters_callback(self._take)

    def _judge(self, changes: list[Parameter]) -> SetParametersResult:
        """Refuse changes that make no sense; types and ranges of numbers are checked already."""
        for change in changes:
            if self.configured and change.name.startswith(_WHILE_CONFIGURED):
                return SetParametersResult(
                    successful=False,
                    reason=f"{change.name} is in use: it may change only while the node is "
                    "unconfigured (lifecycle transitions deactivate and cleanup)",
                )
        try:
            changed(self.current, changes)
        except InvalidInput as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take(self, changes: list[Parameter]) -> None:
        self.current = changed(self.current, changes)


def changed(parameters: NodeParameters, changes: list[Parameter]) -> NodeParameters:
    """Return the parameters with some values replaced; names that are not ours are left out.

    Raises:
        InvalidInput: A value that makes no sense.
    """
    for change in changes:
        parameters = replaced(parameters, change.name, _value(change))
    return parameters


def _declared(node: Node) -> NodeParameters:
    overrides = node._parameter_overrides  # noqa: SLF001 (rclpy tells them nowhere else)
    values: dict[str, Any] = {}
    for name, declaration in DECLARATIONS.items():
        descriptor = _descriptor(name, declaration)
        try:
            parameter = node.declare_parameter(name, default_values()[name], descriptor)
        except (InvalidParameterTypeException, InvalidParameterValueException):
            value = repr(overrides[name].value)
            raise InvalidInput(Status.OUT_OF_RANGE, name, value, declaration.allowed) from None
        values[name] = _value(parameter)
    parameters = parameters_of(values)
    unknown = [
        name
        for name in sorted(overrides)
        if not node.has_parameter(name) and not name.startswith("qos_overrides.")
    ]
    if unknown:
        known = ", ".join(sorted(node.get_parameters_by_prefix("")))
        raise InvalidInput(
            Status.OUT_OF_RANGE, unknown[0], "an unknown parameter", f"known are {known}"
        )
    return parameters


def _value(parameter: Parameter) -> Any:
    """Return a value; an array becomes a tuple."""
    is_array = parameter.type_ == Parameter.Type.DOUBLE_ARRAY
    return tuple(parameter.value) if is_array else parameter.value


def _descriptor(name: str, declaration: Declaration) -> ParameterDescriptor:
    kind, description, minimum, maximum, unit = declaration
    descriptor = ParameterDescriptor(
        description=f"{description} [{unit}]" if unit else description,
        read_only=name == "autostart",  # its time is over when the node is there
        additional_constraints="may change only while the node is unconfigured"
        if name.startswith(_WHILE_CONFIGURED)
        else "a change counts from the next request on",
    )
    if kind is int:
        descriptor.integer_range = [
            IntegerRange(
                from_value=-(2**63) if minimum is None else int(minimum),
                to_value=2**63 - 1 if maximum is None else int(maximum),
            )
        ]
    elif kind is float:
        descriptor.floating_point_range = [
            FloatingPointRange(
                from_value=-float("inf") if minimum is None else float(minimum),
                to_value=float("inf") if maximum is None else float(maximum),
            )
        ]
    return descriptor
