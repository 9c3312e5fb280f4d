"""Motions of end-effector polynomial paths, and checks along them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.planning.distance.body_certificate import least_obstacle_distance
from ff_planner_ros.planning.distance.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.distance.surroundings import surroundings
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.paths.path_family import Motion, singular_refusal
from ff_planner_ros.planning.paths.polynomial import COMPONENTS, FREE_TERMS
from ff_planner_ros.planning.problem.problem import Obstacle, PlanningProblem
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.momentum import smallest_singular_values

# Coefficients of the straight path, xi = 0.
STRAIGHT = np.zeros((COMPONENTS, FREE_TERMS))


def roll_out(problem: PlanningProblem, coefficients: Array, points: int | None = None) -> Motion:
    """Return the motion of the end-effector polynomial path of a problem.

    Args:
        coefficients: xi, shape (6, 3) or (18,).
        points: Number of points on the path; None: the problem's.

    Raises:
        NoPlanFound: The path meets a dynamic singularity.
    """
    motion = end_effector_paths(problem).motion(coefficients.ravel(), points or problem.points)
    if motion.singular_at is not None:
        raise singular_refusal(motion.singular_at, problem.duration)
    return motion


def within_limits(
    problem: PlanningProblem,
    coefficients: Array,
    singular_value_bound: float,
    points: int | None = None,
) -> bool:
    """Tell whether a path keeps the limits of joint positions and velocities, and regularity.

    Args:
        coefficients: xi, shape (6, 3) or (18,).
        singular_value_bound: Lower bound of the smallest singular value of J_D along the path.
        points: Number of points on the path; None: the problem's.
    """
    robot = problem.robot
    try:
        rollout = roll_out(problem, coefficients, points)
    except NoPlanFound:
        return False
    joints = rollout.q[:, 7:]
    return bool(
        (joints >= robot.lower_position_limits).all()
        and (joints <= robot.upper_position_limits).all()
        and (np.abs(rollout.v[:, 6:]) <= robot.velocity_limits).all()
        and smallest_singular_values(robot, rollout.q).min() >= singular_value_bound
    )


def clearance_along(problem: PlanningProblem, coefficients: Array) -> float:
    """Return a lower bound of a path's distance to obstacles, also between the points [m].

    Raises:
        NoPlanFound: The path meets a dynamic singularity.
    """
    rollout = roll_out(problem, coefficients)
    times = np.linspace(0.0, problem.duration, problem.points)
    at_rest = np.zeros((len(times), problem.robot.joints))
    joints = JointMotion(times, rollout.q[:, 7:], rollout.v[:, 6:], at_rest)
    motion = FollowedMotion(joints, 1, times, rollout.q, rollout.v, at_rest)
    robot, around = with_bodies(problem.robot), surroundings(problem.obstacles)
    every = np.arange(len(robot.bodies) * len(problem.obstacles))
    return least_obstacle_distance(robot, motion, around, every, len(times) - 1).certified


def sweep_of(problem: PlanningProblem, coefficients: Array) -> Array:
    """Return the arm's joints and end effector at a path's points and half-way between them.

    Inertial positions, shape (times, joints + 1, 3) [m].

    Raises:
        NoPlanFound: The path meets a dynamic singularity.
    """
    rollout = roll_out(problem, coefficients)
    return arm_points(problem.robot, np.concatenate([rollout.q, rollout.q_half_way]))


def clearance_of(sweep: Array, spheres: Sequence[Obstacle]) -> Array:
    """Return each resting sphere's distance to the arm of `sweep_of`. Shape (spheres,) [m]."""
    times = np.zeros(len(sweep))
    lowest: Array = clearances(sweep, times, segments(sweep), spheres).distance.min(axis=(0, 1))
    return lowest
