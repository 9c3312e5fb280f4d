"""Runs of a plan by systems that differ from the model, their joints on the plan: many at once.

There are no external forces: the centre of mass moves uniformly, and the angular momentum L about
it is constant, so only the base's attitude R is integrated: omega = I^-1 (R^T L - k), with I and k
the locked inertia about the centre of mass and the joints' angular momentum. Both are linear in
the inertial parameters, and are computed for all runs by one matrix product.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.uncertainty import Draws
from ff_planner_ros.planning.robust.base_spread import TrackedMotion
from ff_planner_ros.robot.dynamics import joint_torques
from ff_planner_ros.robot.model import Base
from ff_planner_ros.robot.momentum import PARAMETERS


@dataclass(frozen=True, eq=False)
class TrackedRuns:
    """Motion of the base in each run, in the inertial frame of the motion that is tracked."""

    rotations: Array  # base to inertial; shape (times, runs, 3, 3)
    positions: Array  # of the base frame's origin; shape (times, runs, 3) [m]
    twists: Array  # of the base, in its own frame; shape (times, runs, 6) [m/s, rad/s]


def tracked_runs(motion: TrackedMotion, drawn: Draws) -> TrackedRuns:
    """Integrate all runs with the motion's steps, by a method of order four."""
    made = np.einsum("tkin,rn->trki", motion.half_regressors, drawn.parameters, optimize=True)
    times, runs = made.shape[:2]
    mass = made[0, :, 0, 0]
    # A unit turn about an axis makes m e x c of linear momentum: the centre in the base frame.
    moments = np.stack([made[:, :, 5, 1], made[:, :, 3, 2], made[:, :, 4, 0]], axis=-1)
    centers = moments / mass[:, None]
    of_joints = made[:, :, 6]
    about_center = made[:, :, 3:6, 3:].swapaxes(-1, -2) - _of_point_mass(mass, centers)
    inner = of_joints[..., 3:] - np.cross(centers, of_joints[..., :3])
    planar = motion.robot.base is Base.PLANAR
    if planar:
        inverse = np.zeros_like(about_center)
        inverse[..., 2, 2] = 1.0 / about_center[..., 2, 2]
    else:
        inverse = np.linalg.inv(about_center)
    start = motion.half_q[0]
    first = Rotation.from_quat(start[3:7]).as_matrix()
    twist = motion.half_v[0, :6] + drawn.base_twist
    turning = np.einsum("rij,rj->ri", about_center[0], twist[:, 3:]) + inner[0]
    angular = turning @ first.T
    linear = twist[:, :3] + np.cross(twist[:, 3:], centers[0]) + of_joints[0, :, :3] / mass[:, None]
    drift = linear @ first.T  # of the centre of mass
    center = start[:3] + centers[0] @ first.T

    def rate(half_step: int, rotation: Array) -> Array:
        seen = np.einsum("rji,rj->ri", rotation, angular)
        omega: Array = np.einsum("rij,rj->ri", inverse[half_step], seen - inner[half_step])
        return omega

    rotation = np.broadcast_to(first, (runs, 3, 3))
    rotations, rates = np.empty((times // 2 + 1, runs, 3, 3)), np.empty((times // 2 + 1, runs, 3))
    for i in range(len(rotations)):
        begin = 2 * i
        k1 = rate(begin, rotation)
        rotations[i], rates[i] = rotation, k1
        if i == len(rotations) - 1:
            break
        step = motion.half_time[begin + 2] - motion.half_time[begin]
        k2 = rate(begin + 1, _turned(rotation, step / 2 * k1))
        k3 = rate(begin + 1, _turned(rotation, step / 2 * k2 + step**2 / 8 * np.cross(k1, k2)))
        k4 = rate(begin + 2, _turned(rotation, step * k3))
        turn = step / 6 * (k1 + 2 * k2 + 2 * k3 + k4) + step**2 / 12 * np.cross(k1, k4)
        rotation = _turned(rotation, turn)
    now = centers[::2]
    places = center + motion.time[:, None, None] * drift
    positions = places - np.einsum("trij,trj->tri", rotations, now)
    if planar:
        positions[..., 2] = start[2]
    velocities = np.einsum("trji,rj->tri", rotations, drift) - np.cross(rates, now)
    velocities -= of_joints[::2, :, :3] / mass[:, None]
    return TrackedRuns(rotations, positions, np.concatenate([velocities, rates], axis=-1))


def _turned(rotations: Array, turns: Array) -> Array:
    """Return attitudes rotated about their own axes; turns: rotation vectors, (runs, 3) [rad]."""
    return np.asarray(rotations @ Rotation.from_rotvec(turns).as_matrix(), np.float64)


def _of_point_mass(mass: Array, centers: Array) -> Array:
    """Return the inertia of the whole mass in its centre, about the base. (times, runs, 3, 3)."""
    squares = np.einsum("tri,tri->tr", centers, centers)[..., None, None] * np.eye(3)
    outer = centers[..., :, None] * centers[..., None, :]
    return np.asarray(mass[:, None, None] * (squares - outer), np.float64)


def run_torques(motion: TrackedMotion, drawn: Draws, runs: TrackedRuns) -> Array:
    """Return the torques that keep the joints on the plan. Shape (runs, points, joints) [N m]."""
    robot, at = motion.robot, motion.at_points
    found = np.empty((len(drawn.parameters), *motion.joints.positions.shape))
    for k, parameters in enumerate(drawn.parameters):
        model = robot.model.copy()
        for body, ten in enumerate(parameters.reshape(-1, PARAMETERS)):
            model.inertias[body + 1] = pin.Inertia.FromDynamicParameters(ten)
        v = np.hstack([runs.twists[at, k], motion.joints.velocities])
        # Without external forces torques do not depend on the base's pose.
        found[k] = joint_torques(
            replace(robot, model=model), motion.q[at], v, motion.joints.accelerations
        )
    return found
