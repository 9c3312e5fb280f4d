"""The objectives by numpy: what the compiled core is compared with."""

from __future__ import annotations

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.motion import joint_path_length
from ff_planner_ros.robot.kinematics import rotation_base_to_inertial
from ff_planner_ros.robot.rotation import euler_from_rotation, euler_rate_map

# Below this joint rate the direction of motion, and with it the gradient, is not defined.
_STANDSTILL = 1e-9


def joint_path(
    v: Array, by_x: Array, step: float, slow: float, smoothing: float
) -> tuple[float, Array, Array]:
    """Return J_L of Eq. (44) with smoothing, its gradient and its Gauss-Newton Hessian.

    Args:
        v: Tangent velocities. Shape (points, 6 + joints).
        by_x: Their derivatives. Shape (points, 6 + joints, variables).
        step: Time between two points [s].
        slow: Rate of one more joint [rad/s].
        smoothing: Weight of the smoothness.
    """
    rates, by_x = v[:, 6:], by_x[:, 6:]
    points, _, variables = by_x.shape
    if slow > 0.0:
        rates = np.hstack([rates, np.full((points, 1), slow)])
        by_x = np.concatenate([by_x, np.zeros((points, 1, variables))], axis=1)
    gradient, hessian = joint_path_length_derivatives(rates, by_x, step)
    smooth, of_smooth, curvature = smoothness(rates, by_x, step)
    return (
        joint_path_length(rates, step) + smoothing * smooth,
        gradient + smoothing * of_smooth,
        hessian + smoothing * curvature,
    )


def joint_path_length_derivatives(
    joint_velocities: Array, sensitivity: Array, step: float
) -> tuple[Array, Array]:
    """Return gradient and Gauss-Newton Hessian of J_L; the latter is positive semidefinite.

    Args:
        sensitivity: Of the joint velocities. Shape (points, joints, variables).
    """
    speed = np.maximum(np.linalg.norm(joint_velocities[:-1], axis=1), _STANDSTILL)
    direction = joint_velocities[:-1] / speed[:, None]
    along = np.einsum("pj,pjc->pc", direction, sensitivity[:-1])
    across = sensitivity[:-1] - direction[:, :, None] * along[:, None]
    scaled = across / np.sqrt(speed)[:, None, None]
    return along.sum(axis=0) * step, np.einsum("pjc,pjd->cd", scaled, scaled) * step


def smoothness(
    joint_velocities: Array, sensitivity: Array, step: float
) -> tuple[float, Array, Array]:
    """Return T times the integral of the squared joint rates, its gradient and Hessian [rad2].

    By the trapezoidal rule. It is the squared joint path where the joints are run evenly along a
    straight way, and more otherwise.

    Args:
        sensitivity: Of the joint velocities. Shape (points, joints, variables).
    """
    intervals = len(joint_velocities) - 1
    weights = np.full(intervals + 1, step)
    weights[[0, -1]] /= 2.0
    weights *= intervals * step
    of_rates = np.tensordot(weights[:, None] * joint_velocities, sensitivity, 2)
    rows = (np.sqrt(weights)[:, None, None] * sensitivity).reshape(-1, sensitivity.shape[2])
    value = float(weights @ (joint_velocities**2).sum(axis=1))
    return value, 2.0 * of_rates, 2.0 * rows.T @ rows


def chaser_euler(q: Array, by_x: Array, rotation_chaser_to_base: Array) -> tuple[Array, Array]:
    """Return Euler angles, shape (points, 3), and their derivatives, (points, 3, variables)."""
    rotation = rotation_base_to_inertial(q)
    euler = euler_from_rotation(rotation @ rotation_chaser_to_base)
    turn = rotation @ by_x[:, 3:6]
    return euler, np.asarray(np.linalg.solve(euler_rate_map(euler), turn), np.float64)
