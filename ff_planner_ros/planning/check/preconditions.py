"""Refusal of problems that are impossible by their start, goal or duration, before the search."""

from __future__ import annotations

from collections.abc import Iterator

import coal
import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.planning.distance.contact import self_contact, tool_contact
from ff_planner_ros.planning.distance.solids_apart import distance_between
from ff_planner_ros.planning.distance.surroundings import obstacle_place, surroundings
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.problem.target_body import MOST_TURNS
from ff_planner_ros.planning.requirements import REQUIREMENTS, requirements_of
from ff_planner_ros.planning.requirements.requirement import LIMIT_TOLERANCE
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot

# A joint that must exceed its limits by more than this fraction is refused at once.
_SPARE = 1e-3


def require_askable(problem: PlanningProblem) -> None:
    """Refuse what no plan can be asked for, whatever the start.

    Raises:
        InvalidInput: A requirement cannot be asked of the problem, or a plug-in has the name of one
            of ours.
    """
    ours = {required.name for required in REQUIREMENTS}
    for required in problem.requirements:
        if required.name in ours:
            allowed = "a requirement of the planner has this name"
            raise InvalidInput(Status.OUT_OF_RANGE, "requirements", required.name, allowed)
    for required in requirements_of(problem):
        required.refuse(problem)


def require_plannable(problem: PlanningProblem, settings: PlannerSettings) -> None:
    """Refuse a start that violates a requirement by itself, and what no posture reaches.

    Raises:
        InvalidInput: As by `require_askable`; or the start violates a requirement, or within the
            duration the system turns too far.
        NoPlanFound: Goal or path is out of reach or inside an obstacle, or in its posture the robot
            touches itself.
    """
    require_askable(problem)
    q_start, v_start = configuration(problem.robot, problem.start)
    for required in requirements_of(problem):
        required.refuse_start(problem, q_start, settings)
    if problem.posture is None:
        _require_reachable(problem, q_start, v_start)
    elif problem.posture.positions is not None:
        _require_apart(problem, problem.posture.positions)
    _require_foretold(problem, v_start)


def require_time(problem: PlanningProblem) -> None:
    """Refuse a duration that is too short for a joint to reach its posture within its limits.

    From rate v0 to v1 it takes |v1 - v0| / a. In a time T a joint gets no further than by full
    acceleration and then full deceleration, (v0 + v1) T / 2 + a T^2 / 4 - (v1 - v0)^2 / (4 a),
    likewise the other way, and than at its highest rate.

    Raises:
        NoPlanFound: It names the joint.
    """
    posture = problem.posture
    if posture is None:
        return
    robot, start, duration = problem.robot, problem.start, problem.duration
    v0, v1 = start.joint_velocities, np.broadcast_to(posture.rates, start.joint_velocities.shape)
    most = np.full(robot.joints, np.inf)
    if problem.limits.joint_accelerations is not None:
        most = (1.0 + _SPARE) * np.array(problem.limits.joint_accelerations)
    lacks = np.abs(v1 - v0) / most / duration
    if posture.positions is not None:
        way = posture.positions - start.joint_positions
        faster = most * duration**2 / 4.0 - (v1 - v0) ** 2 / (4.0 * most)
        is_too_far = np.abs(way - (v0 + v1) * duration / 2.0) > faster
        lacks = np.where(is_too_far, np.maximum(lacks, 1.0 + _SPARE), lacks)
        if problem.limits.joint_velocities:
            rates = (1.0 + _SPARE) * np.maximum(robot.velocity_limits, np.abs(v0))
            lacks = np.maximum(lacks, np.abs(way) / rates / duration)
    joint = int(lacks.argmax())
    if lacks[joint] > 1.0:
        reached = "come to rest" if posture.positions is None else "reach the posture asked for"
        limits = problem.limits
        kept = ["velocity"] if limits.joint_velocities and posture.positions is not None else []
        kept += ["acceleration"] if limits.joint_accelerations is not None else []
        raise NoPlanFound(
            Status.LIMIT_VIOLATED,
            f"{duration:g} s is too short for joint {robot.joint_names[joint]} to {reached} within "
            f"the limits of its {' and '.join(kept)} alone; choose a longer duration",
        )


