"""The node's ROS parameters: declared from `parameters.DECLARATIONS`, checked on every change.

A change must not get a plan past the check that the configured node would refuse, nor make the
process read or write files that it was not started with.
"""

from __future__ import annotations

import math
import threading
from typing import Any, get_type_hints

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
from ff_planner_ros.parameters.interfaces import PublisherQos, QosParameters, SubscriptionQos
from ff_planner_ros.parameters.values import (
    allowed_values,
    parameters_of,
    replaced,
    unknown_parameter,
    value_of,
)

# What is loaded, recorded or connected when the node is configured.
_WHILE_CONFIGURED = (
    *("robot.", "bag.", "qos.", "odometry.", "rates.", "tf."),
    *("controller.hand_over", "controller.action", "controller.path_tolerance"),
    "controller.goal_t",
    *("inertial_frame", "state_source", "planner.library", "planner.plugins"),
)
# Their time is over when the node is there.
_AT_START = ("autostart", "allow_remote_paths")
# Of topics that rclpy makes itself, some of them later; it reads no other overrides.
_QOS_OVERRIDES = "qos_overrides."
_QOS_OF_ROS = ("qos_overrides./clock.", "qos_overrides./parameter_events.")
_KINDS_OF_TOPICS = {PublisherQos: "publisher", SubscriptionQos: "subscription"}
_PATHS = ("robot.urdf", "robot.srdf", "bag.directory", "planner.library")
_TRANSITIONS = "lifecycle transitions deactivate and cleanup"


class LiveParameters:
    """The parameters of a running node; a change counts from the next request on.

    While the node is configured, tolerances, margins and limits may only be tightened.
    """

    def __init__(self, node: Node) -> None:
        """Declare every parameter; overrides replace the values of `config/planner.yaml`.

        Raises:
            InvalidInput: An override is unknown, of the wrong type or out of its range.
        """
        self.current = _declared(node)
        self.configured = False  # whether a robot is loaded, by what the parameters are now
        self._lock = threading.Lock()
        node.add_on_set_parameters_callback(self._judge)
        node.add_post_set_parameters_callback(self._take)

    def _judge(self, changes: list[Parameter]) -> SetParametersResult:
        """Refuse changes that make no sense; types and ranges of numbers are checked already."""
        try:
            for change in changes:
                self._require_allowed(change.name, _value(change))
            changed(self.current, changes)
        except FfPlannerError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _require_allowed(self, name: str, value: Any) -> None:
        now = value_of(self.current, name)
        if name in _PATHS and not self.current.allow_remote_paths:
            allowed = (
                f"it stays {now!r}, as the process was started; with allow_remote_paths:=true at "
                "the start it may be set while the node is unconfigured"
            )
            raise InvalidInput(Status.OUT_OF_RANGE, name, repr(value), allowed)
        if not self.configured:
            return
        if name.startswith(_WHILE_CONFIGURED):
            raise FfPlannerError(
                Status.OUT_OF_RANGE,
                f"{name} is in use as {now!r} and cannot become {value!r}: it may change only "
                f"while the node is unconfigured ({_TRANSITIONS})",
            )
        declared = DECLARATIONS.get(name)
        strictness = declared.strictness if declared else None
        if strictness and not strictness.is_kept(value, now):
            unit = f" [{declared.unit}]" if declared and declared.unit else ""
            allowed = (
                f"it must be {strictness.as_strict.format(_shown(now))}{unit} while the node is "
                "configured, because tolerances, margins and limits may only be tightened then; "
                f"to loosen it, clean the node up first ({_TRANSITIONS})"
            )
            raise InvalidInput(Status.OUT_OF_RANGE, name, _shown(value), allowed)

    def _take(self, changes: list[Parameter]) -> None:
        with self._lock:  # two threads may set parameters at once
            self.current = changed(self.current, changes)


def stricter_since(then: NodeParameters, now: NodeParameters) -> list[str]:
    """Return the names of tolerances, margins and limits that are stricter now than then."""
    return [
        name
        for name, declared in DECLARATIONS.items()
        if (strictness := declared.strictness)
        and not strictness.is_kept(value_of(then, name), value_of(now, name))
    ]


