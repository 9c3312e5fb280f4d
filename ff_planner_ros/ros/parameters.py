"""The node's ROS parameters: declared once here, values from `config/planner.yaml` or overrides."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar, get_type_hints

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
from ff_planner_ros.planning.problem import MAX_POINTS, MIN_POINTS
from ff_planner_ros.planning.scenario import from_urdf
from ff_planner_ros.planning.settings import PlannerSettings, tunable
from ff_planner_ros.planning.tail import EndBehaviour
from ff_planner_ros.planning.yaml_file import read_yaml
from ff_planner_ros.ros.inputs.state_input import STATE_SOURCES
from ff_planner_ros.ros.messages.controller_message import ControllerParameters
from ff_planner_ros.ros.messages.from_odometry import OdometryParameters
from ff_planner_ros.ros.qos import QosParameters
from ff_planner_ros.share import share_directory

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Group = TypeVar("Group", bound="DataclassInstance")

# Definitions and documents alone take a fifth of it [bytes].
_MIN_FILE_SIZE = 1_000_000
# What a request may do that meets another one: parameter when_busy.
REJECT, PREEMPT = "reject", "preempt"
# What is loaded, recorded or connected when the node is configured.
_WHILE_CONFIGURED = (
    *("robot.", "bag.", "qos.", "odometry.", "rates."),
    *("inertial_frame", "state_source"),
)


@dataclass(frozen=True)
class RobotParameters:
    """Which robot to plan for."""

    urdf: str = tunable("URDF file: a path or a package:// URI")
    base_link: str = tunable("URDF link that carries the arm")
    tip_link: str = tunable("URDF link whose frame is the end effector")


@dataclass(frozen=True)
class LimitParameters:
    """Which limits of the URDF to keep beside the joint positions'.

    Raises:
        InvalidInput: A word that is not known.
    """

    velocity: str = tunable("Joint rates: from_urdf keeps the URDF's limits, none keeps none")

    def __post_init__(self) -> None:
        """Check the word."""
        from_urdf("limits.velocity", self.velocity)


@dataclass(frozen=True)
class BagParameters:
    """Where everything is recorded, and how.

    Raises:
        InvalidInput: A size in which hardly anything fits.
    """

    directory: str = tunable("A new bag is made in here at every start")
    flush_interval: float = tunable(
        "What a crash or a power cut can lose at most", minimum=0.01, maximum=60.0, unit="s"
    )
    max_size: int = tunable(
        "Before a file of the bag becomes larger, its index not counted, another one is begun; "
        f"0: never; else at least {_MIN_FILE_SIZE}",
        minimum=0,
        unit="bytes",
    )
    max_duration: float = tunable(
        "Before a file of the bag becomes longer, another one is begun; 0: never",
        minimum=0.0,
        unit="s",
    )

    def __post_init__(self) -> None:
        """Check the size."""
        if 0 < self.max_size < _MIN_FILE_SIZE:
            raise InvalidInput(
                Status.OUT_OF_RANGE,
                "bag.max_size",
                self.max_size,
                f"it must be 0, for never, or at least {_MIN_FILE_SIZE} [bytes]: each file "
                "repeats the robot and all definitions",
            )


@dataclass(frozen=True)
class TrackingParameters:
    """When diagnostics warn that the chaser leaves the plan."""

    max_position: float = tunable(
        "Distance of the measured chaser from the predicted one", minimum=0.0, unit="m"
    )
    max_angle: float = tunable(
        "Angle between the measured and the predicted attitude of the chaser",
        minimum=0.0,
        unit="rad",
    )


@dataclass(frozen=True)
class RateParameters:
    """How often the node publishes by itself."""

    predicted_pose: float = tunable(
        "Of predicted_chaser_pose and tracking_error while a plan runs",
        minimum=0.1,
        maximum=1000.0,
        unit="Hz",
    )
    diagnostics: float = tunable("Of /diagnostics", minimum=0.1, maximum=100.0, unit="Hz")
    preview: float = tunable(
        "Of planned_joint_states, which play the last plan again and again",
        minimum=0.1,
        maximum=1000.0,
        unit="Hz",
    )


@dataclass(frozen=True)
class NodeParameters:
    """Every parameter of the node; a group's fields carry its name and a dot in front.

    Raises:
        InvalidInput: A word that is not known.
    """

    robot: RobotParameters
    limits: LimitParameters
    bag: BagParameters
    planner: PlannerSettings
    odometry: OdometryParameters
    qos: QosParameters
    controller: ControllerParameters
    tracking: TrackingParameters
    rates: RateParameters
    autostart: bool = tunable("Configure and activate at start; else a lifecycle manager does")
    inertial_frame: str = tunable("frame_id that states, obstacles and targets must carry")
    state_source: str = tunable(
        "Topics that tell the state: chaser_state, or odometry for odometry with joint_states"
    )
    points: int = tunable(
        "Points of a trajectory where the request does not say",
        minimum=MIN_POINTS,
        maximum=MAX_POINTS,
    )
    time_budget: float = tunable(
        "Wall clock for an answer where the request does not say",
        minimum=0.001,
        maximum=86_400.0,
        unit="s",
    )
    planning_allowance: float = tunable(
        "A plan starts so long after its request where the request does not say when; it must "
        "cover planning, and what the controller needs to take the plan over",
        minimum=0.0,
        maximum=3600.0,
        unit="s",
    )
    start_max_lead: float = tunable(
        "A start time further ahead of now is refused", minimum=0.0, maximum=86_400.0, unit="s"
    )
    following_tolerance: float = tunable(
        "Joints that are within this of the last plan follow it until the next one starts; others "
        "keep their measured rates",
        minimum=0.0,
        maximum=10.0,
        unit="rad",
    )
    when_busy: str = tunable(
        "What a request does that meets another one being planned: reject answers it with BUSY, "
        "preempt answers the other one with PREEMPTED"
    )
    end_behaviour: str = tunable(
        "What the arm does after the goal where the request does not say: as_planned, "
        "hold_end_effector or stop_joints"
    )
    tail_duration: float = tunable(
        "How long it does so; does not matter for as_planned",
        minimum=0.001,
        maximum=3600.0,
        unit="s",
    )
    state_max_age: float = tunable(
        "An older chaser state is refused", minimum=0.0, maximum=3600.0, unit="s"
    )
    state_max_lead: float = tunable(
        "A chaser state stamped further ahead of now is refused",
        minimum=0.0,
        maximum=3600.0,
        unit="s",
    )

    def __post_init__(self) -> None:
        """Check the words."""
        for name, allowed in (
            ("state_source", STATE_SOURCES),
            ("when_busy", (REJECT, PREEMPT)),
            ("end_behaviour", tuple(EndBehaviour)),
        ):
            value = getattr(self, name)
            if value not in allowed:
                raise InvalidInput(
                    Status.OUT_OF_RANGE, name, repr(value), f"it must be {' or '.join(allowed)}"
                )


class LiveParameters:
    """The parameters of a running node: what may change does so between two plans.

    Attributes:
        current: Their values.
        configured: Whether those of `_WHILE_CONFIGURED` are in use.
    """

    def __init__(self, node: Node) -> None:
        """Declare every parameter.

        Args:
            node: The node; its overrides go before the values of `config/planner.yaml`.

        Raises:
            InvalidInput: An override that is unknown, of the wrong type or out of its range.
        """
        self.current = _declared(node)
        self.configured = False
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


def parameters_from_values(values: dict[str, Any]) -> NodeParameters:
    """Return the parameters that a document holds.

    Args:
        values: Every one, those of a group as a dictionary.

    Raises:
        InvalidInput: A value that makes no sense.
    """
    return _of_values(NodeParameters, values)


def _of_values(group: type[Group], values: dict[str, Any]) -> Group:
    types = get_type_hints(group)
    read: dict[str, Any] = {}
    for item in fields(group):
        kind: type[Any] = types[item.name]
        value = values[item.name]
        if is_dataclass(kind):
            read[item.name] = _of_values(kind, value)
        else:
            read[item.name] = tuple(value) if isinstance(value, list) else value
    return group(**read)


def _declared(node: Node) -> NodeParameters:
    values = read_yaml(share_directory() / "config" / "planner.yaml")["/**"]["ros__parameters"]
    parameters = _declare(node, NodeParameters, values, "")
    overrides = node._parameter_overrides  # noqa: SLF001 (rclpy tells them nowhere else)
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


def _declare(node: Node, group: type[Group], values: dict[str, Any], prefix: str) -> Group:
    """Declare the fields of one group, groups inside it included, and return their values."""
    types = get_type_hints(group)
    declared: dict[str, Any] = {}
    for item in fields(group):
        kind: type[Any] = types[item.name]
        name = f"{prefix}{item.name}"
        if is_dataclass(kind):
            declared[item.name] = _declare(node, kind, values[item.name], f"{name}.")
            continue
        descriptor = _descriptor(name, kind, **item.metadata)
        try:
            parameter = node.declare_parameter(name, values[item.name], descriptor)
        except (InvalidParameterTypeException, InvalidParameterValueException):
            value = node._parameter_overrides[name].value  # noqa: SLF001
            raise InvalidInput(
                Status.OUT_OF_RANGE, name, repr(value), allowed_words(kind, **item.metadata)
            ) from None
        declared[item.name] = _value(parameter)
    return group(**declared)


def changed(parameters: NodeParameters, changes: list[Parameter]) -> NodeParameters:
    """Return the parameters with some values replaced; names that are not ours are left out.

    Raises:
        InvalidInput: A value that makes no sense.
    """
    for change in changes:
        parameters = replaced(parameters, change.name.split("."), _value(change))
    return parameters


def replaced(group: Group, path: list[str], value: Any) -> Group:
    """Return a group of parameters with one value replaced; a name that is not ours is left out.

    Args:
        path: Name of the value, group by group.

    Raises:
        InvalidInput: A value that makes no sense.
    """
    name, *rest = path
    if name not in {item.name for item in fields(group)}:
        return group
    return replace(group, **{name: replaced(getattr(group, name), rest, value) if rest else value})


def _value(parameter: Parameter) -> Any:
    """Return a value; an array becomes a tuple."""
    is_array = parameter.type_ == Parameter.Type.DOUBLE_ARRAY
    return tuple(parameter.value) if is_array else parameter.value


def _descriptor(
    name: str,
    kind: type,
    description: str,
    minimum: float | None,
    maximum: float | None,
    unit: str,
) -> ParameterDescriptor:
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


def allowed_words(
    kind: type, description: str, minimum: float | None, maximum: float | None, unit: str
) -> str:
    """Say in words what a parameter may be."""
    words = {
        bool: "true or false",
        str: "text",
        int: "a whole number",
        float: "a number with a decimal point",
    }.get(kind, "an array of numbers with a decimal point")
    if minimum is not None:
        words += f", at least {minimum:g}"
    if maximum is not None:
        words += f", at most {maximum:g}"
    return f"it must be {words} {f'[{unit}] ' if unit else ''}({description})"
