"""First-order deviation of a plan's base motion by model and start errors, joints controlled.

A controller makes the joints do what the plan says. The base does what momentum demands, and
momentum is linear in the inertial parameters phi (`momentum_regressor`). With M the locked inertia,
xi the base's twist and h_0 the momentum of the true system at the start, about the inertial origin,

    M xi + Y_6 phi = X(t) h_0,    h_0 = X(0)^-1 (M xi + Y_6 phi)(0).

Its exact variation is linear: zeta, the small motion of the base in inertial axes, obeys

    zeta' = Ad M^-1 (X (dh_0 - zeta x* h_0) - dY phi),    zeta(0) = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.motion.followed import steps_of
from ff_planner_ros.planning.motion.forward import carried_base
from ff_planner_ros.planning.motion.joint_motion import JointMotion, joint_motion
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.uncertainty import Directions
from ff_planner_ros.robot.dynamics import accelerations
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import inertial_parameters, momentum_regressors, total_momentum
from ff_planner_ros.robot.quaternion import rotation_from_quaternion


@dataclass(frozen=True, eq=False)
class TrackedMotion:
    """A plan that a controller tracks, in a frame that moves with the system's centre of mass.

    Its axes are those of the plan's frame. Times are the steps of an integration; fields named
    `half_` also hold the times half-way between two steps.
    """

    robot: Robot
    joints: JointMotion
    origin: Array  # of the frame at time zero, in the plan's; shape (3,) [m]
    velocity: Array  # of the frame, in the plan's; shape (3,) [m/s]
    half_time: Array  # shape (2 * steps + 1,) [s]
    half_q: Array  # configurations of the system as modelled; shape (2 * steps + 1, 7 + joints)
    half_v: Array  # tangent velocities; shape (2 * steps + 1, 6 + joints)
    half_regressors: Array  # of `momentum_regressors`, at these
    momentum: Array  # as modelled, about the origin of the frame; shape (6,) [N s, N m s]

    @property
    def time(self) -> Array:
        """Ends of steps. Shape (times,) [s]."""
        return self.half_time[::2]

    @property
    def q(self) -> Array:
        """Configurations as modelled. Shape (times, 7 + joints)."""
        return self.half_q[::2]

    @property
    def at_points(self) -> Indices:
        """Which of the times are the plan's samples. Shape (points,)."""
        count = len(self.joints.time)
        return np.linspace(0, len(self.time) - 1, count).round().astype(np.intp)


def tracked_motion(robot: Robot, trajectory: Trajectory) -> TrackedMotion:
    """Return the motion of the system as modelled when a controller tracks a plan."""
    q, v = from_trajectory(robot, trajectory)
    q_start, v_start = q[0].copy(), v[0].copy()
    # Relative to the base first: far away, or where everything moves fast, digits would be lost.
    place, q_start[:3] = q_start[:3].copy(), 0.0
    to_inertial = rotation_from_quaternion(q_start[3:7])
    drift, v_start[:3] = to_inertial @ v_start[:3], 0.0
    data = robot.model.createData()
    pin.centerOfMass(robot.model, data, q_start, v_start)
    center, center_velocity = data.com[0].copy(), data.vcom[0].copy()
    q_start[:3], v_start[:3] = -center, to_inertial.T @ -center_velocity
    joints = joint_motion(trajectory)
    _, time = steps_of(joints, v_start, 1)
    count = 2 * len(time) - 1
    half_time = np.interp(np.arange(count), 2 * np.arange(len(time)), time)
    momentum = total_momentum(robot, data, q_start, v_start)
    half_q, half_v = carried_base(robot, q_start, momentum, joints, half_time)
    return TrackedMotion(
        robot=robot,
        joints=joints,
        origin=place + center,
        velocity=drift + center_velocity,
        half_time=half_time,
        half_q=half_q,
        half_v=half_v,
        half_regressors=momentum_regressors(robot, half_q[:, 7:], half_v[:, 6:]),
        momentum=momentum,
    )


class BaseSpread(NamedTuple):
    """Deviation of the base by one sigma of each error, to first order; linear part first."""

    # zeta: a point p of the base moves by zeta_v + zeta_w x p, in axes and from the origin of the
    # motion's frame; shape (times, 6, errors)
    pose: Array
    twist: Array  # change of the base's twist, in its own axes; shape (times, 6, errors)


