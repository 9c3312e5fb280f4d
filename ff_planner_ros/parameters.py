"""Every parameter of the planner, declared once; the values are in `config/planner.yaml`."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from difflib import get_close_matches
from functools import cache, cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, get_type_hints

from ff_planner_ros.common.arrays import finite_number, finite_vector, unit_quaternion
from ff_planner_ros.common.forms import FROM_URDF, a_word
from ff_planner_ros.common.plain_values import mapping
from ff_planner_ros.common.share import resolve_uri, share_directory
from ff_planner_ros.common.shown import quoted
from ff_planner_ros.common.yaml_file import read_yaml, yaml_document
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.problem import MAX_POINTS, MIN_POINTS, Limits
from ff_planner_ros.planning.problem.settings import (
    STRICT_IF_LOW,
    STRICT_IF_LOW_EACH,
    STRICT_IF_LOW_NOT_ZERO,
    PlannerSettings,
    Strictness,
    strict_if,
    tunable,
)
from ff_planner_ros.planning.problem.user_requirements import requirements_read
from ff_planner_ros.planning.requirements.requirement import Requirement
from ff_planner_ros.planning.scenario.scenario import Defaults
from ff_planner_ros.planning.task.controller_rules import Controller
from ff_planner_ros.planning.task.tail import FORMER_END_BEHAVIOURS, EndBehaviour
from ff_planner_ros.robot.bodies import Geometry
from ff_planner_ros.robot.model import Base, Robot, read_urdf, robot_from_urdf_text

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Group = TypeVar("Group", bound="DataclassInstance")

# Definitions and documents alone take a fifth of it [bytes].
_MIN_FILE_SIZE = 1_000_000
_MAX_DEPTH = 10_000
_LONGEST_NAME = 100  # [characters] of a parameter, more than any has
# What a request does that meets another one: parameter when_busy.
REJECT, PREEMPT = "reject", "preempt"
# Parameter robot.geometry: what the URDF has.
AUTO = "auto"
STATE_SOURCES = ("chaser_state", "odometry")
RELIABILITIES, DURABILITIES = ("best_effort", "reliable"), ("volatile", "transient_local")


@dataclass(frozen=True)
class RobotParameters:
    """Which robot to plan for.

    Raises:
        InvalidInput: A word that is not known, or a list of held joints that is none.
    """

    urdf: str = tunable("URDF file: a path or a package:// URI")
    base_link: str = tunable("URDF link that carries the arm")
    tip_link: str = tunable("URDF link whose frame is the end effector")
    base: str = tunable("How the chaser can move: free_flyer, or planar on an air-bearing table")
    locked_joints: str = tunable(
        "Joints that are not planned and where they are [rad or m]: `rail: 0.2, hand: -1.0`"
    )

    geometry: str = tunable(
        "What of the robot is kept clear: shapes, its bodies as the URDF's collision elements have "
        "them; lines, the arm's centre lines; auto: shapes where the arm has any, else lines"
    )
    srdf: str = tunable(
        "SRDF file of links that may touch beside neighbours: a path or a package:// URI; empty: "
        "those that touch in nearly every posture may"
    )

    def __post_init__(self) -> None:
        """Check the words and the list."""
        _require_word("robot.base", self.base, tuple(Base))
        _require_word("robot.geometry", self.geometry, (AUTO, *Geometry))
        locked_joints_of(self.locked_joints)

    def load(self, description: str, directory: Path | None = None) -> Robot:
        """Return the robot of a URDF's text.

        Args:
            directory: Of the URDF; None: it was recorded, and neither meshes nor SRDF are read.

        Raises:
            InvalidInput: URDF or SRDF is refused.
        """
        srdf = None
        if self.srdf and directory is not None:
            field = "robot.srdf"
            srdf = read_urdf(resolve_uri(self.srdf, relative_to=Path.cwd(), field=field), field)
        return robot_from_urdf_text(
            description,
            self.base_link,
            self.tip_link,
            Base(self.base),
            locked_joints_of(self.locked_joints),
            None if self.geometry == AUTO else Geometry(self.geometry),
            srdf,
            directory,
        )


def locked_joints_of(text: str) -> dict[str, float]:
    """Return where joints are held, from a text with commas.

    Raises:
        InvalidInput: It is no such text.
    """
    held_at: dict[str, float] = {}
    for word in filter(None, map(str.strip, text.split(","))):
        name, _, at = word.partition(":")
        try:
            held_at[name.strip()] = finite_number("robot.locked_joints", float(at))
        except ValueError:
            allowed = "it must be names and positions: `rail: 0.2, hand: -1.0`"
            raise InvalidInput(Status.OUT_OF_RANGE, "robot.locked_joints", text, allowed) from None
    return held_at


@dataclass(frozen=True)
class LimitParameters:
    """Which limits to keep beside the joint positions'.

    Raises:
        InvalidInput: A word that is not known, or an acceleration that is none.
    """

    velocity: str = tunable(
        "Joint rates: from_urdf keeps the URDF's limits, none keeps none",
        strictness=strict_if("from_urdf"),
    )
    acceleration: tuple[float, ...] = tunable(
        "Largest acceleration of each joint either way, or one for all; a request may ask for "
        "less; [0.0]: any",
        unit="rad/s2",
        strictness=STRICT_IF_LOW_EACH,
    )
    effort: str = tunable(
        "Joint torques: from_urdf keeps the URDF's effort limits, none keeps none",
        strictness=strict_if("from_urdf"),
    )
    chaser_attitude: float = tunable(
        "Largest Euler angle of the chaser; a request may ask for less; 0.0: any",
        minimum=0.0,
        unit="rad",
        strictness=STRICT_IF_LOW_NOT_ZERO,
    )
    chaser_rotation: float = tunable(
        "Largest angle of the chaser's rotation since the plan's first point; a request may ask "
        "for less; 0.0: any",
        minimum=0.0,
        unit="rad",
        strictness=STRICT_IF_LOW_NOT_ZERO,
    )

    def __post_init__(self) -> None:
        """Check what no range of a parameter describes."""
        self.limits()

    @property
    def accelerations(self) -> tuple[float, ...] | None:
        """Limits of the joint accelerations [rad/s2]; None: any."""
        return self.acceleration if any(self.acceleration) else None

    def limits(self) -> Limits:
        """Return the limits of a problem."""
        return Limits(
            joint_velocities=FROM_URDF.read("limits.velocity", self.velocity),
            chaser_attitude=self.chaser_attitude or math.inf,
            chaser_rotation=self.chaser_rotation or math.inf,
            joint_accelerations=self.accelerations,
            joint_torques=FROM_URDF.read("limits.effort", self.effort),
        )


@dataclass(frozen=True)
class OdometryParameters:
    """The sensor that odometry describes, and how its messages are paired with joint states.

    Raises:
        InvalidInput: A position or a quaternion that is none.
    """

    child_frame_id: str = tunable(
        "child_frame_id that odometry must carry: the frame of a sensor fixed to the chaser"
    )
    sensor_position_in_chaser: tuple[float, ...] = tunable(
        "Origin of that frame from the chaser's centre of mass (of the base link and all fixed "
        "to it, without the arm), in axes of the base link",
        unit="m",
    )
    sensor_quaternion_in_chaser_xyzw: tuple[float, ...] = tunable(
        "Turns vectors from axes of that frame to axes of the base link; "
        "[0.0, 0.0, 0.0, 1.0] where the two are parallel"
    )
    pairing_tolerance: float = tunable(
        "odometry and joint_states with stamps further apart than this make no state", 0.0, 1.0, "s"
    )

    def __post_init__(self) -> None:
        """Check the arrays, which no range of a parameter describes."""
        for name, read in (
            ("sensor_position_in_chaser", partial(finite_vector, size=3)),
            ("sensor_quaternion_in_chaser_xyzw", unit_quaternion),
        ):
            vector = read(f"odometry.{name}", getattr(self, name))
            object.__setattr__(self, name, tuple(vector.tolist()))


@dataclass(frozen=True)
class SubscriptionQos:
    """What the node asks of publishers."""

    reliability: str = tunable(
        "best_effort hears every publisher; reliable does not connect to publishers that "
        "offer best_effort, and only a warning in the log tells"
    )
    durability: str = tunable(
        "volatile hears every publisher, from now on; transient_local also hears what was "
        "published before, but does not connect to publishers that offer volatile, and only a "
        "warning in the log tells"
    )
    depth: int = tunable("Messages that wait at most; the oldest are dropped", 1, _MAX_DEPTH)


@dataclass(frozen=True)
class PublisherQos:
    """What the node offers to subscribers."""

    reliability: str = tunable(
        "reliable is heard by every subscriber; best_effort does not connect to subscribers that "
        "ask for reliable, and only a warning in the log tells"
    )
    durability: str = tunable(
        "transient_local is heard by every subscriber, the last messages also by those that come "
        "late; volatile does not connect to subscribers that ask for transient_local, and only a "
        "warning in the log tells"
    )
    depth: int = tunable(
        "Messages that wait at most, and are kept for those that come late", 1, _MAX_DEPTH
    )


@dataclass(frozen=True)
class QosParameters:
    """Quality of service of every topic.

    Raises:
        InvalidInput: A word that is not known.
    """

    chaser_state: SubscriptionQos
    odometry: SubscriptionQos
    joint_states: SubscriptionQos
    obstacles: SubscriptionQos
    obstacle_bodies: SubscriptionQos
    target_body: SubscriptionQos
    joint_trajectory: PublisherQos
    predicted_chaser_path: PublisherQos
    predicted_chaser_pose: PublisherQos

    def __post_init__(self) -> None:
        """Check every word."""
        for name, topic in vars(self).items():
            _require_word(f"qos.{name}.reliability", topic.reliability, RELIABILITIES)
            _require_word(f"qos.{name}.durability", topic.durability, DURABILITIES)


@dataclass(frozen=True)
class ControllerParameters:
    """How the arm's joint_trajectory_controller is set up: it must take every plan."""

    allow_nonzero_velocity_at_trajectory_end: bool = tunable(
        "Its parameter of this name; if false, only plans whose end_behaviour is stop_joints are "
        "published",
        strictness=strict_if(False),
    )
    effort_interface: bool = tunable(
        "Whether its command_interfaces hold effort; if false, joint_trajectory carries no "
        "torques; responses always do"
    )

    def of(self, joints: tuple[str, ...]) -> Controller:
        """Return the controller of an arm."""
        allowed = self.allow_nonzero_velocity_at_trajectory_end
        return Controller(joints, allowed, self.effort_interface)


