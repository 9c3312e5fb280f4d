"""Which bodies may touch what, and when: a tool closes on what it grasps.

A pair that a task allows to touch may do so in the last part of the way alone: from when on the
end effector stays within the problem's contact distance from its goal, and in the tail. The goal is
where the grasp is at each moment.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.distance.grasp_seen import GraspSeen
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.collision.lines import with_bodies


@lru_cache(maxsize=4)
def split_pairs(problem: PlanningProblem) -> tuple[Indices, Indices]:
    """Return the numbers of the pairs that must never touch, and of those allowed at the goal."""
    bodies, allowed = problem.robot.bodies, problem.allowed_collisions
    names = [(bodies[a].link, bodies[b].link) for a, b in problem.robot.pairs]
    may = [f"{a}/{b}" in allowed or f"{b}/{a}" in allowed for a, b in names]
    return _split(may)


@lru_cache(maxsize=4)
def split_spheres(problem: PlanningProblem) -> tuple[Indices, Indices]:
    """Return likewise bodies and spheres: body times the number of spheres, plus sphere."""
    may = [
        f"{body.link}/{sphere.id}" in problem.allowed_collisions
        for body in problem.robot.bodies
        for sphere in problem.spheres
    ]
    return _split(may)


@lru_cache(maxsize=4)
def split_obstacles(problem: PlanningProblem) -> tuple[Indices, Indices]:
    """Return likewise bodies and obstacles of any shape: body times their number, plus obstacle."""
    may = [
        f"{body.link}/{one.id}" in problem.allowed_collisions
        for body in with_bodies(problem.robot).bodies
        for one in problem.obstacle_bodies
    ]
    return _split(may)


def before_contact(problem: PlanningProblem, times: Array, q: Array, within: float = 1.0) -> int:
    """Return the last configuration of a motion at which the allowed pairs, too, must be apart.

    Args:
        times: From the plan's first point on, ascending. Shape (times,) [s].
        q: Shape (times, 7 + joints).
        within: Part of the contact distance that counts.

    Returns:
        Its number; -1: none is.
    """
    points = arm_points(problem.robot, q)[:, -1]
    to_goal = np.linalg.norm(GraspSeen(problem, times).from_grasp(points), axis=1)
    outside = np.flatnonzero(to_goal > within * problem.contact_distance)
    return int(outside[-1]) if outside.size else -1


def last_points(
    problem: PlanningProblem, motion: FollowedMotion, apart: Indices, may_touch: Indices
) -> tuple[tuple[Indices, int], tuple[Indices, int]]:
    """Return what must not touch, each with the last point until which that holds."""
    until = before_contact(problem, motion.time, motion.q) if len(may_touch) else -1
    return (apart, len(motion.time) - 1), (may_touch, until)


def _split(may: list[bool]) -> tuple[Indices, Indices]:
    flags = np.array(may, bool)
    return np.flatnonzero(~flags), np.flatnonzero(flags)
