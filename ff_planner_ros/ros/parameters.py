"""The node's ROS parameters: declared once here, values from `config/planner.yaml` or overrides."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass
from typing import TYPE_CHECKING, Any, TypeVar, get_type_hints

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem import MAX_POINTS, MIN_POINTS
from ff_planner_ros.planning.scenario import from_urdf
from ff_planner_ros.planning.settings import PlannerSettings, tunable
from ff_planner_ros.planning.yaml_file import read_yaml
from ff_planner_ros.share import share_directory

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Group = TypeVar("Group", bound="DataclassInstance")


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
    """Where everything is recorded."""

    directory: str = tunable("A new bag is made in here at every start")
    flush_interval: float = tunable(
        "What a crash can lose at most", minimum=0.01, maximum=60.0, unit="s"
    )


@dataclass(frozen=True)
class NodeParameters:
    """Every parameter of the node; a group's fields carry its name and a dot in front."""

    robot: RobotParameters
    limits: LimitParameters
    bag: BagParameters
    planner: PlannerSettings
    inertial_frame: str = tunable("frame_id that states, obstacles and targets must carry")
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
    state_max_age: float = tunable(
        "An older chaser state is refused", minimum=0.0, maximum=3600.0, unit="s"
    )
    state_max_lead: float = tunable(
        "A chaser state stamped further ahead of now is refused",
        minimum=0.0,
        maximum=3600.0,
        unit="s",
    )
    predicted_pose_rate: float = tunable(
        "Of predicted_chaser_pose while a plan runs", minimum=0.1, maximum=1000.0, unit="Hz"
    )


def declare_parameters(node: Node) -> NodeParameters:
    """Declare every parameter on a node, read-only, and return the values.

    Args:
        node: The node; its overrides go before the values of `config/planner.yaml`.

    Raises:
        InvalidInput: An override that is unknown, of the wrong type or out of its range.
    """
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
        descriptor = _descriptor(kind, **item.metadata)
        try:
            parameter = node.declare_parameter(name, values[item.name], descriptor)
        except (InvalidParameterTypeException, InvalidParameterValueException):
            value = node._parameter_overrides[name].value  # noqa: SLF001
            raise InvalidInput(
                Status.OUT_OF_RANGE, name, repr(value), _allowed(kind, **item.metadata)
            ) from None
        declared[item.name] = parameter.value
    return group(**declared)


def _descriptor(
    kind: type, description: str, minimum: float | None, maximum: float | None, unit: str
) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        description=f"{description} [{unit}]" if unit else description,
        read_only=True,
        additional_constraints="read at start, fixed while the node runs",
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


def _allowed(
    kind: type, description: str, minimum: float | None, maximum: float | None, unit: str
) -> str:
    """Say in words what a parameter may be."""
    words = {str: "text", int: "a whole number", float: "a number with a decimal point"}[kind]
    if minimum is not None:
        words += f", at least {minimum:g}"
    if maximum is not None:
        words += f", at most {maximum:g}"
    return f"it must be {words} {f'[{unit}] ' if unit else ''}({description})"
