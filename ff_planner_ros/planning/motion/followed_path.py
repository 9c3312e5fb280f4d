"""The motion that follows from a path's points, for the search: `followed` in the compiled core."""

from __future__ import annotations

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import chain_of, start_of
from ff_planner_ros.planning.motion.followed import FollowedMotion, steps_of
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.model import Robot


def followed_path(
    problem: PlanningProblem, q: Array, v: Array, acceleration: Array
) -> FollowedMotion:
    """Return the motion that follows from the points of a path that its plan holds.

    The steps end at all points of the path and half-way between them.

    Args:
        q: Configurations at equal steps of time. Shape (points, 7 + joints).
        v: Tangent velocities. Shape (points, 6 + joints).
        acceleration: dv/dt. Shape (points, 6 + joints).
    """
    robot, every = problem.robot, points_per_sample(len(q), problem.points)
    time = np.linspace(0.0, 1.0, len(q[::every])) * problem.duration
    samples = (rows[::every] for rows in (q[:, 7:], v[:, 6:], acceleration[:, 6:]))
    return followed_joints(robot, q[0], v[0], JointMotion(time, *samples), 2 * every)


def followed_joints(
    robot: Robot, q_start: Array, v_start: Array, joints: JointMotion, multiple: int = 1
) -> FollowedMotion:
    """Return the motion that follows from samples of the joints; arguments as of `followed`."""
    pieces, time = steps_of(joints, v_start, multiple)
    half_steps = np.linspace(0.0, joints.time[-1], 2 * len(time) - 1)
    driven = joints.at(half_steps)
    start, duration = start_of(robot, q_start, v_start), float(joints.time[-1])
    motion = compiled.DrivenMotion(chain_of(robot), start, *driven, duration)
    return FollowedMotion(joints, pieces, time, motion.q, motion.v, driven[2][::2])


def points_per_sample(points: int, samples: int) -> int:
    """Return k, if a plan of `samples` points holds every k-th of the points of a path."""
    every, rest = divmod(points - 1, samples - 1)
    return every if every and not rest else 1  # a path that fell short of its grid is kept whole
