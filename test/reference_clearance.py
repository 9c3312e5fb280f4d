"""Distances of the arm and their derivatives by numpy: what the core is held against."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pinocchio as pin
from dense_motion import centers_of, to_lines
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.distance.certificate import CERTIFICATE_GAP, SHORTEST_PIECE
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
    quarter_way: bool,
) -> tuple[Array, Array, Indices]:
    """Return distances of segments from spheres below `interest` [m], and their derivatives.

    Args:
        q: At all points but the first, then half-way in every interval.
        q_sensitivity: As for `arm_points_with_derivatives`.
        times: Of all configurations that are evaluated.
        quarter_way: Also evaluate at a quarter and three quarters of all intervals but the first,
            by the parabola through both ends and the middle.

    Returns:
        Shapes (rows,), (rows, columns) and (rows,): the last says which point, joint that a segment
        starts at, and sphere.
    """
    positions, derivatives = arm_points_with_derivatives(robot, q, q_sensitivity)
    if quarter_way:
        positions, derivatives = (
            np.concatenate([at, at_quarters(at)]) for at in (positions, derivatives)
        )
    starts = segments(positions)
    clear = clearances(positions, times, starts, spheres)
    rows = np.nonzero(clear.distance < interest)
    jacobian = clearance_gradients(clear, derivatives, starts, rows)
    point, segment, sphere = rows
    shape = len(positions), robot.joints, len(spheres)
    return (
        clear.distance[rows],
        jacobian,
        np.ravel_multi_index((point, starts[segment], sphere), shape),
    )


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


def at_quarters(values: Array) -> Array:
    """Return values at a quarter and three quarters of all intervals but the first, by parabolas.

    Args:
        values: At all points but the first, then half-way in every interval.
    """
    at_points, half_way = np.split(values, 2)
    begin, middle, end = at_points[:-1], half_way[1:], at_points[1:]
    first = (3.0 * begin + 6.0 * middle - end) / 8.0
    return np.concatenate([first, (3.0 * end + 6.0 * middle - begin) / 8.0])


def search_certificate(
    robot: Robot,
    q: Array,
    v: Array,
    times: Array,
    spheres: Sequence[Obstacle],
    gap: float = CERTIFICATE_GAP,
    part: float = 0.0,
) -> float:
    """Return a lower bound of the clearance of the centre lines along the whole motion [m].

    Between two points the motion is the cubic through both configurations and velocities. On an
    interval of it arm and sphere move at most by their speed bounds, so the distance is at least
    the mean of both ends' less half of both displacements. Intervals whose bound is too low to
    decide are halved. The bound is within the gap [m] or this part of the truth.
    """
    if not spheres:
        return np.inf
    steps = np.diff(times)
    by_sphere = _distances(robot, q, times, spheres)
    cubics = _cubics(robot, q, v, steps)
    points, *_ = _arm_kinematics(robot, q[:1])
    of_arm = np.array([way_and_bend(points[0], q[0, :3], cubic)[0] for cubic in cubics])
    speeds = np.array([sphere.highest_speed for sphere in spheres])
    # Of arm and sphere together, from each point to the next. Shape (points - 1, spheres).
    ways = of_arm[:, None] + steps[:, None] * speeds
    index, begin, end = np.arange(len(cubics)), np.zeros(len(cubics)), np.ones(len(cubics))
    lowest = certified = float(by_sphere.min())
    # What no step can bring nearer than the nearest point need not be looked at again.
    reachable = by_sphere.min(axis=0) <= lowest + ways.max(axis=0)
    spheres = [sphere for sphere, keep in zip(spheres, reachable, strict=True) if keep]
    # Each of shape (pieces, spheres): a fast one that is far away is not looked at closely.
    ways, at_begin, at_end = ways[:, reachable], by_sphere[:-1, reachable], by_sphere[1:, reachable]
    while True:
        length = end - begin
        bound = ((at_begin + at_end - ways[index] * length[:, None]) / 2).min(axis=1)
        open_ = (bound < lowest - max(gap, part * lowest)) & (length > SHORTEST_PIECE)
        certified = min(certified, float(bound[~open_].min(initial=np.inf)))
        if not open_.any():
            return certified
        index, begin, end = index[open_], begin[open_], end[open_]
        middle = (begin + end) / 2
        powers = middle[:, None] ** np.array([1, 2, 3])
        moved = np.einsum("ip,ipj->ij", powers, cubics[index])
        between = np.array(
            [pin.integrate(robot.model, *at) for at in zip(q[index], moved, strict=True)]
        )
        then = times[index] + middle * steps[index]
        at_middle = _distances(robot, between, then, spheres)
        lowest = min(lowest, float(at_middle.min()))
        index = np.concatenate([index, index])
        begin, end = np.concatenate([begin, middle]), np.concatenate([middle, end])
        at_begin = np.concatenate([at_begin[open_], at_middle])
        at_end = np.concatenate([at_middle, at_end[open_]])


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
