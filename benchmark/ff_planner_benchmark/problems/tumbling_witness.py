"""Witnesses: motions that end with the end effector at rest in the grasp frame of a tumbling body.

Each joint follows a quintic. With a corridor the quintics end at rest relative to the body, before
the corridor's mouth; from there the end effector moves straight in, in the body's frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ff_planner_benchmark.problems.witnessed import FROM_LIMITS
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.forward import carried_base
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.motion.runge_kutta import runge_kutta_step
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.robot.configuration import configuration, eigen_quaternion
from ff_planner_ros.robot.dynamics import accelerations, joint_torques
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import (
    base_twist,
    generalised_jacobian,
    smallest_singular_values,
    total_momentum,
)
from ff_planner_ros.robot.state import SystemState

# The witness stays below so much of rates and torques.
_OF_LIMITS = 0.7
# Its smallest singular value is more, at its ends; the planner's threshold is 0.02.
_REGULAR = 0.08
# Runge-Kutta steps on which its end is solved for, and the factor of a second, finer solution: this
# is exact to 1e-11 m, so that any sound integrator leads to the same scenario in six decimals.
_STEPS, _FINER = 100, 16
# Of the straight part: its length over the corridor's, its part of the duration, and its steps.
_BEFORE, _LAST_PART, _LAST_STEPS = 1.2, 0.35, 40
# Of the quintics' end: largest number of iterations, and tolerance [rad/s, rad/s2].
_ROUNDS, _SETTLED = 30, 1e-11


@dataclass(frozen=True, eq=False)
class Grip:
    """A target body at capture, relative to the end effector that holds it."""

    to_ee: Array  # rotation from body to end-effector axes; shape (3, 3)
    center: Array  # its centre of mass in end-effector axes; shape (3,) [m]
    inertia: Array  # in body axes; shape (3, 3)
    rate: Array  # angular velocity in body axes; shape (3,) [rad/s]
    drift: Array  # velocity of its centre of mass in end-effector axes; shape (3,) [m/s]

    def body(self, tip: pin.SE3) -> TargetBody:
        """Return the body held by an end effector of inertial pose `tip`."""
        to_inertial = tip.rotation @ self.to_ee
        return TargetBody(
            position=tip.translation + tip.rotation @ self.center,
            quaternion_xyzw=eigen_quaternion(to_inertial),
            inertia=self.inertia,
            grasp_position=-self.to_ee.T @ self.center,
            grasp_quaternion_xyzw=eigen_quaternion(self.to_ee.T),
            linear_velocity=tip.rotation @ self.drift,
            angular_velocity=to_inertial @ self.rate,
        )


class Witness(NamedTuple):
    """A motion that solves a problem, with the target body that it captures."""

    way: Array  # configurations; shape (times, 7 + joints)
    times: Array  # shape (times,) [s]
    body: TargetBody  # in its state at the first time
    torques: Array  # largest magnitude for each joint; shape (joints,) [N m]
    joints: JointMotion | None = None  # the joints' motion; None: it is not one quintic a joint


def witness_to_grip(
    robot: Robot, start: SystemState, end: Array, grip: Grip, duration: float
) -> Witness | None:
    """Return a motion of quintics that ends at rest relative to the gripped body.

    None: there is none to that posture, or it violates limits of joints, torques or regularity.

    Args:
        end: Joint positions at the end. Shape (joints,) [rad].
        duration: Of the motion [s].
    """
    q, v = configuration(robot, start)
    momentum = total_momentum(robot, robot.model.createData(), q, v)
    times = np.linspace(0.0, duration, _STEPS + 1)
    still = np.zeros(robot.joints)
    last = np.zeros((2, robot.joints))  # rates and accelerations at the end
    for finer in (1, _FINER):
        moments = np.linspace(0.0, duration, finer * _STEPS + 1)
        for _ in range(_ROUNDS):
            quintics = JointMotion(
                np.array([0.0, duration]),
                np.array([start.joint_positions, end]),
                np.array([start.joint_velocities, last[0]]),
                np.array([still, last[1]]),
            )
            angles, rates, changes = quintics.at(times)
            if not _within_limits(robot, angles, rates):
                return None
            way, twists = carried_base(robot, q, momentum, quintics, moments)
            if smallest_singular_values(robot, way[[0, -1]]).min() < _REGULAR:
                return None
            wanted = np.array(_rates_in_grip(robot, way[-1], momentum, grip))
            settled = np.abs(wanted - last).max() < _SETTLED
            last = wanted
            if settled:
                break
        else:
            return None
    way, twists = way[::finer], twists[::finer]
    torques = np.abs(joint_torques(robot, way, twists, changes)).max(axis=0)
    if (torques > _OF_LIMITS * robot.effort_limits).any():
        return None
    body = grip.body(tip(robot, way[-1])).after(-duration)
    return Witness(way, times, body, torques, quintics)


def witness_along_corridor(
    robot: Robot,
    start: SystemState,
    end: Array,
    grip: Grip,
    duration: float,
    corridor: Array,
) -> Witness | None:
    """Return a motion of quintics to the mouth of a corridor, and straight in from there.

    None: there is none from that posture, or it violates limits of joints, torques or regularity.

    Args:
        end: Joint positions where the straight part begins. Shape (joints,) [rad].
        duration: Of both parts together [s].
        corridor: Direction of motion times length of the corridor, in end-effector axes. (3,) [m].
    """
    way_in, last = _BEFORE * corridor, _LAST_PART * duration
    before = replace(grip, center=grip.center + way_in)
    first = witness_to_grip(robot, start, end, before, duration - last)
    if first is None:
        return None
    body = replace(first.body, grasp_position=-grip.to_ee.T @ grip.center)
    at_entry = body.after(duration - last)
    data = robot.model.createData()
    momentum = total_momentum(robot, data, *configuration(robot, start))
    aside = grip.to_ee.T @ way_in

    def velocity(half_step: int, q: Array) -> Array:
        """Return the tangent velocity along the corridor; its arc length is a quintic from rest."""
        s = half_step / (2 * _LAST_STEPS)
        to_come = 1.0 - s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        speed = 30.0 * s**2 * (1.0 - s) ** 2 / last
        place = at_entry.grasp_position - to_come * aside
        seen = at_entry.motion(place, np.array([s * last]))
        twist = seen.twists[0].copy()
        twist[:3] += speed * seen.rotations[0] @ aside
        return _following(robot, q, momentum, twist)

    q, dt = first.way[-1], last / _LAST_STEPS
    way, twists = [q], [velocity(0, q)]
    for step in range(_LAST_STEPS):

        def of_stage(stage: int, there: Array, begin: int = 2 * step) -> Array:
            return velocity(begin + (stage + 1) // 2, there)

        q = pin.integrate(robot.model, q, runge_kutta_step(robot.model, q, dt, of_stage))
        way.append(q)
        twists.append(velocity(2 * step + 2, q))
    rows, v = np.array(way), np.array(twists)
    torques = np.abs(joint_torques(robot, rows, v, np.gradient(v[:, 6:], dt, axis=0))).max(axis=0)
    if (
        not _within_limits(robot, rows[:, 7:], v[:, 6:])
        or (torques > _OF_LIMITS * robot.effort_limits).any()
        or smallest_singular_values(robot, rows).min() < _REGULAR
    ):
        return None
    times = np.concatenate([first.times, duration - last + dt * np.arange(1, _LAST_STEPS + 1)])
    torques = np.maximum(first.torques, torques)
    return Witness(np.concatenate([first.way, rows[1:]]), times, body, torques)


def tip(robot: Robot, q: Array) -> pin.SE3:
    """Return the inertial pose of the end effector in a configuration."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    return pin.updateFramePlacement(robot.model, data, robot.tip_frame_id).copy()


