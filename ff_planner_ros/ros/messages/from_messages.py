"""Messages to planning objects: pure functions, no clock; errors name the message's field."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from ff_planner_ros.common.arrays import Array, finite_number
from ff_planner_ros.common.declared import declared_by_name
from ff_planner_ros.common.declared_messages import names_in, values_in
from ff_planner_ros.common.forms import a_word
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import InvalidInput, Status, fields_named, fields_renamed
from ff_planner_ros.messages.obstacles import obstacles_of
from ff_planner_ros.messages.payloads import robot_holding
from ff_planner_ros.messages.status import GOAL_FIELDS, path_named
from ff_planner_ros.messages.target_bodies import NAMED_AS, target_body_in
from ff_planner_ros.messages.wheels import wheel_momenta_in
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.planning.problem.goal_words import GoalKind
from ff_planner_ros.planning.problem.limits import OF_ONE_NUMBER
from ff_planner_ros.planning.problem.posture import end_effector_at
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Limits,
    Obstacle,
    Orientation,
    PlanningProblem,
    Target,
    TargetBody,
    with_attached,
)
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.messages.joint_names import (
    joint_order,
    of_joints_in,
    posture_in,
)
from ff_planner_ros.ros.messages.paths import path_in

if TYPE_CHECKING:  # what is read may also be a message decoded where ROS is not installed
    from builtin_interfaces.msg import Time
    from ff_planner_msgs.msg import (
        ChaserState,
        Goal,
        Phase,
        PlanRequest,
        Scene,
    )
    from ff_planner_msgs.msg import TargetBody as TargetBodyMessage
    from geometry_msgs.msg import Point, Quaternion, Vector3

# builtin_interfaces/Time counts seconds in an int32.
MAX_MESSAGE_SECONDS = 2**31 - 1
_JOINTS = ("joint_positions", "joint_velocities", "joint_accelerations")


class OnCancel(StrEnum):
    """Result of an action goal that is cancelled."""

    DISCARD = "discard"  # no plan
    BEST = "best"  # the best plan found until then


def require_supported(request: PlanRequest) -> None:
    """Refuse a request whose goal kind or `on_cancel` is unknown.

    Raises:
        InvalidInput: One of them is unknown.
    """
    require_known_goal(request.goal)
    a_word(OnCancel).read("on_cancel", request.on_cancel or OnCancel.DISCARD)


def require_known_goal(goal: Goal) -> None:
    """Refuse a goal of an unknown kind.

    Raises:
        InvalidInput: The kind is none of `GoalKind`.
    """
    if goal.kind not in iter(GoalKind):
        named = ", ".join(f"{one.name} ({one:d})" for one in GoalKind)
        allowed = f"it must be one of {named}"
        raise InvalidInput(Status.OUT_OF_RANGE, "goal.kind", goal.kind, allowed)


def problem_from_request(
    request: PlanRequest,
    robot: Robot,
    start: SystemState,
    obstacles: tuple[Obstacle, ...],
    parameters: NodeParameters,
    body: TargetBody | None = None,
    remaining: float | None = None,
) -> PlanningProblem:
    """Return the planning problem of a request; start state and scene in the request are ignored.

    Args:
        robot: Robot without the payload that the request may bring.
        start: Measured state of the system.
        obstacles: At the plan's first point.
        body: Target body to capture, at the plan's first point; None: the goal is no capture.
        remaining: Time left to the goal of the plan that is replaced [s], which is the duration if
            the request's is zero; None: no plan is replaced.

    Raises:
        InvalidInput: A field of the request is invalid; the error names it.
    """
    robot = robot_holding(robot, request)
    posture = posture_in(request.goal, robot)
    path = path_in(request.goal, request.limits, parameters.inertial_frame)
    if request.goal.kind == GoalKind.POSE:
        target_frame = request.goal.pose.header.frame_id
        require_frame("goal.pose.header.frame_id", target_frame, parameters.inertial_frame)
    most = parameters.limits.limits().of_joints(robot.joints)
    names = names_in(PlanningProblem) | names_in(DurationRange, "duration")
    with fields_named(NAMED_AS | names | GOAL_FIELDS), fields_renamed(path_named):
        given = values_in(PlanningProblem, request, names=_names(request, body))
        of_path = None if path is None else path.duration
        given["duration"], given["duration_range"] = duration_in(request, remaining, of_path)
        given["limits"] = limits_in(given.get("limits", {}), robot, most)
        given["requirements"] = parameters.requirements
        given["points"] = request.search.points or parameters.points
        if posture is not None:
            given |= {"target": end_effector_at(robot, start), "posture": posture}
        if path is not None:
            given |= {"target": end_effector_at(robot, start), "path": path}
        if body is not None:
            given["target"] = body.target(given["duration"])
            obstacles = with_attached(obstacles, body)
        return PlanningProblem(
            robot=robot, start=start, obstacles=obstacles, target_body=body, **given
        )


def _names(request: PlanRequest, body: TargetBody | None) -> list[str]:
    """Return the fields of the problem to read from a request; only a pose goal has a target."""
    names = [item.name for item in fields(PlanningProblem)]
    if request.goal.kind in (GoalKind.JOINTS, GoalKind.AT_REST, GoalKind.FOLLOW):
        names.remove("target")
    if body is None:
        return names
    told = values_in(Target, request.goal, "target", ("orientation", "free_axis_in_ee"))
    if told:
        field, given = "goal.orientation", told.get("orientation", Orientation.FIXED)
        allowed = "a capture has the grasp's orientation: it must be fixed, without a free_axis"
        raise InvalidInput(Status.UNSUPPORTED, field, given, allowed)
    names.remove("target")
    return names


def limits_in(asked: Mapping[str, Any], robot: Robot, kept: Limits) -> Limits:
    """Return the limits of a request: those of the parameters, or lower ones that it asks for.

    Args:
        asked: Limits in the request, by the field of `Limits`.
        kept: Limits of the parameters.

    Raises:
        InvalidInput: A limit is not positive, or higher than the parameter's.
    """
    for name in OF_ONE_NUMBER:
        number, most = asked.get(name, getattr(kept, name)), getattr(kept, name)
        unit = declared_by_name(Limits)[name].unit
        if name in asked:
            finite_number(f"limits.{name}", number)
        if not 0.0 < number <= most:
            upper = f" and at most {most:g} {unit}" if math.isfinite(most) else ""
            raise InvalidInput(
                Status.OUT_OF_RANGE,
                f"limits.{name}",
                number,
                f"it must be greater than 0 {unit}{upper}; left out, the parameter limits.{name} "
                "holds, which no request exceeds",
            )
    lower = replace(kept, **asked).of_joints(robot.joints)
    highest = kept.joint_accelerations or (math.inf,) * robot.joints
    for joint, limit in enumerate(lower.joint_accelerations or ()):
        if limit > highest[joint]:
            allowed = (
                f"joint {robot.joint_names[joint]} must not be given more than {highest[joint]:g} "
                f"{robot.unit(joint)}/s2, the parameter limits.acceleration, which no request "
                "exceeds"
            )
            field, found = "limits.acceleration", list(asked["joint_accelerations"])
            raise InvalidInput(Status.OUT_OF_RANGE, field, found, allowed)
    return lower


def duration_in(
    request: PlanRequest | Phase, remaining: float | None, of_path: float | None = None
) -> tuple[float, DurationRange | None]:
    """Return the duration, and its range where the planner chooses it, else None.

    Args:
        remaining: As in `problem_from_request` [s].
        of_path: Time of the last pose of a path to follow, which is the duration if the request's
            is zero or the same to the nanosecond [s]; None: there is no path.

    Returns:
        Duration [s], the longest one if there is a range; range.

    Raises:
        InvalidInput: The duration or its range is invalid.
    """
    if (
        remaining is not None
        and of_path is None
        and request.duration == request.duration_max == 0.0
    ):
        return remaining, None
    if of_path is not None and request.duration_max == 0.0:
        require_end("goal.path", of_path, of_path)
        if request.duration == 0.0 or abs(request.duration - of_path) * NANOSECONDS < 1.0:
            return of_path, None
    shortest = finite_number("duration", request.duration, above=0.0)
    window = None
    if request.duration_max != 0.0:
        window = DurationRange(shortest, request.duration_max)
    longest = shortest if window is None else window.maximum
    # Before any motion is predicted for so long.
    require_end("duration" if window is None else "duration_max", longest, longest)
    return longest, window


def require_end(field: str, duration: float, end: float) -> None:
    """Refuse a duration with which a plan ends after the last time that a message can hold.

    Args:
        end: When the plan ends, or a lower bound of that, since 1970 [s].

    Raises:
        InvalidInput: The plan ends too late.
    """
    if end > MAX_MESSAGE_SECONDS:
        raise InvalidInput(Status.OUT_OF_RANGE, field, duration, "the plan must end before 2038")


def time_in_ns(field: str, time: Time) -> int:
    """Return a message's time [ns].

    Raises:
        InvalidInput: It has more nanoseconds than a second, or is negative.
    """
    if time.sec < 0:
        allowed = "it must not be negative: before 1970"
        raise InvalidInput(Status.OUT_OF_RANGE, f"{field}.sec", time.sec, allowed)
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

    It may name joints, too, that the robot has locked.

    Raises:
        InvalidInput: A field of the message cannot be used; the error names it.
    """
    require_frame(f"{source}.header.frame_id", message.header.frame_id, inertial_frame)
    momenta = wheel_momenta_in(message, f"{source}.wheel_momenta", robot)
    names, locked = message.joint_names, {one.name for one in robot.locked_joints}
    order = joint_order(f"{source}.joint_names", names, robot.joint_names, beside=locked)
    with fields_named(names_in(SystemState, "", source)):
        given = values_in(SystemState, message)
        for name in _JOINTS:
            if name in given:
                given[name] = of_joints_in(f"{source}.{name}", given[name], order, len(names))
        return SystemState(**given, wheel_momenta=momenta)


