"""Motions of others on our models: the joints move as published, momentum moves the base.

Every motion begins at rest, with the frame of the base link at the origin of the inertial frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.forward import carried_base
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import base_twist

# Of a configuration at a time [s]: torques [N m] by configuration and velocity, or joint velocities
# [rad/s] by configuration alone.
Torques: TypeAlias = Callable[[float, Array, Array], Array]
Law: TypeAlias = Callable[[float, Array], Array]


@dataclass(frozen=True, eq=False)
class Moved:
    """A motion of the whole system."""

    robot: Robot
    time: Array  # shape (points,) [s]
    q: Array  # configurations; shape (points, 7 + joints)

    @property
    def turns(self) -> Array:
        """Rotation vectors of the base since the first point. Shape (points, 3) [deg]."""
        attitudes = Rotation.from_quat(self.q[:, 3:7])
        turns: Array = np.rad2deg((attitudes[0].inv() * attitudes).as_rotvec())
        return turns

    @property
    def turn(self) -> float:
        """Rotation of the base at the last point [deg]; on a table its sign is that about z."""
        last = self.turns[-1]
        return float(last[2] if self.robot.base == "planar" else np.linalg.norm(last))

    @property
    def peak(self) -> float:
        """Largest rotation of the base at any point [deg]."""
        return float(np.linalg.norm(self.turns, axis=1).max())

    def ee(self, point: int = -1) -> pin.SE3:
        """Pose of the end effector in the inertial frame at a point."""
        return ee_pose(self.robot, self.q[point])


def at_start(robot: Robot, joints: Array) -> Array:
    """Return the configuration with the base at the origin. Shape (7 + joints,)."""
    return np.concatenate([pin.neutral(robot.model)[:7], joints])


def ee_pose(robot: Robot, q: Array) -> pin.SE3:
    """Return the end effector's pose in the inertial frame."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    return pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)


def quintic(begin: Array, end: Array, duration: float) -> JointMotion:
    """Return one quintic a joint, from rest to rest."""
    ends = np.array([begin, end])
    still = np.zeros_like(ends)
    return JointMotion(np.array([0.0, duration]), ends, still, still)


def sampled(motion: Callable[[Array], tuple[Array, Array, Array]], time: Array) -> JointMotion:
    """Return the joints' motion through samples of positions, velocities and accelerations."""
    return JointMotion(time, *motion(time[:, None]))


def driven(robot: Robot, joints: JointMotion, steps: int) -> Moved:
    """Return the motion from rest whose joints move as given, in so many Runge-Kutta steps."""
    time = np.linspace(joints.time[0], joints.time[-1], steps + 1)
    q_start = at_start(robot, joints.positions[0])
    q, _ = carried_base(robot, q_start, np.zeros(6), joints, time)
    return Moved(robot, time, q)


def by_torques(
    robot: Robot, joints: Array, torques: Torques, duration: float, step: float
) -> Moved:
    """Return the motion from rest under torques, by Runge-Kutta steps of forward dynamics."""
    model, data = robot.model, robot.model.createData()
    q, v = at_start(robot, joints), np.zeros(model.nv)
    count = round(duration / step)
    rows, forces = [q], np.zeros(model.nv)

    def accelerations(time: float, q: Array, v: Array) -> Array:
        forces[6:] = torques(time, q, v)
        return np.array(pin.aba(model, data, q, v, forces))

    for k in range(count):
        time, half = k * step, step / 2
        a1 = accelerations(time, q, v)
        v2 = v + half * a1
        a2 = accelerations(time + half, pin.integrate(model, q, half * v), v2)
        v3 = v + half * a2
        a3 = accelerations(time + half, pin.integrate(model, q, half * v2), v3)
        v4 = v + step * a3
        a4 = accelerations(time + step, pin.integrate(model, q, step * v3), v4)
        q = pin.integrate(model, q, step / 6 * (v + 2 * v2 + 2 * v3 + v4))
        v = v + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        rows.append(q)
    return Moved(robot, np.linspace(0.0, duration, count + 1), np.array(rows))


def by_law(robot: Robot, joints: Array, law: Law, duration: float, step: float) -> Moved:
    """Return the motion under a law of joint velocities, by Euler steps as its authors take them.

    In a step the base moves along its inertial velocity and turns about its angular velocity.
    """
    data, count = robot.model.createData(), round(duration / step)
    q, rows = at_start(robot, joints), list[Array]()
    for k in range(count):
        rows.append(q)
        rates = law(k * step, q)
        twist = base_twist(robot, data, q, np.zeros(6), rates)
        attitude = Rotation.from_quat(q[3:7])
        turned = Rotation.from_rotvec(step * attitude.apply(twist[3:])) * attitude
        place = q[:3] + step * attitude.apply(twist[:3])
        q = np.concatenate([place, turned.as_quat(), q[7:] + step * rates])
    return Moved(robot, np.linspace(0.0, duration, count + 1), np.array([*rows, q]))
