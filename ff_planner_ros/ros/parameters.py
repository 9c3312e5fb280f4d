"""The node's ROS parameters: declared from `parameters.DECLARATIONS`, checked on every change.

The configure transition reads them; they are fixed until cleanup, so that what is in use is what
they say.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
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

from ff_planner_ros.common.declared import DeclaredField
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.parameters import DECLARATIONS, NodeParameters, default_values
from ff_planner_ros.parameters.values import checked, parameters_of, unknown_parameter
from ff_planner_ros.ros.qos import overridable

# Their time is over when the node is there.
_AT_START = ("autostart", "allow_remote_paths")
# Of topics that rclpy makes itself, some of them later.
_QOS_OF_ROS = ("qos_overrides./clock.", "qos_overrides./parameter_events.")
# Arguments of xacro may name files, too.
_PATHS = (
    *("robot.urdf", "robot.srdf", "robot.xacro_arguments"),
    *("bag.directory", "planner.library"),
)
_FIXED = "is fixed while the node is configured: lifecycle transitions deactivate and cleanup first"


class ParameterServer:
    """The parameters of a running node, which may be set while it is unconfigured."""

    def __init__(self, node: Node) -> None:
        """Declare every parameter; overrides replace the defaults.

        Raises:
            InvalidInput: An override is unknown, of the wrong type or out of its range.
        """
        _declare(node)
        self._node, self._is_fixed = node, False
        node.add_on_set_parameters_callback(self._judge)

    def fix(self) -> NodeParameters:
        """Return the parameters as they are now, and stay, until `release`."""
        self._is_fixed = True  # before they are read
        return parameters_of(_values(self._node))

    def release(self) -> None:
        """Let parameters be set again."""
        self._is_fixed = False

    def _judge(self, changes: list[Parameter]) -> SetParametersResult:
        """Refuse changes that make no sense; types and ranges of numbers are checked already."""
        new = {one.name: _value(one) for one in changes if one.name in DECLARATIONS}
        if not new:  # but parameters of ROS
            return SetParametersResult(successful=True)
        now = _values(self._node)
        try:
            for name, value in new.items():
                self._require_allowed(name, value, now)
            parameters_of(now | new)
        except FfPlannerError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _require_allowed(self, name: str, value: Any, now: Mapping[str, Any]) -> None:
        if self._is_fixed:
            allowed = f"it stays {now[name]!r}, which {_FIXED}"
        elif name in _PATHS and not now["allow_remote_paths"]:
            allowed = (
                f"it stays {now[name]!r}, as the process was started; with "
                "allow_remote_paths:=true at the start it may be set while the node is unconfigured"
            )
        else:
            return
        raise InvalidInput(Status.OUT_OF_RANGE, name, repr(value), allowed)


def _declare(node: Node) -> None:
    overrides = node._parameter_overrides  # noqa: SLF001 (rclpy tells them nowhere else)
    defaults = default_values()
    for name, declaration in DECLARATIONS.items():
        descriptor = _descriptor(name, declaration)
        try:
            node.declare_parameter(name, defaults[name], descriptor)
        except (InvalidParameterTypeException, InvalidParameterValueException):
            given = overrides[name].value
            checked(name, given)
            allowed = "it must have a decimal point"  # or else it is as declared
            raise InvalidInput(Status.OUT_OF_RANGE, name, repr(given), allowed) from None
    parameters_of(_values(node))
    qos = overridable(node)
    for name, given in sorted(overrides.items()):
        if name in qos:
            qos[name].checked(name, qos[name].read(name, given.value))
        elif not (node.has_parameter(name) or name.startswith(_QOS_OF_ROS)):
            raise unknown_parameter(name, (*DECLARATIONS, *qos))


def _values(node: Node) -> dict[str, Any]:
    """Return the value of every parameter by its full name."""
    return {name: _value(node.get_parameter(name)) for name in DECLARATIONS}


def _value(parameter: Parameter) -> Any:
    """Return a value; an array becomes a tuple, and nothing, as ROS has an empty array, too."""
    is_array = parameter.type_ in (Parameter.Type.DOUBLE_ARRAY, Parameter.Type.NOT_SET)
    return tuple(parameter.value or ()) if is_array else parameter.value


def _descriptor(name: str, declaration: DeclaredField) -> ParameterDescriptor:
    schema, unit = declaration.form.schema(), declaration.unit
    descriptor = ParameterDescriptor(
        description=f"{declaration.sentence} [{unit}]" if unit else declaration.sentence,
        read_only=name in _AT_START,
        additional_constraints="" if name in _AT_START else _FIXED,
    )
    if schema.get("type") == "integer":
        low, high = schema["minimum"], schema.get("maximum", 2**63 - 1)
        descriptor.integer_range = [IntegerRange(from_value=low, to_value=high)]
    elif schema.get("type") == "number":
        low, high = schema.get("minimum", -math.inf), schema.get("maximum", math.inf)
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    return descriptor
