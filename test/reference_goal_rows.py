"""Rows of the chaser's attitude, of singular values and of the way to the goal, by Python."""

from __future__ import annotations

import numpy as np
from reference_load_rows import within
from reference_objectives import chaser_euler

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.clearance import arm_points_with_derivatives
from ff_planner_ros.planning.distance.grasp_seen import GraspSeen
from ff_planner_ros.planning.paths.path_family import Motion, Sensitivity
from ff_planner_ros.planning.problem.camera import Camera
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.requirements.camera_view import _mount
from ff_planner_ros.planning.requirements.requirement import (
    OF_INTEREST,
    Rows,
)
from ff_planner_ros.robot.kinematics import joint_frames
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import smallest_singular_values
from ff_planner_ros.robot.quaternion import (
    angle_of_quaternion,
    quaternion_inverse,
    quaternion_product,
    rotation_vector_from_quaternion,
)

# Singular values have rows below this multiple of their margin.
_SINGULAR_OF_INTEREST = 4.0
# Their derivatives by differences so wide [rad] are exact to nine digits.
_UP = 1e-5
_KNEE = 0.5


def chaser_attitude(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows | None:
    """Return the distances of interest to the limit, at points and half-way between [rad]."""
    q = np.concatenate([motion.q[1:], motion.q_half_way])
    of_q = np.concatenate([sensitivity.q[1:], sensitivity.q_half_way])
    limits = np.full(3, problem.limits.chaser_attitude - margin)
    euler, jacobian = chaser_euler(q, of_q, problem.robot.rotation_chaser_to_base)
    return within(euler, jacobian, -limits, limits, OF_INTEREST)


def chaser_rotation(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows | None:
    """Return the distances of interest to the limit, at points and half-way between [rad]."""
    q = np.concatenate([motion.q[1:], motion.q_half_way])
    of_q = np.concatenate([sensitivity.q[1:], sensitivity.q_half_way])
    kept = problem.limits.chaser_rotation - margin
    measure, gradient = huber(motion.q[0], q, _KNEE * kept)
    (near,) = np.nonzero(kept - measure < OF_INTEREST)
    jacobian = np.einsum("pi,pix->px", gradient[near], of_q[near, 3:6])
    return Rows(kept - measure[near], -jacobian, near)


def huber(q_start: Array, q: Array, knee: float) -> tuple[Array, Array]:
    """Return Huber's function of the rotation since the start, and its gradient.

    Args:
        q_start: Configuration at the start. Shape (7 + joints,).
        q: Configurations. Shape (points, 7 + joints).
        knee: Angle from which on it is the angle itself, less than pi [rad].

    Returns:
        Values, shape (points,) [rad], and gradients by the base's rotation in its own axes, shape
        (points, 3).
    """
    since = quaternion_product(quaternion_inverse(q_start[3:7]), q[:, 3:7])
    vectors = rotation_vector_from_quaternion(since)  # n angle
    angles = angle_of_quaternion(since)
    values = np.where(angles < knee, angles**2 / (2.0 * knee) + knee / 2.0, angles)
    return values, vectors / np.maximum(angles, knee)[:, None]


def singular_values(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows | None:
    """Return the singular values at the points that are near the margin, less the margin.

    A margin of zero has no rows: they cost time, and shortest paths seldom come near a
    singularity.
    """
    if margin == 0.0:
        return None
    robot = problem.robot
    values = smallest_singular_values(robot, motion.q)
    by_joints = np.empty(motion.v[:, 6:].shape)
    for k, unit in enumerate(np.eye(motion.q.shape[1])[7:]):
        ahead, behind = (smallest_singular_values(robot, motion.q + s * unit) for s in (_UP, -_UP))
        by_joints[:, k] = (ahead - behind) / (2.0 * _UP)
    margin = min(margin, values[0])
    (near,) = np.nonzero(values[1:] < _SINGULAR_OF_INTEREST * margin)
    near += 1
    jacobian = np.einsum("pj,pjx->px", by_joints[near], sensitivity.q[near, 6:])
    return Rows(values[near] - margin, jacobian, near)


def approach(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows | None:
    """Return the margins in the corridor, less `margin`, at points and half-way between [m]."""
    approach = problem.approach
    if approach is None:
        return None
    times = np.linspace(0.0, problem.duration, len(motion.q))
    grasp = GraspSeen(problem, np.concatenate([times[1:], (times[:-1] + times[1:]) / 2]))
    points, derivatives = arm_points_with_derivatives(
        problem.robot,
        np.concatenate([motion.q[1:], motion.q_half_way]),
        np.concatenate([sensitivity.q[1:], sensitivity.q_half_way]),
    )
    places = grasp.sees(points[:, -1])
    margins = approach.margins(places)
    away = np.linalg.norm(places, axis=1)
    kept = margin * np.minimum(away / approach.distance, 1.0)
    by_place = margins.gradients - np.where(
        (away < approach.distance)[:, None],
        margin / approach.distance * places / np.maximum(away, np.finfo(float).tiny)[:, None],
        0.0,
    )
    values = margins.values - kept
    (near,) = np.nonzero(values < OF_INTEREST)
    by_point = in_inertial(grasp, by_place)[near]
    jacobian = np.einsum("ri,rix->rx", by_point, derivatives[near, -1])
    if sensitivity.goal_motion is not None:
        seen = sees_by_duration(grasp, points[:, -1], sensitivity.goal_motion.place)
        jacobian[:, -1] += np.sum(by_place * seen, axis=1)[near]
    names = 2 * near + margins.by_cone[near].astype(np.intp)
    return Rows(values[near], jacobian, names)


def camera(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows | None:
    """Return the margins in view at points and half-way, of the angle [rad] or `until` [m]."""
    camera, robot = problem.camera, problem.robot
    if camera is None:
        return None
    times = np.linspace(0.0, problem.duration, len(motion.q))
    grasp = GraspSeen(problem, np.concatenate([times[1:], (times[:-1] + times[1:]) / 2]))
    q = np.concatenate([motion.q[1:], motion.q_half_way])
    by_x = np.concatenate([sensitivity.q[1:], sensitivity.q_half_way])
    rotations, points = joint_frames(robot, q)
    # The frame that the link moves with: 0 is the base, the arm's joints come after it.
    joint, mount = _mount(robot, camera)
    origins = np.concatenate([q[:, None, :3], points[:, :-1]], axis=1)
    to_inertial = rotations[joint] @ mount.rotation
    eyes = origins[:, joint] + rotations[joint] @ mount.translation
    places = np.einsum("pji,pj->pi", to_inertial, grasp.positions - eyes)
    near = camera.nearness(places)
    by_angle = camera.in_cone(places) >= near
    values = np.where(
        by_angle,
        camera.half_angle - camera.angles(places) - margin,
        near - margin * camera.until,
    )
    away = np.maximum(np.linalg.norm(places, axis=1), np.finfo(float).tiny)
    by_place = -np.where(by_angle[:, None], angle_gradients(camera, places), places / away[:, None])
    (rows,) = np.nonzero(values < OF_INTEREST)
    gradients = np.einsum("pij,pj->pi", to_inertial, by_place)[rows]
    to_goal = (grasp.positions[:, None] - origins)[rows]
    by_tangent = _by_configuration(robot, joint, rotations[:, rows], to_goal, gradients)
    jacobian = np.einsum("rv,rvx->rx", by_tangent, by_x[rows])
    if sensitivity.goal_motion is not None:
        moved = by_duration(grasp, sensitivity.goal_motion.place)[rows, :3]
        jacobian[:, -1] += np.sum(gradients * moved, axis=1)
    return Rows(values[rows], jacobian, 2 * rows + by_angle[rows].astype(np.intp))


def _by_configuration(
    robot: Robot, joint: int, rotations: Array, to_goal: Array, gradients: Array
) -> Array:
    """Return how a measure of the goal's place, as the camera sees it, changes with q.

    Args:
        joint: Frame that the camera moves with.
        rotations: Of base and joints. Shape (joints + 1, rows, 3, 3).
        to_goal: From the origins of base and joints to the goal. Shape (rows, joints + 1, 3) [m].
        gradients: Of the measure by the goal's place, inertial axes. Shape (rows, 3).

    Returns:
        By the tangent of the configuration. Shape (rows, 6 + joints).
    """
    turned = np.cross(to_goal, gradients[:, None])
    by_tangent = np.zeros((len(gradients), 6 + robot.joints))
    by_tangent[:, :3] = -np.einsum("rji,rj->ri", rotations[0], gradients)
    by_tangent[:, 3:6] = -np.einsum("rji,rj->ri", rotations[0], turned[:, 0])
    axes = np.einsum("krij,kj->rki", rotations[1 : joint + 1], robot.joint_axes[:joint])
    by_tangent[:, 6 : 6 + joint] = -np.sum(axes * turned[:, 1 : joint + 1], axis=2)
    slides = np.einsum("krij,kj->rki", rotations[1 : joint + 1], robot.joint_slides[:joint])
    by_tangent[:, 6 : 6 + joint] -= np.einsum("rki,ri->rk", slides, gradients)
    return by_tangent


def by_duration(grasp: GraspSeen, target_by_duration: Array) -> Array:
    """Return the derivatives of the grasp frame by the duration T, at fixed t / T, as twists.

    A body's grasp moves on by its motion in t; a target moves with its pose at the goal, less
    its uniform motion from t to T.

    Args:
        target_by_duration: Derivative of the target pose by T, a twist. Shape (6,).

    Returns:
        Linear part first, inertial axes. Shape (times, 6) [m/s, rad/s].
    """
    own = grasp._own_by_duration()
    return own if grasp._of_body else target_by_duration + own


def sees_by_duration(grasp: GraspSeen, points: Array, target_by_duration: Array) -> Array:
    """Return the derivatives of `sees` by T, at fixed t / T. Shape (times, 3) [m/s]."""
    moved = by_duration(grasp, target_by_duration)
    carried = np.cross(moved[:, 3:], points - grasp._positions)
    return grasp._here(-moved[:, :3] - carried)


def in_inertial(grasp: GraspSeen, gradients: Array) -> Array:
    """Return gradients by points of the grasp frame as those by inertial points. (times, 3)."""
    turned: Array = grasp._counts * np.einsum("pij,pj->pi", grasp._rotations, gradients)
    return turned


def angle_gradients(camera: Camera, places: Array) -> Array:
    """Return the derivatives of `angles` by the places; on the axis, zero or to any side.

    Returns:
        Shape (places, 3) [rad/m].
    """
    along, aside = camera._along_and_aside(places)
    lateral = np.linalg.norm(aside, axis=1)
    nothing = np.finfo(float).tiny
    outward = aside / np.maximum(lateral, nothing)[:, None]
    square = np.maximum(along**2 + lateral**2, nothing)
    gradients: Array = (along[:, None] * outward - lateral[:, None] * camera.axis) / square[:, None]
    return gradients
