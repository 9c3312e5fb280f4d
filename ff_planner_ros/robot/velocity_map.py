"""The momentum-constrained velocity map of Eqs. (27)-(32) and its exact derivatives.

Given configuration, total momentum and wanted end-effector twist, the joint rates of Eq. (31)
and the chaser twist of Eq. (27) are together the solution of

    minimise 1/2 |theta_dot|^2   subject to   A v = b,   A = [H; J],   b = [h; w]

with H the momentum map (first six rows of the mass matrix), J the end-effector Jacobian, h the
momentum and w the wanted twist, the last two in the local frames of base and end effector.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ff_planner_ros.arrays import Array
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.rotation import skew


class VelocitySolution(NamedTuple):
    """One evaluation of the map, with what its derivatives need.

    Attributes:
        v: Base twist in the base frame, joint rates. Shape (6 + joints,).
        q: Configuration. Shape (7 + joints,).
        constraint: A. Shape (12, 6 + joints).
        multiplier: lambda of A. Shape (12,).
        momentum_in_base: h. Shape (6,).
        twist_in_ee: w. Shape (6,).
        rotation_ee_to_inertial: Shape (3, 3).
    """

    v: Array
    q: Array
    constraint: Array
    multiplier: Array
    momentum_in_base: Array
    twist_in_ee: Array
    rotation_ee_to_inertial: Array


class VelocityMap:
    """Velocities of a free-floating robot at given momentum and end-effector twist.

    Owns Pinocchio's scratch space: one object serves one thread.
    """

    def __init__(self, robot: Robot) -> None:
        """Make the scratch space of a robot."""
        self._robot = robot
        self._data = robot.model.createData()
        self._tip_joint = robot.model.frames[robot.tip_frame_id].parentJoint
        self._tip_placement = robot.model.frames[robot.tip_frame_id].placement
        self._forces = [pin.Force.Zero() for _ in range(robot.model.njoints)]
        self._no_motion = np.zeros(6 + robot.joints)

    def solve(self, q: Array, momentum: Array, twist_ee_in_inertial: Array) -> VelocitySolution:
        """Return the velocity with least joint rates, Eqs. (27) and (31).

        Args:
            q: Configuration. Shape (7 + joints,).
            momentum: Total P and L about the inertial origin, inertial axes. Shape (6,).
            twist_ee_in_inertial: Wanted linear and angular velocity. Shape (6,).

        Raises:
            numpy.linalg.LinAlgError: The generalised Jacobian is exactly singular.
        """
        model, data = self._robot.model, self._data
        mass_matrix = pin.crba(model, data, q)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacement(model, data, self._robot.tip_frame_id)
        jacobian = pin.getFrameJacobian(model, data, self._robot.tip_frame_id, pin.LOCAL)
        rotation_base, position_base = data.oMi[1].rotation, data.oMi[1].translation
        rotation_ee = data.oMf[self._robot.tip_frame_id].rotation.copy()

        linear, angular = momentum[:3], momentum[3:]
        h = np.concatenate(
            [linear @ rotation_base, (angular - pin.skew(position_base) @ linear) @ rotation_base]
        )
        w = (twist_ee_in_inertial.reshape(2, 3) @ rotation_ee).ravel()

        momentum_map = mass_matrix[:6]
        base_jacobian, joint_jacobian = jacobian[:, :6], jacobian[:, 6:]
        solved = np.linalg.solve(
            momentum_map[:, :6], np.column_stack([momentum_map[:, 6:], h, base_jacobian.T])
        )
        coupling, base_drift, lever = solved[:, :-7], solved[:, -7], solved[:, -6:]
        generalised = joint_jacobian - base_jacobian @ coupling  # J_D, Eq. (32)
        mu = np.linalg.solve(generalised @ generalised.T, w - base_jacobian @ base_drift)
        joint_rates = mu @ generalised  # Eq. (31)
        return VelocitySolution(
            v=np.concatenate([base_drift - coupling @ joint_rates, joint_rates]),  # Eq. (27)
            q=q,
            constraint=np.concatenate([momentum_map, jacobian]),
            multiplier=np.concatenate([lever @ mu, -mu]),
            momentum_in_base=h,
            twist_in_ee=w,
            rotation_ee_to_inertial=rotation_ee,
        )

    def derivatives(self, solutions: Sequence[VelocitySolution]) -> tuple[Array, Array]:
        """Return the exact derivatives of solutions, the algebra batched over all of them.

        The multipliers lambda turn the minimisation into its linear KKT system
        [S A^T; A 0] [v; lambda] = [0; b], with S selecting the joints. Differentiating it needs
        d(A^T lambda)/dq, d(A v)/dq and db/dq: derivatives of inverse dynamics and of forward
        kinematics, which Pinocchio has in closed form.

        Args:
            solutions: Of `solve`, for this robot.

        Returns:
            dv/dq in the tangent space, shape (solutions, 6 + joints, 6 + joints), and
            dv/dtwist, twist in inertial axes, shape (solutions, 6 + joints, 6).
        """
        stacked = VelocitySolution(*(np.array(column) for column in zip(*solutions, strict=True)))
        count, size = stacked.v.shape
        jacobian = stacked.constraint[:, 6:]
        kkt = np.zeros((count, size + 12, size + 12))
        kkt[:, range(6, size), range(6, size)] = 1.0
        kkt[:, size:, :size] = stacked.constraint
        kkt[:, :size, size:] = stacked.constraint.transpose(0, 2, 1)

        right = np.zeros((count, size + 12, size + 6))
        for solution, rows in zip(solutions, right, strict=True):
            self._differentiate_model(solution, rows)
        rows_h, rows_w = slice(size, size + 6), slice(size + 6, size + 12)
        right[:, rows_h, :6] += _momentum_derivative(stacked.momentum_in_base)
        right[:, rows_w, :size] += _twist_derivative(stacked.twist_in_ee, jacobian)
        inertial_to_ee = stacked.rotation_ee_to_inertial.transpose(0, 2, 1)
        right[:, size + 6 : size + 9, size : size + 3] = inertial_to_ee
        right[:, size + 9 :, size + 3 :] = inertial_to_ee

        solved = np.linalg.solve(kkt, right)[:, :size]
        return solved[:, :, :size], solved[:, :, size:]

    def _differentiate_model(self, solution: VelocitySolution, right: Array) -> None:
        """Write -d(A^T lambda)/dq and -d(A v)/dq into the right-hand side of one solution."""
        model, data = self._robot.model, self._data
        q, v = solution.q, solution.v
        size = len(v)

        # A^T lambda is the inverse dynamics of a system at rest whose base accelerates by the
        # momentum's multiplier while the twist's multiplier pulls at the end effector.
        base_acceleration = np.zeros(size)
        base_acceleration[:6] = solution.multiplier[:6]
        pull = self._tip_placement.act(pin.Force(solution.multiplier[6:]))
        self._forces[self._tip_joint] = -pull
        pin.computeRNEADerivatives(model, data, q, self._no_motion, base_acceleration, self._forces)
        right[:size, :size] = -data.dtau_dq
        # M v is the inverse dynamics of a system at rest that accelerates by v.
        pin.computeRNEADerivatives(model, data, q, self._no_motion, v)
        right[size : size + 6, :size] = -data.dtau_dq[:6]
        pin.computeForwardKinematicsDerivatives(model, data, q, v, self._no_motion)
        right[size + 6 :, :size] = -pin.getFrameVelocityDerivatives(
            model, data, self._robot.tip_frame_id, pin.LOCAL
        )[0]


def _momentum_derivative(momentum_in_base: Array) -> Array:
    """Return dh/dq for a step of the base in its own frame. Shape (solutions, 6, 6)."""
    linear = skew(momentum_in_base[:, :3])
    derivative = np.zeros((len(momentum_in_base), 6, 6))
    derivative[:, :3, 3:] = linear
    derivative[:, 3:, :3] = linear
    derivative[:, 3:, 3:] = skew(momentum_in_base[:, 3:])
    return derivative


def _twist_derivative(twist_in_ee: Array, jacobian: Array) -> Array:
    """Return dw/dq: the end effector turns under the wanted twist. Shape (solutions, 6, v)."""
    turning = jacobian[:, 3:]
    return np.concatenate(
        [skew(twist_in_ee[:, :3]) @ turning, skew(twist_in_ee[:, 3:]) @ turning], axis=1
    )
