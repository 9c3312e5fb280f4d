"""Conversion of the phases of a request and of its answer from messages, and to them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace

from ff_planner_msgs.msg import Goal, PlanRequest
from ff_planner_msgs.msg import Phase as PhaseMessage

from ff_planner_ros.common.declared_messages import names_in, value_at, values_in, write_object
from ff_planner_ros.errors import (
    fields_named,
    fields_placed,
    fields_renamed,
)
from ff_planner_ros.messages.payloads import payload_in
from ff_planner_ros.messages.status import GOAL_FIELDS, path_named
from ff_planner_ros.messages.target_bodies import NAMED_AS
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.planning.problem.goal_words import GoalKind
from ff_planner_ros.planning.problem.posture import Posture
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Target,
    TargetBody,
)
from ff_planner_ros.planning.task.phase import Phase, require_mass
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.whole import captured_bodies
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.messages.from_messages import (
    duration_in,
    limits_in,
    require_frame,
    require_known_goal,
)
from ff_planner_ros.ros.messages.interfaces import entry_of
from ff_planner_ros.ros.messages.joint_names import posture_in
from ff_planner_ros.ros.messages.paths import path_in
from ff_planner_ros.ros.messages.to_messages import (
    goal_of_joints,
    payload_message,
)

FIELD = "then"
_NAMES = names_in(Phase) | names_in(PlanningTask) | GOAL_FIELDS


def phases_in(
    request: PlanRequest, robot: Robot, parameters: NodeParameters, body: TargetBody | None
) -> tuple[Phase, ...]:
    """Return the phases that follow the goal of a request.

    Args:
        body: Target body that phases capture, at the first point of the first phase; None: no
            phase captures.

    Raises:
        InvalidInput: A field of a phase is invalid; the error names it.
    """
    phases = []
    for index, message in enumerate(value_at(request, FIELD)):
        placed = fields_placed(f"{FIELD}[{index}]")
        with placed, fields_named(_NAMES), fields_renamed(path_named):
            phases.append(_phase(message, robot, parameters, body))
    if phases and body is not None and request.goal.kind == GoalKind.CAPTURE:
        with fields_named(NAMED_AS):
            require_mass(body)
    return tuple(phases)


def _phase(
    message: PhaseMessage, robot: Robot, parameters: NodeParameters, body: TargetBody | None
) -> Phase:
    goal = message.goal
    require_known_goal(goal)
    names = {item.name for item in fields(Phase)}
    if goal.kind == GoalKind.POSE:
        frame = goal.pose.header.frame_id
        require_frame("goal.pose.header.frame_id", frame, parameters.inertial_frame)
    else:
        names.remove("target")
    given = values_in(Phase, message, names=names)
    if goal.kind == GoalKind.CAPTURE:
        given["target_body"] = body
    elif (posture := posture_in(goal, robot)) is not None:
        given["target"] = posture
    path = path_in(goal, message.limits, parameters.inertial_frame)
    if path is not None:
        given["target"] = path
    shortest, window = duration_in(message, None, None if path is None else path.duration)
    most = parameters.limits.limits().of_joints(robot.joints)
    given |= {
        "duration": shortest if window is None else window,
        "limits": limits_in(given.get("limits", {}), robot, most),
        "payload": payload_in(message),
    }
    return Phase(**given)


def phase_message(phase: Phase, joint_names: Sequence[str], inertial_frame: str) -> PhaseMessage:
    """Write a phase as an entry of a request's field `then`."""
    told = replace(phase, payload=None, duration=phase.longest_duration)
    message: PhaseMessage = write_object(told, PhaseMessage(), entry_of)
    message.goal.pose.header.frame_id = inertial_frame
    if isinstance(phase.duration, DurationRange):
        write_object(phase.duration, message, entry_of)
    if phase.target_body is not None:
        message.goal.kind = Goal.CAPTURE
    if isinstance(phase.target, Posture):
        message.goal = goal_of_joints(message.goal, phase.target, joint_names)
    if phase.payload is not None:
        message.payload = [payload_message(phase.payload)]
    return message


def not_in_requests(task: PlanningTask) -> Iterator[str]:
    """Yield the fields of goals that a task has and no request holds, as scenarios name them."""
    problem = task.problem
    is_pose = problem.target_body is None and problem.path is None
    first = problem.target if is_pose else None
    for number, target in enumerate((first, *(phase.target for phase in task.then))):
        for name in ("linear_acceleration", "angular_acceleration"):
            if isinstance(target, Target) and getattr(target, name).any():
                yield f"{f'phases[{number}].' if number else ''}target.{name}"
    if len({id(body) for body in captured_bodies(task) if body is not None}) > 1:
        yield "phases.target_body"
