"""Problems transformed to another inertial frame: a point x becomes `frame.act(x)`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.paths.polynomial import COMPONENTS, FREE_TERMS
from ff_planner_ros.planning.problem.obstacles import Obstacle
from ff_planner_ros.planning.problem.problem import PlanningProblem, with_capture_target
from ff_planner_ros.problems.paths import STRAIGHT
from ff_planner_ros.robot.configuration import eigen_quaternion
from ff_planner_ros.robot.rotation import euler_from_rotation

_SAMPLES = np.linspace(0.0, 1.0, 50)
# Coefficients of each free term, alone and in every component.
_UNITS = [np.tile(row, (COMPONENTS, 1)) for row in np.eye(FREE_TERMS)]


def seen_from(
    problem: PlanningProblem, frame: pin.SE3, velocity: Array | None = None
) -> PlanningProblem:
    """Return a problem of the same physics in another inertial frame.

    Args:
        frame: Pose of the problem's frame in the other one, at the plan's first point.
        velocity: Of the problem's frame in the other one. Shape (3,) [m/s]. None: it rests.
    """
    start, target, rotation = problem.start, problem.target, frame.rotation
    drift = np.zeros(3) if velocity is None else velocity
    window, goal = problem.duration_range, problem.chaser_goal
    wanted = goal.quaternion_xyzw
    by = pin.Quaternion(eigen_quaternion(rotation))

    def turned(quaternion_xyzw: Array) -> Array:
        quaternion: Array = (by * pin.Quaternion(quaternion_xyzw)).coeffs()
        return quaternion

    def moved(one: Obstacle) -> Obstacle:
        return one.with_motion(
            position=frame.act(one.motion.position),
            quaternion_xyzw=turned(one.motion.quaternion_xyzw),
            velocity=rotation @ one.motion.velocity + drift,
            angular_velocity=rotation @ one.motion.angular_velocity,
        )

    seen = replace(
        problem,
        start=replace(
            start,
            position_chaser_in_inertial=frame.act(start.position_chaser_in_inertial),
            quaternion_chaser_to_inertial_xyzw=turned(start.quaternion_chaser_to_inertial_xyzw),
            linear_velocity_chaser_in_inertial=rotation @ start.linear_velocity_chaser_in_inertial
            + drift,
            angular_velocity_chaser_in_inertial=rotation
            @ start.angular_velocity_chaser_in_inertial,
        ),
        target=replace(
            target,
            position=frame.act(target.position) + problem.duration * drift,
            quaternion_xyzw=turned(target.quaternion_xyzw),
            linear_velocity=rotation @ target.linear_velocity + drift,
            angular_velocity=rotation @ target.angular_velocity,
            linear_acceleration=rotation @ target.linear_acceleration,
            angular_acceleration=rotation @ target.angular_acceleration,
        ),
        obstacles=tuple(map(moved, problem.obstacles)),
        chaser_goal=replace(goal, quaternion_xyzw=None if wanted is None else turned(wanted)),
        duration_range=None
        if window is None
        else replace(window, target_velocity=rotation @ window.target_velocity + drift),
    )
    body = problem.target_body
    if body is None:
        return seen
    body = replace(
        body,
        position=frame.act(body.position),
        quaternion_xyzw=turned(body.quaternion_xyzw),
        linear_velocity=rotation @ body.linear_velocity + drift,
        angular_velocity=rotation @ body.angular_velocity,
    )
    return with_capture_target(body, seen)


def same_path(
    problem: PlanningProblem, coefficients: Array, twin: PlanningProblem, frame: pin.SE3
) -> Array:
    """Return the coefficients with which the twin's end effector follows the same path.

    Its positions are the same. In the twin's frame the Euler angles are not polynomials; they are
    fitted by least squares.

    Args:
        coefficients: xi of the problem's path. Shape (6, 3).
        twin: The problem seen from the other frame; see `seen_from`.
        frame: Pose of the problem's frame in the twin's.
    """
    _, rotations = end_effector_paths(problem).polynomial.pose(coefficients, _SAMPLES)
    there = end_effector_paths(twin).polynomial
    inner = there.rotation_outer.T @ frame.rotation @ rotations @ there.rotation_inner.T
    straight, _, _ = there.components(STRAIGHT, _SAMPLES)
    terms = np.stack(
        [there.components(unit, _SAMPLES)[0][:, 3] - straight[:, 3] for unit in _UNITS], axis=1
    )
    beyond = np.unwrap(euler_from_rotation(inner), axis=0) - straight[:, 3:]
    beyond -= 2 * np.pi * np.round(beyond[0] / (2 * np.pi))
    angles, *_ = np.linalg.lstsq(terms, beyond)
    return np.concatenate([frame.rotation @ coefficients[:3], angles.T])


def seen_back(points: Array, frame: pin.SE3) -> Array:
    """Return points of the twin's frame, shape (..., 3) [m], in the problem's frame."""
    seen: Array = (points - frame.translation) @ frame.rotation
    return seen