def _require_foretold(problem: PlanningProblem, v_start: Array) -> None:
    """Refuse a duration in which the velocities at start or goal lead too far to be integrated."""
    posture, joints = problem.posture, np.abs(v_start[6:])
    if posture is not None:
        joints = np.maximum(joints, np.abs(posture.rates))
    turns = float(np.linalg.norm(v_start[3:6]) + joints.sum()) * problem.duration
    if turns > MOST_TURNS:
        allowed = (
            f"chaser and joints would turn by {turns:.3g} rad at the velocities of start and goal, "
            f"too far to be foretold; {MOST_TURNS:g} rad are allowed"
        )
        raise InvalidInput(Status.OUT_OF_RANGE, "duration", f"{problem.duration:g} s", allowed)


def _require_apart(problem: PlanningProblem, positions: Array) -> None:
    """Refuse a posture in which two bodies of the robot touch: every plan would end so."""
    contact = self_contact(problem, positions)
    if contact is not None and contact.distance < -LIMIT_TOLERANCE:
        raise NoPlanFound(
            Status.COLLISION,
            f"in the posture of the goal {contact.first} is {-contact.distance:.4f} m inside "
            f"{contact.second}, however the robot gets there: choose another posture",
        )


def _require_reachable(problem: PlanningProblem, q_start: Array, v_start: Array) -> None:
    """Refuse a goal or a path that no posture reaches, or that lies inside an obstacle.

    The system's centre of mass moves in a straight line. The end effector is never further from
    it than the stretched arm from the first joint, plus the largest distance between the first
    joint and the centre of mass.
    """
    robot, path = problem.robot, problem.path
    room = 0.0 if path is None else path.position_tolerance
    data = robot.model.createData()
    pin.centerOfMass(robot.model, data, q_start, v_start)
    reach = _reach(robot)
    around = surroundings(() if robot.bodies else problem.obstacles)
    for key, position, time in _places(problem):
        point = pin.SE3(np.eye(3), position)
        for number in around.near(position, 0.0, time):
            one = problem.obstacles[number]
            there = obstacle_place(one, time)
            depth = -distance_between(coal.Sphere(0.0), point, one.solid.geometry, there)
            if depth >= room:
                raise NoPlanFound(
                    Status.COLLISION,
                    f"{key} lies {depth:.4f} m inside obstacle {one.id} at t = {time:g} s: there "
                    "the arm cannot be outside it",
                )
        distance = float(np.linalg.norm(position - data.com[0] - data.vcom[0] * time))
        if distance > reach + room:
            raise NoPlanFound(
                Status.GOAL_OUT_OF_REACH,
                f"{key} is {distance:.3f} m from where the system's centre of mass will be "
                f"at t = {time:g} s; the arm reaches at most {reach:.3f} m; choose a "
                "nearer goal or another duration",
            )
    contact = tool_contact(problem)
    if contact is not None:
        link = contact.first.split("#")[0]
        grasped = f", or name {link}/{contact.second} in allowed_collisions.pairs if it is grasped"
        raise NoPlanFound(
            Status.COLLISION,
            f"at the goal {contact.first} is {-contact.distance:.4f} m inside obstacle "
            f"{contact.second}, in any posture: choose a target further from it"
            f"{grasped if robot.bodies else ''}",
        )


def _places(problem: PlanningProblem) -> Iterator[tuple[str, Array, float]]:
    """Yield field, position and time [s] of all that the end effector must come to."""
    if problem.path is not None:
        for number, one in enumerate(problem.path.points):
            yield f"target.path[{number}].position", one.position, one.time
    elif problem.target_body is not None:
        yield "target_body.grasp.position", problem.target.position, problem.duration
    else:
        yield "target.position", problem.target.position, problem.duration


def _reach(robot: Robot) -> float:
    """Return an upper bound of the end effector's distance from the centre of mass [m]."""
    model = robot.model
    chaser, links = model.inertias[1], model.inertias[2:]
    tree, first = robot.tree, model.jointPlacements[2 + robot.tree.to_tip[0]].translation
    # From where the arm's first joint is at zero to each joint, all of it stretched.
    stretched = np.zeros(tree.joints + 1)
    for k, placement in enumerate(model.jointPlacements[2:]):
        way = placement.translation - (0.0 if tree.before[k] else first)
        length = np.linalg.norm(way) + robot.furthest_slides[k]
        stretched[k + 1] = stretched[tree.before[k]] + length
    mount = np.linalg.norm(first - chaser.lever)
    moment = chaser.mass * mount + sum(
        link.mass * (length + np.linalg.norm(link.lever))
        for link, length in zip(links, stretched[1:], strict=True)
    )
    beyond = np.linalg.norm(model.frames[robot.tip_frame_id].placement.translation)
    return float(stretched[tree.tip] + beyond + moment / pin.computeTotalMass(model))