def base_spread(motion: TrackedMotion, of: Directions) -> BaseSpread:
    """Return the first-order deviation of the base along a motion, by each error."""
    regressors, rows = motion.half_regressors, motion.robot.base.rows
    parameters = inertial_parameters(motion.robot)
    whole = np.concatenate([motion.half_v[:, :6], np.ones((len(regressors), 1))], axis=1)
    of_parameters = np.einsum("tk,tkin->tin", whole, regressors) @ of.parameters
    locked = (regressors[:, :6] @ parameters).swapaxes(1, 2)
    placements = [pin.XYZQUATToSE3(q[:7]) for q in motion.half_q]
    act = np.array([each.toActionMatrix() for each in placements])
    to_base = np.array([each.inverse().toDualActionMatrix() for each in placements])
    inverse = np.zeros_like(locked)
    inverse[np.ix_(range(len(locked)), rows, rows)] = np.linalg.inv(
        locked[np.ix_(range(len(locked)), rows, rows)]
    )
    # dh_0 is of the inertial origin: what it is about the base, brought there.
    at_start = of_parameters[0] + locked[0] @ of.base_twist
    of_momentum = np.linalg.solve(to_base[0], at_start)
    constant = to_base @ of_momentum - of_parameters
    linear = -to_base @ _crossed_with(motion.momentum)
    twist_constant, twist_linear = inverse @ constant, inverse @ linear
    constant, linear = act @ twist_constant, act @ twist_linear
    spread = np.zeros((len(motion.time), 6, of.parameters.shape[1]))
    for i, step in enumerate(np.diff(motion.time).tolist()):
        begin, middle, end = 2 * i, 2 * i + 1, 2 * i + 2
        k1 = linear[begin] @ spread[i] + constant[begin]
        k2 = linear[middle] @ (spread[i] + step / 2 * k1) + constant[middle]
        k3 = linear[middle] @ (spread[i] + step / 2 * k2) + constant[middle]
        k4 = linear[end] @ (spread[i] + step * k3) + constant[end]
        spread[i + 1] = spread[i] + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return BaseSpread(spread, twist_linear[::2] @ spread + twist_constant[::2])


def torques_by_errors(
    motion: TrackedMotion, of: Directions, spread: BaseSpread
) -> tuple[Array, Array]:
    """Return the torques that keep the joints on the plan, and their derivatives by the errors.

    F = Y phi of Eq. (20) is zero in the base's rows, whatever the errors: this gives the change of
    the base's acceleration; the joints' rows are the torques.

    Returns:
        At the samples of the joints: shapes (points, joints) and (points, joints, errors) [N m].
    """
    robot, tree, rows = motion.robot, motion.robot.tree, motion.robot.base.rows
    # Pinocchio's regressor is of joints that move by themselves.
    model, data = tree.model, tree.model.createData()
    at = motion.at_points
    q, v = motion.q[at], motion.half_v[::2][at]
    acceleration = accelerations(robot, q, v, motion.joints.accelerations)
    each = (
        np.hstack([one[:, :base], of_joints(one[:, base:])])
        for one, base, of_joints in (
            (q, 7, tree.positions),
            (v, 6, tree.rates),
            (acceleration, 6, tree.rates),
        )
    )
    torques = np.empty_like(motion.joints.positions)
    by_errors = np.empty((*torques.shape, of.parameters.shape[1]))
    for i, sample in enumerate(zip(*each, strict=True)):
        regressor = pin.computeJointTorqueRegressor(model, data, *sample).copy()
        _, of_v, mass = pin.computeRNEADerivatives(model, data, *sample)
        forces = regressor @ of.parameters + of_v[:, :6] @ spread.twist[at[i]]
        of_base = np.linalg.solve(mass[np.ix_(rows, rows)], -forces[rows])
        torques[i] = tree.by_planned(data.tau[6:])
        by_errors[i] = tree.by_planned((forces[6:] + mass[6:, rows] @ of_base).T).T
    return torques, by_errors


def _crossed_with(momentum: Array) -> Array:
    """Return the matrix of zeta -> zeta x* h. Shape (6, 6)."""
    force, couple = pin.skew(momentum[:3]), pin.skew(momentum[3:])
    return -np.block([[np.zeros((3, 3)), force], [force, couple]])
