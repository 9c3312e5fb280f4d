"""What makes a problem impossible before anything is solved."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.planning.distance.contact import tool_contact
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements import REQUIREMENTS, requirements_of
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import total_momentum


def require_plannable(problem: PlanningProblem, settings: PlannerSettings) -> None:
    """Refuse a start that violates a requirement by itself, and a goal out of reach.

    Raises:
        InvalidInput: Names what the start violates.
        NoPlanFound: The goal is out of reach.
    """
    robot = problem.robot
    q_start, v_start = configuration(robot, problem.start)
    ours = {required.name for required in REQUIREMENTS}
    for required in problem.requirements:
        if required.name in ours:
            allowed = "a requirement of the planner has this name"
            raise InvalidInput(Status.OUT_OF_RANGE, "requirements", required.name, allowed)
    for required in requirements_of(problem):
        required.refuse_start(problem, q_start, settings)
    momentum = total_momentum(robot, robot.model.createData(), q_start, v_start)
    if problem.posture is None:
        _require_reachable_goal(problem, q_start, momentum)


def _require_reachable_goal(problem: PlanningProblem, q_start: Array, momentum: Array) -> None:
    """Refuse a goal that no posture reaches, or that lies inside an obstacle.

    The system's centre of mass moves in a straight line. The end effector is never further from
    it than the stretched arm from the first joint, plus the largest distance between the first
    joint and the centre of mass.
    """
    robot, target = problem.robot, problem.target.position
    contact = tool_contact(problem)
    if contact is not None:
        raise NoPlanFound(
            Status.COLLISION,
            f"at the goal {contact.first} is {-contact.distance:.4f} m inside obstacle "
            f"{contact.second}, in any posture: choose a target further from it, or name "
            f"{contact.first.split('#')[0]}/{contact.second} in allowed_collisions.pairs if it is "
            "grasped",
        )
    for sphere in () if robot.bodies else problem.spheres:
        center = sphere.center + sphere.way(problem.duration)
        depth = sphere.radius - float(np.linalg.norm(target - center))
        if depth >= 0.0:
            raise NoPlanFound(
                Status.COLLISION,
                f"target.position lies {depth:.4f} m inside obstacle {sphere.id}: at the goal the "
                "arm cannot be outside it",
            )
    total_mass = pin.computeTotalMass(robot.model)
    center = pin.centerOfMass(robot.model, robot.model.createData(), q_start)
    center_at_end = center + momentum[:3] / total_mass * problem.duration
    reach = _reach(robot)
    distance = float(np.linalg.norm(target - center_at_end))
    if distance > reach:
        raise NoPlanFound(
            Status.GOAL_OUT_OF_REACH,
            f"target.position is {distance:.3f} m from where the system's centre of mass will be "
            f"at t = {problem.duration:g} s; the arm reaches at most {reach:.3f} m; choose a "
            "nearer goal or another duration",
        )


@lru_cache(maxsize=8)
def _reach(robot: Robot) -> float:
    """Return a distance from the system's centre of mass that the end effector never exceeds."""
    model = robot.model
    chaser, links = model.inertias[1], model.inertias[2:]
    placements = [model.jointPlacements[2 + k] for k in range(1, robot.joints)]
    placements.append(model.frames[robot.tip_frame_id].placement)
    # From the first joint to each joint and to the tip, the arm stretched.
    stretched = np.cumsum([0.0, *(np.linalg.norm(p.translation) for p in placements)])
    mount = np.linalg.norm(model.jointPlacements[2].translation - chaser.lever)
    moment = chaser.mass * mount + sum(
        link.mass * (length + np.linalg.norm(link.lever))
        for link, length in zip(links, stretched, strict=False)
    )
    return float(stretched[-1] + moment / pin.computeTotalMass(model))
