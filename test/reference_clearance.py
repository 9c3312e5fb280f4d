"""Distances of the arm and their derivatives by numpy: what the core is held against."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pinocchio as pin
from dense_motion import centers_of, to_lines
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.distance.clearance import (
    clearance_gradients,
    clearances,
    segments,
)
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.robot.kinematics import rotation_base_to_inertial
from ff_planner_ros.robot.model import Robot


def clearance_rows(
    robot: Robot,
    q: Array,
    q_sensitivity: Array,
    times: Array,
    spheres: Sequence[Obstacle],
    interest: float,
) -> tuple[Array, Array, Indices]:
    """Return distances of segments from spheres below `interest` [m], and their derivatives.

    Args:
        q_sensitivity: As for `arm_points_with_derivatives`.

    Returns:
        Shapes (rows,), (rows, columns) and (rows,): the last says which point, segment and sphere.
    """
    positions, derivatives = arm_points_with_derivatives(robot, q, q_sensitivity)
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
    positions, axes, slides, rotation = _arm_kinematics(robot, q)
    moving, turning = (rotation @ part for part in np.split(q_sensitivity[:, :6], 2, axis=1))
    # Twist of each body at the inertial origin: the base's, plus each joint's on the way.
    angular = np.cumsum(axes[..., None] * q_sensitivity[:, 6:, None], axis=1) + turning[:, None]
    lever = np.cross(positions[:, :-1], axes) + slides
    linear = np.cumsum(lever[..., None] * q_sensitivity[:, 6:, None], axis=1)
    linear += (moving + np.cross(q[:, :3, None], turning, axis=1))[:, None]
    # The end effector rides on the last body.
    linear, angular = (np.concatenate([t, t[:, -1:]], axis=1) for t in (linear, angular))
    return positions, linear + np.cross(angular, positions[..., None], axis=2)


def _arm_kinematics(robot: Robot, q: Array) -> tuple[Array, Array, Array, Array]:
    """Return joint origins and end effector, the joints' axes and slides, the base's attitude."""
    model, tip = robot.model, robot.model.frames[robot.tip_frame_id]
    points = np.empty((len(q), robot.joints + 1, 3))
    axes, slides = np.empty((2, len(q), robot.joints, 3))
    turns = Rotation.from_rotvec((q[:, 7:, None] * robot.joint_axes).reshape(-1, 3))
    turn = turns.as_matrix().reshape(len(q), robot.joints, 3, 3)
    base = rotation_base_to_inertial(q)
    position, rotation = q[:, :3], base
    for k, placement in enumerate(model.jointPlacements[2:]):
        position = position + rotation @ placement.translation
        rotation = rotation @ placement.rotation
        axes[:, k] = rotation @ robot.joint_axes[k]
        slides[:, k] = rotation @ robot.joint_slides[k]
        position = position + q[:, 7 + k, None] * slides[:, k]
        points[:, k] = position
        rotation = rotation @ turn[:, k]
    points[:, -1] = position + rotation @ tip.placement.translation
    return points, axes, slides, base


def dense_clearance(
    robot: Robot, q: Array, v: Array, times: Array, spheres: Sequence[Obstacle], parts: int = 100
) -> float:
    """Return the least clearance of the centre lines at many times of a motion [m].

    Between two points the motion is the cubic through both configurations and velocities.
    """
    cubics = _cubics(robot, q, v, np.diff(times))
    part = np.linspace(0.0, 1.0, parts + 1)
    moved = np.einsum("sp,cpj->csj", part[:, None] ** np.array([1, 2, 3]), cubics)
    between = [
        pin.integrate(robot.model, begin, step)
        for begin, steps in zip(q, moved, strict=False)
        for step in steps
    ]
    when = (times[:-1, None] + part * np.diff(times)[:, None]).ravel()
    return float(_distances(robot, np.array(between), when, spheres).min())


def way_and_bend(points: Array, base: Array, cubic: Array) -> tuple[float, float]:
    """Return `way_bounds` and `bend_bounds` of one cubic, one joint and one link after the other.

    Args:
        points: Joint origins and end effector. Shape (joints + 1, 3) [m].
        base: Origin of the base. Shape (3,) [m].
        cubic: Coefficients of s, s^2 and s^3. Shape (3, 6 + joints).
    """
    first, second, third = np.abs(cubic)
    rate, change = first + 2 * second + 3 * third, 2 * second + 6 * third
    moving, turning = (float(np.linalg.norm(rate[rows])) for rows in (slice(3), slice(3, 6)))
    faster, tumbling = (float(np.linalg.norm(change[rows])) for rows in (slice(3), slice(3, 6)))
    way = float(np.linalg.norm((first + second + third)[:3]))
    links = [float(np.linalg.norm(b - a)) for a, b in pairwise(points)]
    from_base = float(np.linalg.norm(points[0] - base))
    speed = moving + turning * (way / 2 + from_base + sum(links))
    bend = faster + turning * moving + tumbling * way / 2 + turning**2 * way / 2
    bend += from_base * (tumbling + 1.5 * turning**2)
    for k, length in enumerate(links):
        speed += float(rate[6 + k]) * sum(links[k:])
        turned = turning + float(rate[6 : 7 + k].sum())
        bend += length * (tumbling + float(change[6 : 7 + k].sum()) + 1.5 * turned**2)
    return speed, bend


def _cubics(robot: Robot, q: Array, v: Array, steps: Array) -> Array:
    """Return `cubics_between`, by Pinocchio's derivative of a difference."""
    model, found = robot.model, []
    for k, step in enumerate(steps):
        whole = pin.difference(model, q[k], q[k + 1])
        by_end = pin.dDifference(model, q[k], q[k + 1], pin.ArgumentPosition.ARG1)
        first, last = step * v[k], step * by_end @ v[k + 1]
        found.append([first, 3 * whole - 2 * first - last, first + last - 2 * whole])
    return np.array(found)


def _distances(robot: Robot, q: Array, times: Array, spheres: Sequence[Obstacle]) -> Array:
    """Return the distances of the arm from spheres at some times. Shape (points, spheres) [m]."""
    points, *_ = _arm_kinematics(robot, q)
    columns = [to_lines(points, centers_of(one, times)) - one.radius for one in spheres]
    return np.array(columns).T
