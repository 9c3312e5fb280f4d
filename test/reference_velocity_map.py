"""The momentum-constrained velocity map of Eqs. (27)-(32) and its exact derivatives.

Given configuration, total momentum and wanted end-effector twist, the joint velocities of Eq. (31)
and the chaser twist of Eq. (27) are together the solution of

    minimise 1/2 |W (theta_dot - z)|^2   subject to   A v = b,   A = [H; J],   b = [h; w]

with H the momentum map (first six rows of the mass matrix), J the end-effector Jacobian, h the
momentum and w the wanted twist, the last two in the local frames of base and end effector. The
bias z is zero in the paper, and the joints' weights W are 1: those of prismatic joints differ. The
part of the bias in the null space of J_D becomes null-space motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np
import pinocchio as pin
from scipy.linalg.lapack import dposv

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.rotation import skew

# Faster than this no arm in space moves, by an order of magnitude; the velocity map says so only
# next to a dynamic singularity [rad/s].
_SINGULAR_JOINT_RATE = 10.0


class VelocitySolution(NamedTuple):
    """A tangent velocity, and the quantities that its derivatives need.

    Several solutions, `stacked`, are the same arrays with one more axis in front.
    """

    v: Array  # base twist in the base frame, joint velocities; shape (6 + joints,)
    q: Array  # configuration; shape (7 + joints,)
    momentum_map: Array  # H; shape (6, 6 + joints)
    jacobian: Array  # J; shape (6, 6 + joints)
    mu: Array  # multiplier of the twist, its sign turned; shape (6,)
    momentum_in_base: Array  # h; shape (6,)
    twist_in_ee: Array  # w; shape (6,)
    rotation_ee_to_inertial: Array  # shape (3, 3)


def stacked(solutions: Sequence[VelocitySolution]) -> VelocitySolution:
    """Return the arrays of several solutions as one array each, a row a solution."""
    return VelocitySolution(*(np.array(column) for column in zip(*solutions, strict=True)))


class VelocityMap:
    """Velocities of a free-floating robot at given momentum and end-effector twist.

    Owns Pinocchio's scratch space: one object serves one thread.
    """

    def __init__(self, robot: Robot, damping: float = 0.0) -> None:
        """Make the scratch space of a robot.

        Args:
            damping: Singular values of the generalised Jacobian up to about this are damped: joint
                velocities stay bounded, and the end effector lags behind. Zero for Eq. (31) itself.
        """
        self._robot = robot
        self._damping = damping**2 * np.eye(6)
        self._spread = 1.0 / robot.joint_weights**2  # W^-2
        self._data = robot.model.createData()
        self._tip_joint = robot.model.frames[robot.tip_frame_id].parentJoint
        self._tip_placement = robot.model.frames[robot.tip_frame_id].placement
        self._forces = pin.StdVec_Force([pin.Force.Zero() for _ in range(robot.model.njoints)])
        self._no_motion = np.zeros(6 + robot.joints)
        self._momentum_rows = np.empty((6, robot.joints + 1), order="F")
        self._twist_rows = np.empty((6, robot.joints + 1))

    def solve(
        self,
        q: Array,
        momentum: Array,
        twist_ee_in_inertial: Array,
        bias: Array | None = None,
    ) -> VelocitySolution:
        """Return the velocity of least joint velocities, Eqs. (27) and (31), or nearest to a bias.

        Args:
            q: Configuration. Shape (7 + joints,).
            momentum: Total P and L about the inertial origin, inertial axes. Shape (6,)
                [N s, N m s].
            twist_ee_in_inertial: Wanted linear and angular velocity. Shape (6,) [m/s, rad/s].
            bias: Joint velocities z; None: zero. Shape (joints,) [rad/s].

        Raises:
            numpy.linalg.LinAlgError: The generalised Jacobian is exactly singular.
        """
        model, data, tip = self._robot.model, self._data, self._robot.tip_frame_id
        momentum_map = pin.crba(model, data, q)[:6].copy()
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacement(model, data, tip)
        jacobian = pin.getFrameJacobian(model, data, tip, pin.LOCAL)
        rotation_ee = data.oMf[tip].rotation.copy()
        h = data.oMi[1].actInv(pin.Force(momentum)).vector
        w = twist_ee_in_inertial.reshape(2, 3).dot(rotation_ee).ravel()

        # Base and joints of both equations with their right-hand sides: the base is eliminated.
        # On matrices this small, `dot` takes half the time of `@`.
        right = self._momentum_rows
        right[:, :-1], right[:, -1] = momentum_map[:, 6:], h
        coupling = _solve_positive(momentum_map[:, :6], right)
        rows = self._twist_rows
        rows[:, :-1], rows[:, -1] = jacobian[:, 6:], w
        rows = rows - jacobian[:, :6].dot(coupling)
        generalised = rows[:, :-1]  # J_D, Eq. (32)
        slack = rows[:, -1] if bias is None else rows[:, -1] - generalised.dot(bias)
        square = (generalised * self._spread).dot(generalised.T)
        mu = _solve_positive(square + self._damping, slack)
        v = np.empty(len(self._no_motion))
        v[6:] = self._spread * mu.dot(generalised)  # Eq. (31)
        if bias is not None:
            v[6:] += bias
        v[:6] = coupling[:, -1] - coupling[:, :-1].dot(v[6:])  # Eq. (27)
        return VelocitySolution(v, q, momentum_map, jacobian, mu, h, w, rotation_ee)

    def regular(
        self,
        q: Array,
        momentum: Array,
        twist_ee_in_inertial: Array,
        bias: Array | None = None,
    ) -> VelocitySolution | None:
        """Return what `solve` does where the arm can follow; None in a dynamic singularity."""
        try:
            solution = self.solve(q, momentum, twist_ee_in_inertial, bias)
        except np.linalg.LinAlgError:
            return None
        square = float(solution.v[6:] @ solution.v[6:])
        return solution if square < _SINGULAR_JOINT_RATE**2 else None

    def derivatives(self, at: VelocitySolution) -> tuple[Array, Array]:
        """Return the exact derivatives of solutions, the algebra batched over all of them.

        The multipliers lambda turn the minimisation into its linear KKT system
        [S A^T; A -D] [v; lambda] = [0; b], with S selecting the joints and D the damping.
        Differentiating it needs d(A^T lambda)/dq, d(A v)/dq and db/dq: derivatives of inverse
        dynamics and of forward kinematics, which Pinocchio has in closed form. Eliminating as
        `solve` does, base first, gives the derivatives of joint velocities and base twist. A bias
        changes the multipliers and none of these formulas.

        Args:
            at: Solutions of `solve` for this robot, `stacked`.

        Returns:
            dv/dq in the tangent space, shape (solutions, 6 + joints, 6 + joints), and
            dv/dtwist, twist in inertial axes, shape (solutions, 6 + joints, 6).
        """
        count, size = at.v.shape
        base_inverse = np.linalg.inv(at.momentum_map[:, :, :6])
        # The momentum's multiplier: how the base speeds up when mu pulls at the end effector.
        base_acceleration = np.zeros((count, size))
        pull = np.einsum("sij,si->sj", at.jacobian[:, :, :6], at.mu)
        base_acceleration[:, :6] = np.einsum("sij,sj->si", base_inverse, pull)
        columns = size + 6
        derivatives = [
            self._differentiate_model(*one)
            for one in zip(at.q, at.v, at.mu, base_acceleration, strict=True)
        ]
        force = np.zeros((count, size, columns))  # of -d(A^T lambda)
        momentum = np.zeros((count, 6, columns))  # of dh - d(H) v
        twist = np.zeros((count, 6, columns))  # of dw - d(J) v
        for right, of_q in zip(
            (force, momentum, twist), zip(*derivatives, strict=True), strict=True
        ):
            right[:, :, :size] = of_q
            np.negative(right, out=right)
        momentum[:, :, :6] += _momentum_derivative(at.momentum_in_base)
        twist[:, :, :size] += _twist_derivative(at.twist_in_ee, at.jacobian)
        inertial_to_ee = at.rotation_ee_to_inertial.transpose(0, 2, 1)
        twist[:, :3, size : size + 3] = inertial_to_ee
        twist[:, 3:, size + 3 :] = inertial_to_ee

        coupling = base_inverse @ at.momentum_map[:, :, 6:]
        generalised = at.jacobian[:, :, 6:] - at.jacobian[:, :, :6] @ coupling
        generalised_t = self._spread[:, None] * generalised.transpose(0, 2, 1)
        drift = base_inverse @ momentum
        joint_force = force[:, 6:] - coupling.transpose(0, 2, 1) @ force[:, :6]
        joint_force = self._spread[:, None] * joint_force
        slack = twist - at.jacobian[:, :, :6] @ drift - generalised @ joint_force
        square = generalised @ generalised_t + self._damping
        joints = joint_force + generalised_t @ np.linalg.solve(square, slack)
        solved = np.concatenate([drift - coupling @ joints, joints], axis=1)
        return solved[:, :, :size], solved[:, :, size:]

    def of_bias(self, at: VelocitySolution) -> Array:
        """Return dv/dz of solutions, `stacked`. Shape (solutions, 6 + joints, joints)."""
        base, joints = at.momentum_map[:, :, :6], at.momentum_map[:, :, 6:]
        coupling = np.linalg.solve(base, joints)
        generalised = at.jacobian[:, :, 6:] - at.jacobian[:, :, :6] @ coupling
        generalised_t = self._spread[:, None] * generalised.transpose(0, 2, 1)
        square = generalised @ generalised_t + self._damping
        # N: without damping, the projector on the null space of J_D.
        null = np.eye(generalised.shape[2]) - generalised_t @ np.linalg.solve(square, generalised)
        return np.concatenate([-coupling @ null, null], axis=1)

    def _differentiate_model(
        self, q: Array, v: Array, mu: Array, base_acceleration: Array
    ) -> tuple[Array, Array, Array]:
        """Return d(A^T lambda)/dq, d(H)/dq v and d(J)/dq v of one solution."""
        model, data, tip = self._robot.model, self._data, self._robot.tip_frame_id
        still = self._no_motion

        # A^T lambda is the inverse dynamics of a system at rest whose base accelerates by the
        # momentum's multiplier while the twist's multiplier pulls at the end effector.
        self._forces[self._tip_joint] = self._tip_placement.act(pin.Force(mu))
        pin.computeRNEADerivatives(model, data, q, still, base_acceleration, self._forces)
        of_force = data.dtau_dq.copy()
        # M v is the inverse dynamics of a system at rest that accelerates by v.
        pin.computeRNEADerivatives(model, data, q, still, v)
        of_momentum = data.dtau_dq[:6].copy()
        pin.computeForwardKinematicsDerivatives(model, data, q, v, still)
        of_twist, _ = pin.getFrameVelocityDerivatives(model, data, tip, pin.LOCAL)
        return of_force, of_momentum, of_twist


def _solve_positive(matrix: Array, right: Array) -> Array:
    """Solve a small positive definite system; SciPy's and numpy's wrappers cost more than it."""
    _, solution, failed = dposv(matrix, right)
    if failed:
        raise np.linalg.LinAlgError("matrix is not positive definite")
    return cast(Array, solution)


def _momentum_derivative(momentum_in_base: Array) -> Array:
    """Return dh/dq for a step of the base in its own frame. Shape (solutions, 6, 6)."""
    linear = skew(momentum_in_base[:, :3])
    derivative = np.zeros((len(momentum_in_base), 6, 6))
    derivative[:, :3, 3:] = linear
    derivative[:, 3:, :3] = linear
    derivative[:, 3:, 3:] = skew(momentum_in_base[:, 3:])
    return derivative


def _twist_derivative(twist_in_ee: Array, jacobian: Array) -> Array:
    """Return dw/dq: the end effector rotates under the wanted twist. Shape (solutions, 6, v)."""
    turning = jacobian[:, 3:]
    return np.concatenate(
        [skew(twist_in_ee[:, :3]) @ turning, skew(twist_in_ee[:, 3:]) @ turning], axis=1
    )