def target_body_from_message(message: TargetBodyMessage, inertial_frame: str) -> TargetBody:
    """Read a target body at its stamp, of topic or field `target_body`.

    Raises:
        InvalidInput: A field of the message cannot be used; the error names it.
    """
    require_frame("target_body.header.frame_id", message.header.frame_id, inertial_frame)
    return target_body_in(message)


def scene_from_message(message: Scene, source: str, inertial_frame: str) -> tuple[Obstacle, ...]:
    """Read the obstacles of the topic or field `source`, at their stamp, in the inertial frame.

    Raises:
        InvalidInput: A field of the message cannot be used, or two obstacles share an id.
    """
    require_frame(f"{source}.header.frame_id", message.header.frame_id, inertial_frame)
    return obstacles_of(message, source)


def require_frame(field: str, frame_id: str, allowed: str) -> None:
    """Refuse a frame other than the allowed one.

    Raises:
        InvalidInput: `frame_id` differs from `allowed` (WRONG_FRAME).
    """
    if frame_id != allowed:
        raise InvalidInput(Status.WRONG_FRAME, field, repr(frame_id), f"it must be '{allowed}'")


def xyz(message: Point | Vector3) -> Array:
    """Return a point or vector as an array. Shape (3,)."""
    return np.array([message.x, message.y, message.z])


def xyzw(message: Quaternion) -> Array:
    """Return a quaternion as an array x, y, z, w. Shape (4,)."""
    return np.array([message.x, message.y, message.z, message.w])
