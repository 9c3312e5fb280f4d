"""The quantities of the paper's objectives, Eqs. (44) and (45): joint path and Euler angles."""

from __future__ import annotations

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.kinematics import rotation_base_to_inertial
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.rotation import euler_from_rotation


def joint_path_length(joint_velocities: Array, step: float, weights: Array | float = 1.0) -> float:
    """Return J_L of Eq. (44) by the rectangle rule, all points but the last [rad].

    Args:
        joint_velocities: Shape (points, joints) [rad/s, m/s].
        step: Time between two points [s].
        weights: Weight of each joint. Shape (joints,).
    """
    shares = weights * joint_velocities[:-1]
    return float(np.linalg.norm(shares, axis=1).sum() * step)


def straight_way(ends: Array, weights: Array | float = 1.0) -> float:
    """Return the length of the straight joint path between two postures [rad].

    Args:
        ends: Both postures. Shape (2, joints) [rad, m].
        weights: Weight of each joint. Shape (joints,).
    """
    return float(np.linalg.norm(weights * (ends[1] - ends[0])))


def chaser_euler(robot: Robot, q: Array) -> Array:
    """Return the Euler angles phi, theta, psi of the chaser's axes to inertial axes.

    Shape (points, 3) [rad]; the rotation is Rz(psi) Ry(theta) Rx(phi).
    """
    return euler_from_rotation(rotation_base_to_inertial(q) @ robot.rotation_chaser_to_base)