@dataclass(frozen=True)
class BagParameters:
    """Where everything is recorded, and how.

    Raises:
        InvalidInput: A size that is too small for the definitions alone.
    """

    directory: str = tunable("A new bag is made in here at every start")
    flush_interval: float = tunable("What a crash or a power cut can lose at most", 0.01, 60.0, "s")
    max_size: int = tunable(
        "A file of the bag ends before it becomes larger, its index not counted, and another one "
        f"is begun; 0: never; else at least {_MIN_FILE_SIZE}",
        minimum=0,
        unit="bytes",
    )
    max_duration: float = tunable(
        "A file of the bag ends before it becomes longer; 0: never", 0.0, None, "s"
    )
    owner_only: bool = tunable(
        "Nobody but the user that the node runs as may read the bag: its directory has mode 0700, "
        "its files have 0600; if false, the process's umask decides"
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
        "Distance of the measured chaser from the predicted one", 0.0, None, "m", STRICT_IF_LOW
    )
    max_angle: float = tunable(
        "Angle between the measured and the predicted attitude of the chaser",
        minimum=0.0,
        unit="rad",
        strictness=STRICT_IF_LOW,
    )


@dataclass(frozen=True)
class PublicationParameters:
    """How far from a plan's first point the system may be then, if the plan is published later."""

    max_position: float = tunable(
        "Of the chaser, carried forward from the latest state to the start of a plan that "
        "~/publish_plan is to publish: distance from the plan's first point",
        minimum=0.0,
        unit="m",
        strictness=STRICT_IF_LOW,
    )
    max_angle: float = tunable(
        "Of the chaser likewise: angle between the attitudes", 0.0, None, "rad", STRICT_IF_LOW
    )
    max_velocity: float = tunable(
        "Of the chaser likewise: difference of the velocities", 0.0, None, "m/s", STRICT_IF_LOW
    )
    max_angular_velocity: float = tunable(
        "Of the chaser likewise: difference of the angular velocities",
        minimum=0.0,
        unit="rad/s",
        strictness=STRICT_IF_LOW,
    )
    max_joint_position: float = tunable(
        "Of each joint likewise: difference of the positions", 0.0, None, "rad", STRICT_IF_LOW
    )
    max_joint_velocity: float = tunable(
        "Of each joint likewise: difference of the rates", 0.0, None, "rad/s", STRICT_IF_LOW
    )


