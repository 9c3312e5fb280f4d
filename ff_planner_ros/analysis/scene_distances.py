"""Distances between robot and obstacles at start and goal, before anything is planned."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.solids_apart import nearest_points
from ff_planner_ros.planning.distance.surroundings import obstacle_place
from ff_planner_ros.planning.problem.problem import Obstacle, Orientation, PlanningProblem
from ff_planner_ros.robot.collision.bodies import Body
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.configuration import configuration


@dataclass(frozen=True, eq=False)
class Gap:
    """The distance between a body of the robot and an obstacle or another body."""

    body: str
    other: str  # id of an obstacle, or name of a body
    distance: float  # negative where they penetrate [m]
    ends: Array  # the nearest point of each, inertial; shape (2, 3) [m]
    allowed: bool  # whether they may touch near the goal


def gaps_at_start(problem: PlanningProblem) -> list[Gap]:
    """Return each obstacle's gap to its nearest body at the start, and the smallest self gap.

    The smallest comes first.
    """
    robot = with_bodies(problem.robot)
    q, _ = configuration(robot, problem.start)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    places = [data.oMi[body.joint] * body.placement_in_joint for body in robot.bodies]
    placed = list(zip(robot.bodies, places, strict=True))
    own = [
        _gap(problem, *placed[first], robot.bodies[second], places[second])
        for first, second in problem.robot.pairs
    ]
    return _sorted([*_from_obstacles(problem, placed, 0.0), *_sorted(own)[:1]])


def gaps_at_goal(problem: PlanningProblem) -> list[Gap] | None:
    """Return each obstacle's gap to the tool at the goal, the smallest first.

    The tool is all that the last joint carries. None: the goal does not fix its orientation.
    """
    robot, target = with_bodies(problem.robot), problem.target
    if target.orientation is not Orientation.FIXED:
        return None
    placed = list(tool_at_goal(problem))
    return _sorted(_from_obstacles(problem, placed, problem.duration)) if robot.bodies else []


def tool_at_goal(problem: PlanningProblem) -> Iterator[tuple[Body, pin.SE3]]:
    """Yield the bodies that the last joint carries, and their poses at a fixed goal pose."""
    robot, target = with_bodies(problem.robot), problem.target
    goal = pin.SE3(pin.Quaternion(target.quaternion_xyzw).toRotationMatrix(), target.position)
    last = goal * robot.model.frames[robot.tip_frame_id].placement.inverse()
    for body in robot.bodies:
        if body.joint == robot.tree.tip + 1:
            yield body, last * body.placement_in_joint


def _from_obstacles(
    problem: PlanningProblem, placed: Sequence[tuple[Body, pin.SE3]], time: float
) -> Iterator[Gap]:
    for one in problem.obstacles if placed else ():
        there = obstacle_place(one, time)
        yield _sorted(_gap(problem, body, at, one, there) for body, at in placed)[0]


def _sorted(gaps: Iterable[Gap]) -> list[Gap]:
    return sorted(gaps, key=lambda gap: gap.distance)


def _gap(
    problem: PlanningProblem, body: Body, at: pin.SE3, other: Body | Obstacle, there: pin.SE3
) -> Gap:
    if isinstance(other, Body):
        solid, name, link = other.solid, other.name, other.link
    else:
        solid, name, link = other.solid.geometry, other.id, other.id
    distance, ends = nearest_points(body.solid, at, solid, there)
    allowed = problem.allowed_collisions
    return Gap(
        body.name,
        name,
        distance,
        ends,
        f"{body.link}/{link}" in allowed or f"{link}/{body.link}" in allowed,
    )
