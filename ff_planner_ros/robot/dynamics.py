"""Inverse dynamics of the free-floating system, Eq. (20): the torques of a motion.

Throughout, `data` is scratch space of the robot's model, q a configuration, shape (7 + joints,), v
a tangent velocity and `acceleration` dv/dt, each of shape (6 + joints,).
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import momentum_maps


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


def joint_torques_by_x(
    robot: Robot,
    q: Array,
    v: Array,
    joint_accelerations: Array,
    q_by_x: Array,
    v_by_x: Array,
    joint_accelerations_by_x: Array,
) -> Array:
    """Return the exact derivatives of `joint_torques` by variables x of a motion.

    dQ = dQ/dq dq + dQ/dv dv + M d(dv/dt), where the base's part of d(dv/dt) follows from a zero
    wrench on the base: the first six rows of dQ are zero.

    Args:
        q_by_x: In the tangent space. Shape (points, 6 + joints, variables).
        v_by_x: Shape (points, 6 + joints, variables).
        joint_accelerations_by_x: Shape (points, joints, variables).

    Returns:
        Shape (points, joints, variables).
    """
    moved = accelerations(robot, q, v, joint_accelerations)
    of_x = q_by_x, v_by_x, joint_accelerations_by_x
    forces, mass, of_base = _base_by_x(robot, q, v, moved, *of_x)
    joints: Array = forces[:, 6:] + mass[:, 6:, robot.base.rows] @ of_base
    return joints


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


def frame_wrenches_by_x(
    robot: Robot,
    frame: int,
    q: Array,
    v: Array,
    joint_accelerations: Array,
    q_by_x: Array,
    v_by_x: Array,
    joint_accelerations_by_x: Array,
) -> Array:
    """Return the exact derivatives of `frame_wrenches`; the arguments as of `joint_torques_by_x`.

    Shape (points, 6, variables).
    """
    model, data = robot.model, robot.model.createData()
    inertia = model.frames[frame].inertia
    matrix, joint = inertia.matrix(), model.frames[frame].parentJoint
    to_frame = model.frames[frame].placement.inverse().action
    moved = accelerations(robot, q, v, joint_accelerations)
    of_x = q_by_x, v_by_x, joint_accelerations_by_x
    moved_by_x = _accelerations_by_x(robot, q, v, moved, *of_x)
    by_x = np.empty((len(q), 6, q_by_x.shape[2]))
    for i, sample in enumerate(zip(q, v, moved, strict=True)):
        pin.computeForwardKinematicsDerivatives(model, data, *sample)
        v_by_q, a_by_q, a_by_v, a_by_a = pin.getJointAccelerationDerivatives(
            model, data, joint, pin.LOCAL
        )
        a_by_x = to_frame @ (a_by_q @ q_by_x[i] + a_by_v @ v_by_x[i] + a_by_a @ moved_by_x[i])
        twist_by_x = to_frame @ (v_by_q @ q_by_x[i] + a_by_a @ v_by_x[i])
        twist = pin.getFrameVelocity(model, data, frame, pin.LOCAL)
        momentum = inertia * twist
        by_x[i] = matrix @ a_by_x + _dual_cross(twist) @ matrix @ twist_by_x
        by_x[i] -= _crossed_by(momentum) @ twist_by_x
    return by_x


def _dual_cross(twist: pin.Motion) -> Array:
    """Return the matrix of v x*, the cross product with spatial forces. Shape (6, 6)."""
    return -np.asarray(twist.action.T, np.float64)


def _crossed_by(momentum: pin.Force) -> Array:
    """Return the matrix H with v x* h = -H v. Shape (6, 6)."""
    linear, angular = pin.skew(momentum.linear), pin.skew(momentum.angular)
    return np.block([[np.zeros((3, 3)), linear], [linear, angular]])


def _accelerations_by_x(
    robot: Robot,
    q: Array,
    v: Array,
    moved: Array,
    q_by_x: Array,
    v_by_x: Array,
    joint_accelerations_by_x: Array,
) -> Array:
    """Return the derivatives of `accelerations`, which are `moved`. (points, 6 + joints, vars)."""
    by_x = np.zeros_like(q_by_x)
    by_x[:, 6:] = joint_accelerations_by_x
    of_x = q_by_x, v_by_x, joint_accelerations_by_x
    _, _, by_x[:, robot.base.rows] = _base_by_x(robot, q, v, moved, *of_x)
    return by_x


def _base_by_x(
    robot: Robot,
    q: Array,
    v: Array,
    moved: Array,
    q_by_x: Array,
    v_by_x: Array,
    joint_accelerations_by_x: Array,
) -> tuple[Array, Array, Array]:
    """Return the derivatives of the forces with the base's acceleration constant.

    With them the mass matrices, and the derivatives of the base's acceleration at zero wrench; of
    each a matrix a sample.
    """
    model, data, rows = robot.model, robot.model.createData(), robot.base.rows
    of_q, of_v, mass = np.empty((3, len(q), model.nv, model.nv))
    for i, sample in enumerate(zip(q, v, moved, strict=True)):
        of_q[i], of_v[i], mass[i] = pin.computeRNEADerivatives(model, data, *sample)
    forces = of_q @ q_by_x + of_v @ v_by_x + mass[:, :, 6:] @ joint_accelerations_by_x
    of_base = np.linalg.solve(mass[:, rows][:, :, rows], -forces[:, rows])
    return forces, mass, of_base


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
    mass_matrix = pin.crba(robot.model, data, q)
    acceleration = np.zeros(6)
    acceleration[rows] = np.linalg.solve(mass_matrix[np.ix_(rows, rows)], -wrench[rows])
    return acceleration