@dataclass(frozen=True)
class ReplanningParameters:
    """How a plan takes over from the one that runs, where `replan_active` asks for that."""

    lead_time: float = tunable(
        "It takes over so long after its request where the request does not say when; it must "
        "cover planning, and what the controller needs to take the plan over",
        minimum=0.0,
        maximum=3600.0,
        unit="s",
    )
    handover: float = tunable(
        "A plan that is not ready so long before the handover is refused: it must reach the "
        "controller by then",
        minimum=0.0,
        maximum=3600.0,
        unit="s",
    )
    min_remainder: float = tunable(
        "A running plan that is at its goal sooner than this after the handover is left as it "
        "is, and the request refused",
        minimum=0.001,
        maximum=3600.0,
        unit="s",
    )
    max_position: float = tunable(
        "Of the chaser as measured from where the running plan says: a request is refused where it "
        "is further away",
        minimum=0.0,
        unit="m",
        strictness=STRICT_IF_LOW,
    )
    max_angle: float = tunable(
        "Of the chaser likewise: angle between the attitudes", 0.0, None, "rad", STRICT_IF_LOW
    )
    max_joint_position: float = tunable(
        "Of each joint likewise: difference of the positions", 0.0, None, "rad", STRICT_IF_LOW
    )


@dataclass(frozen=True)
class RateParameters:
    """How often the node publishes by itself."""

    predicted_pose: float = tunable(
        "Of predicted_chaser_pose and tracking_error while a plan runs", 0.1, 1000.0, "Hz"
    )
    diagnostics: float = tunable("Of /diagnostics", 0.1, 100.0, "Hz")
    preview: float = tunable(
        "Of planned_joint_states, which repeat the last plan again and again", 0.1, 1000.0, "Hz"
    )