def changed(parameters: NodeParameters, changes: list[Parameter]) -> NodeParameters:
    """Return the parameters with some values replaced; unknown names are ignored.

    Raises:
        InvalidInput: A value is invalid.
    """
    for change in changes:
        parameters = replaced(parameters, change.name, _value(change))
    return parameters


def _declared(node: Node) -> NodeParameters:
    overrides = node._parameter_overrides  # noqa: SLF001 (rclpy tells them nowhere else)
    _take_qos_overrides(node, overrides)
    values: dict[str, Any] = {}
    for name, declaration in DECLARATIONS.items():
        descriptor = _descriptor(name, declaration)
        try:
            parameter = node.declare_parameter(name, default_values()[name], descriptor)
        except (InvalidParameterTypeException, InvalidParameterValueException):
            value = repr(overrides[name].value)
            raise InvalidInput(Status.OUT_OF_RANGE, name, value, allowed_values(name)) from None
        # An empty array is nothing to ROS.
        is_empty = parameter.value is None and type(default_values()[name]) is list
        values[name] = () if is_empty else _value(parameter)
    parameters = parameters_of(values)
    unknown = [
        name
        for name in sorted(overrides)
        if not node.has_parameter(name) and not name.startswith(_QOS_OF_ROS)
    ]
    if unknown:
        raise unknown_parameter(unknown[0])
    return parameters


def _take_qos_overrides(node: Node, overrides: dict[str, Parameter]) -> None:
    """Let ROS's own words for a topic's quality of service, `qos_overrides.*`, stand for ours."""
    topics = {
        (node.resolve_topic_name(name), _KINDS_OF_TOPICS[kind]): name
        for name, kind in get_type_hints(QosParameters).items()
    }
    for given in list(overrides):
        if not given.startswith(_QOS_OVERRIDES) or given.startswith(_QOS_OF_ROS):
            continue
        topic, _, rest = given.removeprefix(_QOS_OVERRIDES).partition(".")
        kind, _, policy = rest.partition(".")
        name = f"qos.{topics.get((topic, kind))}.{policy}"
        if name not in DECLARATIONS:
            allowed = "it must be of a topic that parameters qos.* are of, and of one of these"
            raise InvalidInput(Status.UNSUPPORTED, given, "given", allowed)
        overrides.setdefault(name, Parameter(name, value=overrides.pop(given).value))


def _value(parameter: Parameter) -> Any:
    """Return a value; an array becomes a tuple."""
    is_array = parameter.type_ == Parameter.Type.DOUBLE_ARRAY
    return tuple(parameter.value) if is_array else parameter.value


def _descriptor(name: str, declaration: DeclaredField) -> ParameterDescriptor:
    schema, unit = declaration.form.schema(), declaration.unit
    when = "a change counts from the next request on"
    if name in _AT_START:
        when = "is set when the process starts"
    elif name in _PATHS:
        when = (
            "is set when the process starts, or, with allow_remote_paths, while it is unconfigured"
        )
    elif name.startswith(_WHILE_CONFIGURED):
        when = "may change only while the node is unconfigured"
    elif declaration.strictness:
        when += "; while the node is configured, the value may only become stricter"
    descriptor = ParameterDescriptor(
        description=f"{declaration.sentence} [{unit}]" if unit else declaration.sentence,
        read_only=name in _AT_START,
        additional_constraints=when,
    )
    if schema.get("type") == "integer":
        low, high = schema["minimum"], schema.get("maximum", 2**63 - 1)
        descriptor.integer_range = [IntegerRange(from_value=low, to_value=high)]
    elif schema.get("type") == "number":
        low, high = schema.get("minimum", -math.inf), schema.get("maximum", math.inf)
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    return descriptor


def _shown(value: Any) -> str:
    """Return a value as a parameters file has it."""
    if isinstance(value, tuple):
        value = list(value)
    return str(value).lower() if isinstance(value, bool) else str(value)
