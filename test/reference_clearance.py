"""Distances of the arm and their derivatives by numpy: what the core is held against."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.arrays import Array, Indices
from ff_planner_ros.planning.clearance import (
    clearance_gradients,
    clearances,
    segments,
)
from ff_planner_ros.planning.problem import Sphere
from ff_planner_ros.robot.kinematics import rotation_base_to_inertial
from ff_planner_ros.robot.model import Robot


def clearance_rows(
    robot: Robot,
    q: Array,
    q_sensitivity: Array,
    times: Array,
    spheres: Sequence[Sphere],
    interest: float,
    quarter_way: bool,
) -> tuple[Array, Array, Indices]:
    """Return what the function of this name in `planning.clearance` does."""
    positions, derivatives = arm_points_with_derivatives(robot, q, q_sensitivity)
    if quarter_way:
        positions, derivatives = (
            np.concatenate([at, _quarter_way(at)]) for at in (positions, derivatives)
        )
    starts = segments(positions)
    clear = clearances(positions, times, starts, spheres)
    rows = np.nonzero(clear.distance < interest)
    jacobian = clearance_gradients(clear, derivatives, starts, rows)
    return clear.distance[rows], jacobian, np.ravel_multi_index(rows, clear.distance.shape)


def arm_points_with_derivatives(
    robot: Robot, q: Array, q_sensitivity: Array
) -> tuple[Array, Array]:
    """Return `arm_points` and their derivatives, shape (points, joints + 1, 3, columns).

    Args:
        q_sensitivity: Derivatives of q in its tangent space. Shape (points, 6 + joints, columns).
    """
    positions, axes, rotation = _arm_kinematics(robot, q)
    moving, turning = (rotation @ part for part in np.split(q_sensitivity[:, :6], 2, axis=1))
    # Twist of each body at the inertial origin: the base's, plus each joint's on the way.
    angular = np.cumsum(axes[..., None] * q_sensitivity[:, 6:, None], axis=1) + turning[:, None]
    lever = np.cross(positions[:, :-1], axes)
    linear = np.cumsum(lever[..., None] * q_sensitivity[:, 6:, None], axis=1)
    linear += (moving + np.cross(q[:, :3, None], turning, axis=1))[:, None]
    # The end effector rides on the last body.
    linear, angular = (np.concatenate([t, t[:, -1:]], axis=1) for t in (linear, angular))
    return positions, linear + np.cross(angular, positions[..., None], axis=2)


def _arm_kinematics(robot: Robot, q: Array) -> tuple[Array, Array, Array]:
    """Return joint origins and end effector, the joints' axes and the base's attitude."""
    model, tip = robot.model, robot.model.frames[robot.tip_frame_id]
    points = np.empty((len(q), robot.joints + 1, 3))
    axes = np.empty((len(q), robot.joints, 3))
    turns = Rotation.from_rotvec((q[:, 7:, None] * robot.joint_axes).reshape(-1, 3))
    turn = turns.as_matrix().reshape(len(q), robot.joints, 3, 3)
    base = rotation_base_to_inertial(q)
    position, rotation = q[:, :3], base
    for k, placement in enumerate(model.jointPlacements[2:]):
        position = position + rotation @ placement.translation
        points[:, k] = position
        rotation = rotation @ placement.rotation
        axes[:, k] = rotation @ robot.joint_axes[k]
        rotation = rotation @ turn[:, k]
    points[:, -1] = position + rotation @ tip.placement.translation
    return points, axes, base


def _quarter_way(values: Array) -> Array:
    """Return values a quarter of the way between points and three quarters, by parabolas.

    But for the first interval, whose beginning is the start.

    Args:
        values: At all points but the first, then half-way in every interval.
    """
    at_points, half_way = np.split(values, 2)
    begin, middle, end = at_points[:-1], half_way[1:], at_points[1:]
    first = (3.0 * begin + 6.0 * middle - end) / 8.0
    return np.concatenate([first, (3.0 * end + 6.0 * middle - begin) / 8.0])