@dataclass(frozen=True)
class NodeParameters:
    """Every parameter; the name of a group and a dot stand in front of the names of its fields.

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
    publication: PublicationParameters
    replanning: ReplanningParameters
    rates: RateParameters
    library: str = tunable(  # `planner.library`: scenarios know all else of that group
        "Library of plans, a file or the directory that library.npz is in: the nearest plan is "
        "tried first; empty: none"
    )
    plug_ins: str = tunable(  # `planner.plugins`, likewise
        "Requirements of installed plug-ins (entry points ff_planner_ros.requirements) that every "
        "plan must keep, as YAML: `keep_out_plane: {point: [0.0, 0.0, 1.0], normal: [0.0, 0.0, "
        "-1.0], distance: 0.1}`; no other plug-in is loaded; empty: none"
    )
    autostart: bool = tunable("Configure and activate at start; else a lifecycle manager does")
    allow_remote_paths: bool = tunable(
        "Whether robot.urdf, robot.srdf and bag.directory may be set over ROS while the node is "
        "unconfigured; else they are those that the process was started with"
    )
    inertial_frame: str = tunable("frame_id that states, obstacles and targets must carry")
    state_source: str = tunable(
        "Topics that bring the state: chaser_state, or odometry for odometry with joint_states"
    )
    points: int = tunable(
        "Points of a trajectory where the request does not say", MIN_POINTS, MAX_POINTS
    )
    time_budget: float = tunable(
        "Wall clock from taking a request up to its answer where the request does not say; the "
        "plan's start time ends the search, too",
        0.001,
        86_400.0,
        "s",
    )
    planning_lead_time: float = tunable(
        "A plan starts so long after its request where the request does not say when; it must "
        "cover planning, and what the controller needs to take the plan over",
        minimum=0.0,
        maximum=3600.0,
        unit="s",
    )
    start_horizon: float = tunable(
        "A start time further ahead of now is refused", 0.0, 86_400.0, "s", STRICT_IF_LOW
    )
    following_tolerance: float = tunable(
        "Joints that are within this of the last plan follow it until the next one starts; others "
        "keep their measured rates",
        minimum=0.0,
        maximum=10.0,
        unit="rad",
        strictness=STRICT_IF_LOW,
    )
    when_busy: str = tunable(
        "What happens to a request that comes while another one is planned: reject answers it "
        "with BUSY, preempt answers the other one with PREEMPTED"
    )
    end_behaviour: str = tunable(
        "What the arm does after the goal where the request does not say: none, "
        "hold_end_effector or stop_joints"
    )
    post_goal_duration: float = tunable(
        "How long it does so; does not matter for none", 0.001, 3600.0, "s"
    )
    state_max_age: float = tunable(
        "An older chaser state is refused", 0.0, 3600.0, "s", STRICT_IF_LOW
    )
    state_future_tolerance: float = tunable(
        "A chaser state, or a target body, stamped further ahead of now is refused",
        0.0,
        3600.0,
        "s",
        STRICT_IF_LOW,
    )
    target_max_age: float = tunable(
        "An older target body is refused; a younger one is carried forward",
        0.0,
        3600.0,
        "s",
        STRICT_IF_LOW,
    )

    def __post_init__(self) -> None:
        """Check the words."""
        _require_word("state_source", self.state_source, STATE_SOURCES)
        _require_word("when_busy", self.when_busy, (REJECT, PREEMPT))
        _ = self.requirements  # refused here, not with the first request
        word = a_word(EndBehaviour, FORMER_END_BEHAVIOURS).read("end_behaviour", self.end_behaviour)
        object.__setattr__(self, "end_behaviour", str(word))

    @cached_property
    def requirements(self) -> tuple[Requirement, ...]:
        """Return what plans must keep beside the planner's own requirements.

        Raises:
            InvalidInput: The parameter is no YAML, or a plug-in is not installed or refuses it.
        """
        if not self.plug_ins.strip():
            return ()
        document = yaml_document(self.plug_ins, "planner.plugins", "no YAML")
        return requirements_read("planner.plugins", document)

    def of_scenarios(self) -> Defaults:
        """Return what holds for a scenario that does not say."""
        return Defaults(
            settings=self.planner,
            limits=self.limits.limits(),
            end_behaviour=EndBehaviour(self.end_behaviour),
            tail=self.post_goal_duration,
            points=self.points,
            controller=self.controller.of(()),
        )


def _require_word(field: str, word: str, allowed: tuple[str, ...]) -> None:
    if word not in allowed:
        raise InvalidInput(
            Status.OUT_OF_RANGE, field, quoted(word), f"it must be {' or '.join(allowed)}"
        )


_KINDS: Mapping[type, str] = {
    bool: "true or false",
    str: "text",
    int: "a whole number",
    float: "a number with a decimal point",
}


class Declaration(NamedTuple):
    """Type of a parameter, and what `tunable` says of it."""

    kind: type
    description: str
    minimum: float | None
    maximum: float | None
    unit: str
    strictness: Strictness | None

    @property
    def allowed(self) -> str:
        """What the parameter may be, in words."""
        words = _KINDS.get(self.kind, "an array of numbers with a decimal point")
        if self.minimum is not None:
            words += f", at least {self.minimum:g}"
        if self.maximum is not None:
            words += f", at most {self.maximum:g}"
        return f"it must be {words} {f'[{self.unit}] ' if self.unit else ''}({self.description})"


# Names until version 0.3: deprecated.
FORMER_NAMES: Mapping[str, str] = {
    "planning_allowance": "planning_lead_time",
    "state_max_lead": "state_future_tolerance",
    "start_max_lead": "start_horizon",
    "tail_duration": "post_goal_duration",
    "robot.held_joints": "robot.locked_joints",
    "replanning.allowance": "replanning.lead_time",
}


def present_name(name: str) -> str:
    """Return a parameter's name of today, and warn of one that is deprecated."""
    if name not in FORMER_NAMES:
        return name
    present = FORMER_NAMES[name]
    warnings.warn(f"{name} is deprecated: say {present}", FutureWarning, stacklevel=2)
    return present