def _within_limits(robot: Robot, angles: Array, rates: Array) -> bool:
    return not (
        (angles < robot.lower_position_limits + FROM_LIMITS).any()
        or (angles > robot.upper_position_limits - FROM_LIMITS).any()
        or (np.abs(rates) > _OF_LIMITS * robot.velocity_limits).any()
    )


def _following(robot: Robot, q: Array, momentum: Array, twist: Array) -> Array:
    """Return the tangent velocity with an end-effector twist and minimal joint velocities."""
    model, data, frame = robot.model, robot.model.createData(), robot.tip_frame_id
    jacobian, still = generalised_jacobian(robot, data, q), np.zeros(robot.joints)
    drifting = np.concatenate([base_twist(robot, data, q, momentum, still), still])
    pin.forwardKinematics(model, data, q, drifting)
    drift = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED).vector
    rates = np.linalg.pinv(jacobian) @ (twist - drift)[robot.base.rows]
    return np.concatenate([base_twist(robot, data, q, momentum, rates), rates])


def _rates_in_grip(robot: Robot, q: Array, momentum: Array, grip: Grip) -> tuple[Array, Array]:
    """Return the smallest joint velocities and accelerations that keep the grip on the body."""
    model, data, frame = robot.model, robot.model.createData(), robot.tip_frame_id
    jacobian, rows = generalised_jacobian(robot, data, q), robot.base.rows
    wanted = grip.body(tip(robot, q)).grasp(np.zeros(1))
    still = np.zeros(robot.joints)
    v = _following(robot, q, momentum, wanted.twists[0])
    coasting = accelerations(robot, q[None], v[None], still[None])[0]
    pin.forwardKinematics(model, data, q, v, coasting)
    change = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED).vector
    return v[6:], np.linalg.pinv(jacobian) @ (wanted.accelerations[0] - change)[rows]
