"""Inverse dynamics of the free-floating system, Eq. (20): the torques of a motion.

Throughout, `data` is scratch space of the robot's model, q a configuration, shape (7 + joints,), v
a tangent velocity and `acceleration` dv/dt, each of shape (6 + joints,).
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import mass_matrix, momentum_maps


def inverse_dynamics(
    robot: Robot, data: pin.Data, q: Array, v: Array, acceleration: Array
) -> Array:
    """Return the generalised forces Q = M dv/dt + C v of Eq. (20). Shape (6 + joints,).

    First the wrench on the base, force [N] before torque [N m], about the base frame's origin and
    in its axes: zero if only the joints move the system. Then the joint torques [N m, N].
    """
    return np.array(pin.rnea(robot.model, data, q, v, acceleration))


def joint_torques(
    robot: Robot, q: Array, v: Array, joint_accelerations: Array, maps: Array | None = None
) -> Array:
    """Return the joint torques of a motion without a wrench on the base [N m, N].

    Torques and joint accelerations [rad/s2, m/s2] have the shape (points, joints); q and v hold one
    row per point, too.

    Args:
        maps: The result of `momentum_maps`. None: they are computed.
    """
    of_base, forces, coupling = _pushed_by_nothing(robot, q, v, joint_accelerations, maps)
    torques: Array = forces[:, 6:] + (of_base[:, None] @ coupling)[:, 0]
    return torques


def torques_on_base(robot: Robot, q: Array, v: Array, joint_accelerations: Array) -> Array:
    """Return the pure torques that hold the attitude of the base, without any force on it [N m].

    In axes of the base frame. Shape (points, 3).
    """
    maps = momentum_maps(robot, robot.model.createData(), q)
    of_base, forces, _ = _pushed_by_nothing(robot, q, v, joint_accelerations, maps)
    torques: Array = forces[:, 3:6] + (maps[:, 3:, :6] @ of_base[:, :, None])[:, :, 0]
    return torques


def frame_wrenches(
    robot: Robot, frame: int, q: Array, v: Array, joint_accelerations: Array
) -> Array:
    """Return the wrench that a fixed joint transmits to its link in a free-floating motion.

    Newton-Euler of that link alone: F = I a + v x* I v. Forces first, then torques about the
    frame's origin, in its axes. Shape (points, 6) [N, N m].

    Args:
        frame: Index of the fixed joint's frame, which has the inertia of the link that it holds.
    """
    model, data = robot.model, robot.model.createData()
    inertia, wrenches = model.frames[frame].inertia, np.empty((len(q), 6))
    moved = accelerations(robot, q, v, joint_accelerations)
    for i, sample in enumerate(zip(q, v, moved, strict=True)):
        pin.forwardKinematics(model, data, *sample)
        twist = pin.getFrameVelocity(model, data, frame, pin.LOCAL)
        acceleration = pin.getFrameAcceleration(model, data, frame, pin.LOCAL)
        wrenches[i] = (inertia * acceleration + twist.cross(inertia * twist)).vector
    return wrenches


def accelerations(robot: Robot, q: Array, v: Array, joint_accelerations: Array) -> Array:
    """Return dv/dt of samples without a wrench on the base. Shape (points, 6 + joints).

    Like the joint accelerations [rad/s2, m/s2], q and v hold one row per point.
    """
    of_base, _, _ = _pushed_by_nothing(robot, q, v, joint_accelerations)
    return np.hstack([of_base, joint_accelerations])


def _pushed_by_nothing(
    robot: Robot, q: Array, v: Array, joint_accelerations: Array, maps: Array | None = None
) -> tuple[Array, Array, Array]:
    """Return the results of `base_acceleration` at all samples, and terms of Eq. (20) for torques.

    Returns:
        Accelerations of the base, shape (points, 6); generalised forces at zero acceleration of the
        base, shape (points, 6 + joints); and the mass matrix's block between base and joints, shape
        (points, 6, joints).
    """
    model, data, rows = robot.model, robot.model.createData(), robot.base.rows
    at_rest = np.zeros((len(q), model.nv))
    at_rest[:, 6:] = joint_accelerations
    samples = zip(q, v, at_rest, strict=True)
    forces = np.array([pin.rnea(model, data, *sample) for sample in samples])
    mass = momentum_maps(robot, data, q) if maps is None else maps
    of_base = np.zeros((len(q), 6))
    free = mass[:, rows][:, :, rows]
    of_base[:, rows] = np.linalg.solve(free, -forces[:, rows, None])[:, :, 0]
    return of_base, forces, mass[:, :, 6:]


def base_acceleration(
    robot: Robot, data: pin.Data, q: Array, v: Array, joint_acceleration: Array
) -> Array:
    """Return the base's acceleration by joint accelerations [rad/s2, m/s2], without a wrench on it.

    The first six entries of dv/dt: the solution of the first six rows of Eq. (20) with zero on
    their right-hand side. Only the base's `rows`: table or wheels bear the others. Shape (6,).
    """
    rows = robot.base.rows
    base_at_rest = np.concatenate([np.zeros(6), joint_acceleration])
    wrench = inverse_dynamics(robot, data, q, v, base_at_rest)[:6]
    mass = mass_matrix(robot, data, q)
    acceleration = np.zeros(6)
    acceleration[rows] = np.linalg.solve(mass[np.ix_(rows, rows)], -wrench[rows])
    return acceleration