# Fields of NodeParameters that are called otherwise, and what.
_FULL_NAMES = {"library": "planner.library", "plug_ins": "planner.plugins"}
_FIELDS = {full: name for name, full in _FULL_NAMES.items()}


def _full_name(prefix: str, name: str) -> str:
    return f"{prefix}{name}" if prefix else _FULL_NAMES.get(name, name)


def _declarations(group: type[Any], prefix: str = "") -> dict[str, Declaration]:
    types: dict[str, type[Any]] = get_type_hints(group)
    found: dict[str, Declaration] = {}
    for item in fields(group):
        kind, name = types[item.name], _full_name(prefix, item.name)
        if is_dataclass(kind):
            found |= _declarations(kind, f"{name}.")
        else:
            found[name] = Declaration(kind, **item.metadata)
    return found


# By full name, `planner.starts`.
DECLARATIONS: Mapping[str, Declaration] = _declarations(NodeParameters)
_GROUPS = {name.rpartition(".")[0] for name in DECLARATIONS}


def load_parameters(path: Path | None = None) -> NodeParameters:
    """Read a ROS parameters file; what it leaves out is taken from `config/planner.yaml`.

    Raises:
        InvalidInput: The file cannot be read; a parameter is unknown, of the wrong type or out of
            its range.
    """
    values = dict(default_values())
    for name, value in (flattened(read_yaml(path)) if path else {}).items():
        if name not in DECLARATIONS:
            raise unknown_parameter(name)
        values[name] = checked(name, value)
    return parameters_of(values)


