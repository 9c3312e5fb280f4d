"""Messages to planning objects: pure functions, no clock; errors name the message's field."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import MISSING, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from ff_planner_ros.arrays import Array, finite_number, finite_vector
from ff_planner_ros.bag.approaches import APPROACH_NAMED_AS, approach_in
from ff_planner_ros.bag.decoding import NANOSECONDS, nanoseconds
from ff_planner_ros.bag.plans import trajectory_in
from ff_planner_ros.bag.target_bodies import NAMED_AS, target_body_in
from ff_planner_ros.errors import InvalidInput, Status, fields_named
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.planning.metrics import Metrics
from ff_planner_ros.planning.plan import Plan, SolverReport
from ff_planner_ros.planning.problem import (
    CONTACT_DISTANCE,
    DurationRange,
    Limits,
    Objective,
    Orientation,
    PlanningProblem,
    Sphere,
    Target,
    TargetBody,
    with_attached_spheres,
)
from ff_planner_ros.planning.scenario import orientation_of, parametrisation_of
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState

if TYPE_CHECKING:  # what is read may also be a message decoded where ROS is not installed
    from builtin_interfaces.msg import Time
    from ff_planner_msgs.msg import ChaserState, ObstacleSphere, ObstacleSphereArray, PlanMetrics
    from ff_planner_msgs.msg import SolverReport as SolverReportMessage
    from ff_planner_msgs.msg import TargetBody as TargetBodyMessage
    from ff_planner_msgs.srv import PlanTrajectory
    from geometry_msgs.msg import Point, Quaternion, Vector3

# builtin_interfaces/Time counts seconds in an int32.
MAX_MESSAGE_SECONDS = 2**31 - 1
# Of joints at fault: more than any arm has would bury the message.
_NAMES_SHOWN = 20


def problem_from_request(
    request: PlanTrajectory.Request,
    robot: Robot,
    start: SystemState,
    obstacles: tuple[Sphere, ...],
    parameters: NodeParameters,
    body: TargetBody | None = None,
    remaining: float | None = None,
) -> PlanningProblem:
    """Build the problem of a request; its start state and obstacles are not looked at.

    Args:
        obstacles: At the plan's first point.
        body: That is captured, then; None: the goal is the request's target pose.
        remaining: Of a running plan [s], the duration of a request that leaves it at zero. None:
            no plan is continued.

    Raises:
        InvalidInput: A field of the request cannot be used; the error names it.
    """
    if body is None:
        target_frame = request.target_pose.header.frame_id
        require_frame("target_pose.header.frame_id", target_frame, parameters.inertial_frame)
    named_as = NAMED_AS | {
        "target.position": "target_pose.pose.position",
        "target.quaternion_xyzw": "target_pose.pose.orientation",
        "target.linear_velocity": "target_twist.linear",
        "target.angular_velocity": "target_twist.angular",
        "target.orientation": "orientation",
        "target.free_axis": "free_axis",
        "objective.joint_path_length": "weight_joint_path_length",
        "objective.chaser_attitude": "weight_chaser_attitude",
        "objective.duration": "weight_duration",
        "objective": "weight_joint_path_length, weight_chaser_attitude and weight_duration",
        "duration.min": "duration",
        "duration.max": "duration_max",
        **APPROACH_NAMED_AS,
    }
    limits = _limits(request, robot, parameters)
    with fields_named(named_as):
        duration, window = _duration(request, remaining)
        return PlanningProblem(
            robot=robot,
            start=start,
            target=_target(request) if body is None else _grasp(request, body, duration),
            duration=duration,
            duration_range=window,
            points=request.points or parameters.points,
            obstacles=obstacles if body is None else with_attached_spheres(obstacles, body),
            objective=Objective(
                joint_path_length=request.weight_joint_path_length,
                chaser_attitude=request.weight_chaser_attitude,
                duration=getattr(request, "weight_duration", 0.0),
            ),
            limits=limits,
            parametrisation=parametrisation_of(getattr(request, "parametrisation", "") or "auto"),
            allowed_at_goal=tuple(getattr(request, "allowed_at_goal", ())),
            contact_distance=getattr(request, "contact_distance", 0.0) or CONTACT_DISTANCE,
            target_body=body,
            approach=approach_in(request),
        )


def _limits(request: PlanTrajectory.Request, robot: Robot, parameters: NodeParameters) -> Limits:
    """Return the limits of a request: those of the parameters, or lower ones that it asks for."""
    asked_attitude = request.limit_chaser_attitude
    most = parameters.limits.chaser_attitude or math.inf
    if not 0.0 <= asked_attitude <= most:
        upper = f" and at most {most:g} rad" if math.isfinite(most) else ""
        raise InvalidInput(
            Status.OUT_OF_RANGE,
            "limit_chaser_attitude",
            asked_attitude,
            f"it must be greater than 0 rad{upper}; 0 stands for the parameter "
            "limits.chaser_attitude, which no request exceeds",
        )
    kept = parameters.limits.limits(asked_attitude).of_joints(robot.joints)
    # A message decoded from a bag of an earlier version has no such field.
    field, asked = "limit_accelerations", tuple(getattr(request, "limit_accelerations", ()))
    if not asked:
        return kept
    parts = {f"limits.acceleration[{joint}]": f"{field}[{joint}]" for joint in range(len(asked))}
    with fields_named({"limits.acceleration": field} | parts):
        lower = replace(kept, joint_accelerations=asked).of_joints(robot.joints)
    highest = kept.joint_accelerations or (math.inf,) * robot.joints
    for joint, limit in enumerate(lower.joint_accelerations or ()):
        if limit > highest[joint]:
            allowed = (
                f"joint {robot.joint_names[joint]} must not be given more than {highest[joint]:g} "
                "rad/s2, the parameter limits.acceleration, which no request exceeds"
            )
            raise InvalidInput(Status.OUT_OF_RANGE, field, list(asked), allowed)
    return lower


def _target(request: PlanTrajectory.Request) -> Target:
    """Return the target pose and twist of a request."""
    orientation, axis = _orientation(request)
    given = orientation is Orientation.ABOUT_AXIS or axis.any()
    return Target(
        position=xyz(request.target_pose.pose.position),
        quaternion_xyzw=xyzw(request.target_pose.pose.orientation),
        linear_velocity=xyz(request.target_twist.linear),
        angular_velocity=xyz(request.target_twist.angular),
        orientation=orientation,
        free_axis_in_ee=axis if given else None,
    )


def _duration(
    request: PlanTrajectory.Request, remaining: float | None
) -> tuple[float, DurationRange | None]:
    """Return the duration and, where the planner is to choose one, its range, else None."""
    if remaining is not None and request.duration == getattr(request, "duration_max", 0.0) == 0.0:
        return remaining, None
    shortest = finite_number("duration", request.duration, above=0.0)
    # A message decoded from a bag of an earlier version has no such field.
    longest = getattr(request, "duration_max", 0.0)
    if longest == 0.0:
        return shortest, None
    window = DurationRange(shortest, longest)
    return window.maximum, window


def _grasp(request: PlanTrajectory.Request, body: TargetBody, duration: float) -> Target:
    """Return the grasp of a body after a duration [s]."""
    orientation, axis = _orientation(request)
    if orientation is not Orientation.FIXED or axis.any():
        allowed = "a capture has the grasp's orientation: it must be fixed or empty"
        raise InvalidInput(Status.UNSUPPORTED, "orientation", request.orientation, allowed)
    return body.target(duration)


def _orientation(request: PlanTrajectory.Request) -> tuple[Orientation, Array]:
    # A message decoded from a bag of an earlier version has no such fields.
    orientation = orientation_of("orientation", getattr(request, "orientation", "") or "fixed")
    axis = xyz(request.free_axis) if hasattr(request, "free_axis") else np.zeros(3)
    return orientation, axis


def time_in_ns(field: str, time: Time) -> int:
    """Return a message's time [ns].

    Raises:
        InvalidInput: It has more nanoseconds than a second.
    """
    if time.nanosec >= NANOSECONDS:
        raise InvalidInput(
            Status.OUT_OF_RANGE,
            f"{field}.nanosec",
            time.nanosec,
            f"it must be less than {NANOSECONDS}: whole seconds belong into sec",
        )
    return nanoseconds(time)


def state_from_message(
    message: ChaserState, source: str, robot: Robot, inertial_frame: str
) -> SystemState:
    """Read a chaser state of the topic or field `source`; its joints may come in any order.

    Raises:
        InvalidInput: A field of the message cannot be used; the error names it.
    """
    require_frame(f"{source}.header.frame_id", message.header.frame_id, inertial_frame)
    order = joint_order(f"{source}.joint_names", message.joint_names, robot.joint_names)
    named_as = {
        "chaser.position": f"{source}.pose.position",
        "chaser.quaternion_xyzw": f"{source}.pose.orientation",
        "chaser.linear_velocity": f"{source}.twist.linear",
        "chaser.angular_velocity": f"{source}.twist.angular",
    }
    positions = finite_vector(
        f"{source}.joint_positions", list(message.joint_positions), robot.joints
    )
    velocities = finite_vector(
        f"{source}.joint_velocities", list(message.joint_velocities), robot.joints
    )
    accelerations = None
    # A message decoded from a bag of an earlier version has no such field.
    if len(given := getattr(message, "joint_accelerations", ())):
        field = f"{source}.joint_accelerations"
        accelerations = finite_vector(field, list(given), robot.joints)[order]
    with fields_named(named_as):
        return SystemState(
            position_chaser_in_inertial=xyz(message.pose.position),
            quaternion_chaser_to_inertial_xyzw=xyzw(message.pose.orientation),
            linear_velocity_chaser_in_inertial=xyz(message.twist.linear),
            angular_velocity_chaser_in_inertial=xyz(message.twist.angular),
            joint_positions=positions[order],
            joint_velocities=velocities[order],
            joint_accelerations=accelerations,
        )


def target_body_from_message(message: TargetBodyMessage, inertial_frame: str) -> TargetBody:
    """Read a target body at its stamp, of topic or field `target_body`.

    Raises:
        InvalidInput: A field of the message cannot be used; the error names it.
    """
    require_frame("target_body.header.frame_id", message.header.frame_id, inertial_frame)
    return target_body_in(message)


def spheres_from_message(message: ObstacleSphereArray, inertial_frame: str) -> tuple[Sphere, ...]:
    """Read the scene at its stamp, which must be given in the inertial frame.

    Raises:
        InvalidInput: A field of the message cannot be used, two spheres share an id, or one turns.
    """
    require_frame("obstacles.header.frame_id", message.header.frame_id, inertial_frame)
    first: dict[str, int] = {}
    for i, sphere in enumerate(message.spheres):
        if first.setdefault(sphere.id, i) != i:
            raise InvalidInput(
                Status.OUT_OF_RANGE,
                f"obstacles.spheres[{i}].id",
                repr(sphere.id),
                f"every id must be given once, and spheres[{first[sphere.id]}] has it already",
            )
    return tuple(_sphere(f"obstacles.spheres[{i}]", s) for i, s in enumerate(message.spheres))


def plan_from_response(response: PlanTrajectory.Response) -> Plan:
    """Read the plan back out of a response whose status is SOLVED.

    Its times are rounded to nanoseconds; it holds NaN where the response leaves something out.
    """
    return Plan(
        joint_names=tuple(response.joint_trajectory.joint_names),
        trajectory=trajectory_in(response),
        xi=np.array(response.xi),
        orientation_reading=response.orientation_reading,
        family=getattr(response, "parametrisation", ""),
        metrics=metrics_from_message(response.metrics),
        solver=solver_report_from_message(response.solver),
        duration=getattr(response, "duration", 0.0) or None,
    )


def metrics_from_message(message: PlanMetrics) -> Metrics:
    """Read the metrics of a plan or of the best attempt."""
    values = {
        item.name: getattr(message, item.name)
        for item in fields(Metrics)
        # A message decoded from a bag of an earlier version lacks what has a default.
        if item.default is MISSING or hasattr(message, item.name)
    }
    return Metrics(**values | {"peak_joint_torques": tuple(message.peak_joint_torques)})


def solver_report_from_message(message: SolverReportMessage) -> SolverReport:
    """Read how the search went."""
    return SolverReport(**{one.name: getattr(message, one.name) for one in fields(SolverReport)})


def require_frame(field: str, frame_id: str, allowed: str) -> None:
    """Refuse a frame that is not the one allowed.

    Raises:
        InvalidInput: It is another one.
    """
    if frame_id != allowed:
        raise InvalidInput(Status.WRONG_FRAME, field, repr(frame_id), f"it must be '{allowed}'")


def joint_order(
    field: str, found: Sequence[str], wanted: Sequence[str], others_allowed: bool = False
) -> list[int]:
    """Return where each wanted joint stands among those found, with or without other joints.

    Raises:
        InvalidInput: A joint is unknown, missing or named twice.
    """
    known = set(wanted)
    counts = Counter(name for name in found if name in known) if others_allowed else Counter(found)
    faults = [
        f"{fault}: {_listed(names)}"
        for fault, names in (
            ("unknown", sorted(counts.keys() - known)),
            ("missing", sorted(known - counts.keys())),
            ("more than once", sorted(name for name, times in counts.items() if times > 1)),
        )
        if names
    ]
    if faults:
        raise InvalidInput(
            Status.UNKNOWN_JOINT,
            field,
            list(found),
            f"it must name each of {', '.join(wanted)} once ({'; '.join(faults)})",
        )
    return [found.index(name) for name in wanted]


def _listed(names: list[str]) -> str:
    shown = ", ".join(names[:_NAMES_SHOWN])
    rest = len(names) - _NAMES_SHOWN
    return f"{shown} and {rest} more" if rest > 0 else shown


def _sphere(field: str, message: ObstacleSphere) -> Sphere:
    turning = finite_vector(f"{field}.twist.angular", xyz(message.twist.angular), 3)
    if turning.any():
        raise InvalidInput(
            Status.UNSUPPORTED,
            f"{field}.twist.angular",
            turning.tolist(),
            "it must be zero: nothing says what the sphere goes round; a body that turns, with all "
            "that is fixed to it, is a target_body",
        )
    parts = {"center": "center", "radius": "radius", "velocity": "twist.linear"}
    name = f"obstacles[{message.id}]"
    with fields_named({f"{name}.{part}": f"{field}.{told}" for part, told in parts.items()}):
        return Sphere(
            id=message.id,
            center=xyz(message.center),
            radius=message.radius,
            velocity=xyz(message.twist.linear),
        )


def xyz(message: Point | Vector3) -> Array:
    """Return a message's three numbers. Shape (3,)."""
    return np.array([message.x, message.y, message.z])


def xyzw(message: Quaternion) -> Array:
    """Return a message's quaternion. Shape (4,)."""
    return np.array([message.x, message.y, message.z, message.w])
