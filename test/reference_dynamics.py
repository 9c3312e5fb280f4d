"""Derivatives of inverse dynamics by Pinocchio, as the search needs them by x."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.dynamics import accelerations
from ff_planner_ros.robot.model import Robot


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