def unknown_parameter(name: str) -> InvalidInput:
    """Return the refusal of a name that is no parameter's; it tells those that are most like it."""
    near = get_close_matches(name[:_LONGEST_NAME], DECLARATIONS, n=5, cutoff=0.0)
    known = f"known are {', '.join(near)} and others: see config/planner.yaml"
    return InvalidInput(Status.OUT_OF_RANGE, name, "an unknown parameter", known)


@cache
def default_values() -> Mapping[str, Any]:
    """Return the values of `config/planner.yaml` by full name."""
    return flattened(read_yaml(share_directory() / "config" / "planner.yaml"))


def flattened(document: Any) -> dict[str, Any]:
    """Return the values in a document of ROS parameters by full name, not checked.

    Raises:
        InvalidInput: It is not as ROS expects.
    """
    nodes = mapping("", document, required=(), optional=("/**", "ff_planner", "/ff_planner"))
    values: dict[str, Any] = {}
    for node, block in nodes.items():
        _flatten(mapping(node, block, required=("ros__parameters",))["ros__parameters"], "", values)
    for name in FORMER_NAMES.keys() & values.keys():
        if FORMER_NAMES[name] in values:
            allowed = f"give {FORMER_NAMES[name]} alone"
            raise InvalidInput(Status.OUT_OF_RANGE, name, "given twice", allowed)
    return {present_name(name): value for name, value in values.items()}


