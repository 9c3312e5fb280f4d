"""What the paper's objectives, Eqs. (44) and (45), measure of a motion."""

from __future__ import annotations

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.robot.kinematics import rotation_base_to_inertial
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.rotation import euler_from_rotation


def joint_path_length(joint_velocities: Array, step: float, weights: Array | float = 1.0) -> float:
    """Return J_L of Eq. (44) by the rectangle rule, all points but the last [rad].

    Args:
        weights: Share of each joint. Shape (joints,).
    """
    shares = weights * joint_velocities[:-1]
    return float(np.linalg.norm(shares, axis=1).sum() * step)


def straight_way(ends: Array, weights: Array | float = 1.0) -> float:
    """Return the joint path of the straight way between two postures, shape (2, joints) [rad]."""
    return float(np.linalg.norm(weights * (ends[1] - ends[0])))


def chaser_euler(robot: Robot, q: Array) -> Array:
    """Return the chaser's Euler angles phi, theta, psi. Shape (points, 3) [rad]."""
    return euler_from_rotation(rotation_base_to_inertial(q) @ robot.rotation_chaser_to_base)


def chaser_euler_with_derivative(
    robot: Robot, q: Array, q_sensitivity: Array
) -> tuple[Array, Array]:
    """Return `chaser_euler` and its derivative, shape (points, 3, variables)."""
    return compiled.chaser_euler(q, q_sensitivity, robot.rotation_chaser_to_base)