def _flatten(block: Any, prefix: str, values: dict[str, Any]) -> None:
    if not isinstance(block, dict):
        field = prefix.rstrip(".") or "ros__parameters"
        raise InvalidInput(Status.OUT_OF_RANGE, field, quoted(block), "it must hold parameters")
    for name, value in block.items():
        full = f"{prefix}{name}"
        if isinstance(value, dict) or full in _GROUPS:
            _flatten(value, f"{full}.", values)
        else:
            values[full] = value


def checked(name: str, value: Any) -> Any:
    """Return a value as its parameter is declared; an array becomes a tuple.

    Raises:
        InvalidInput: It is of the wrong type or out of its range.
    """
    declared = DECLARATIONS[name]
    entries: list[Any] = list(value) if isinstance(value, list | tuple) else [value]
    is_array = declared.kind not in _KINDS
    kind: type[Any] = float if is_array else declared.kind
    if kind is float:
        with suppress(OverflowError):  # what no float can hold stays whole, and is refused
            entries = [float(e) if type(e) is int else e for e in entries]
    low = -math.inf if declared.minimum is None else declared.minimum
    high = math.inf if declared.maximum is None else declared.maximum
    sound = is_array == isinstance(value, list | tuple) and all(
        type(entry) is kind
        and (kind in (bool, str) or (math.isfinite(entry) and low <= entry <= high))
        for entry in entries
    )
    if not sound:
        raise InvalidInput(Status.OUT_OF_RANGE, name, quoted(value), declared.allowed)
    return tuple(entries) if is_array else entries[0]


def parameters_of(values: Mapping[str, Any]) -> NodeParameters:
    """Return the parameters with these values: every one, by full name.

    Raises:
        InvalidInput: A value that makes no sense.
    """
    return _group(NodeParameters, values, "")


def _group(group: type[Group], values: Mapping[str, Any], prefix: str) -> Group:
    types, read = get_type_hints(group), dict[str, Any]()
    for item in fields(group):
        kind, name = types[item.name], _full_name(prefix, item.name)
        if is_dataclass(kind):
            read[item.name] = _group(kind, values, f"{name}.")  # type: ignore[arg-type]
        else:
            value = values[name]
            read[item.name] = tuple(value) if isinstance(value, list) else value
    return group(**read)


def replaced(group: Group, name: str, value: Any) -> Group:
    """Return parameters with one value replaced; a name that is not ours is left out.

    Raises:
        InvalidInput: A value that makes no sense.
    """
    first, _, rest = _FIELDS.get(name, name).partition(".")
    if first not in {item.name for item in fields(group)}:
        return group
    inner = replaced(getattr(group, first), rest, value) if rest else value
    return replace(group, **{first: inner})


def value_of(parameters: NodeParameters, name: str) -> Any:
    """Return a parameter by its full name; None where it is not ours."""
    value: Any = parameters
    for part in _FIELDS.get(name, name).split("."):
        value = getattr(value, part, None)
    return value


def document_of(parameters: NodeParameters) -> dict[str, Any]:
    """Return every parameter as a parameters file has them: by group, arrays as lists."""
    document: dict[str, Any] = {}
    for name in DECLARATIONS:
        *groups, last = name.split(".")
        block = document
        for group in groups:
            block = block.setdefault(group, {})
        value = value_of(parameters, name)
        block[last] = list(value) if isinstance(value, tuple) else value
    return document
