"""What a motion misses of its goal, by numpy and Pinocchio: to compare the compiled core with.

Where the target leaves the orientation free, or free about an axis, only the other conditions are
left; where the base is planar, only those in the plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.problem import Orientation, Target
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.rotation import skew

# The cosine of a smaller angle is one but for rounding; there series replace quotients.
_ALIGNED = 1e-9


@dataclass(frozen=True, eq=False)
class EndPoint:
    """The last point of a motion, and its derivatives by x."""

    q: Array  # shape (7 + joints,)
    v: Array  # shape (6 + joints,)
    acceleration: Array  # dv/dt; shape (6 + joints,)
    q_by_x: Array  # in the tangent space; shape (6 + joints, variables)
    v_by_x: Array  # shape (6 + joints, variables)
    joint_acceleration_by_x: Array  # shape (joints, variables)


@dataclass(frozen=True, eq=False)
class _Error:
    """A vector in inertial axes, and its derivatives by x."""

    value: Array  # shape (3,)
    by_x: Array  # shape (3, variables)


def end_conditions(
    robot: Robot, target: Target, end: EndPoint, duration: float
) -> tuple[Array, Array]:
    """Return what the last point of a motion misses, and the derivatives of it by x.

    Pose first, then twist and acceleration: lengths [m] and angles [rad], those of the last two
    being the way that they make in a quarter of the duration [s].

    Returns:
        Shapes (rows,) and (rows, variables).
    """
    tip, turn, (place, of_twist, of_acceleration) = _errors(robot, target, end)
    to_ee = tip.rotation.T
    linear = np.eye(3) if robot.base is Base.FREE_FLYER else np.eye(3)[:2]
    pairs = [(linear @ place.value, linear @ place.by_x)]
    pairs += [_orientation(robot, target, tip.rotation, turn)]
    scale = duration / 4.0
    for (moving, turning), unit in ((of_twist, scale), (of_acceleration, scale**2)):
        pairs.append((unit * linear @ moving.value, unit * linear @ moving.by_x))
        if target.orientation is Orientation.FREE:
            continue
        if target.orientation is Orientation.FIXED:
            angular = np.eye(3) if robot.base is Base.FREE_FLYER else np.eye(3)[2:]
            pairs.append((unit * angular @ turning.value, unit * angular @ turning.by_x))
            continue
        across = _across(target)
        in_ee = to_ee @ turning.value
        by_x = to_ee @ turning.by_x + skew(in_ee) @ turn
        pairs.append((unit * across @ in_ee, unit * across @ by_x))
    values, by_x = zip(*pairs, strict=True)
    return np.concatenate(values), np.concatenate(by_x)


def _errors(
    robot: Robot, target: Target, end: EndPoint
) -> tuple[pin.SE3, Array, tuple[_Error, tuple[_Error, _Error], tuple[_Error, _Error]]]:
    """Return the end effector's pose, its turn by x in its own axes, and what it misses.

    That is position, then linear and angular velocity, then accelerations.
    """
    model, data, frame = robot.model, robot.model.createData(), robot.tip_frame_id
    by_x = _acceleration_by_x(robot, data, end)
    pin.computeForwardKinematicsDerivatives(model, data, end.q, end.v, end.acceleration)
    tip = pin.updateFramePlacement(model, data, frame).copy()
    way = pin.getFrameJacobian(model, data, frame, pin.LOCAL) @ end.q_by_x
    twist = pin.getFrameVelocity(model, data, frame, pin.LOCAL).vector
    by_q, by_v = pin.getFrameVelocityDerivatives(model, data, frame, pin.LOCAL)
    twist_by_x = by_q @ end.q_by_x + by_v @ end.v_by_x
    acceleration = pin.getFrameAcceleration(model, data, frame, pin.LOCAL).vector.copy()
    _, by_q, by_v, by_a = pin.getFrameAccelerationDerivatives(model, data, frame, pin.LOCAL)
    acceleration_by_x = by_q @ end.q_by_x + by_v @ end.v_by_x + by_a @ by_x
    # From the spatial to the classical acceleration.
    linear, angular = twist[:3], twist[3:]
    acceleration[:3] += np.cross(angular, linear)
    acceleration_by_x[:3] += skew(angular) @ twist_by_x[:3] - skew(linear) @ twist_by_x[3:]
    turn = way[3:]

    def missed(in_ee: Array, in_ee_by_x: Array, wanted: Array) -> _Error:
        turned = in_ee_by_x - skew(in_ee) @ turn
        return _Error(tip.rotation @ in_ee - wanted, tip.rotation @ turned)

    place = _Error(tip.translation - target.position, tip.rotation @ way[:3])
    return (
        tip,
        turn,
        (
            place,
            (
                missed(linear, twist_by_x[:3], target.linear_velocity),
                missed(angular, twist_by_x[3:], target.angular_velocity),
            ),
            (
                missed(acceleration[:3], acceleration_by_x[:3], target.linear_acceleration),
                missed(acceleration[3:], acceleration_by_x[3:], target.angular_acceleration),
            ),
        ),
    )


def _acceleration_by_x(robot: Robot, data: pin.Data, end: EndPoint) -> Array:
    """Return the derivatives of dv/dt: nothing pushes the base, Eq. (20)."""
    model = robot.model
    pin.computeRNEADerivatives(model, data, end.q, end.v, end.acceleration)
    wrench = data.dtau_dq[:6] @ end.q_by_x + data.dtau_dv[:6] @ end.v_by_x
    inertia = pin.crba(model, data, end.q)[:6]
    wrench += inertia[:, 6:] @ end.joint_acceleration_by_x
    rows = robot.base.rows
    of_base = np.zeros_like(wrench)
    of_base[rows] = -np.linalg.solve(inertia[np.ix_(rows, rows)], wrench[rows])
    return np.concatenate([of_base, end.joint_acceleration_by_x])


def _orientation(robot: Robot, target: Target, rotation: Array, turn: Array) -> tuple[Array, Array]:
    """Return by what turn the orientation misses the target's [rad], and its derivatives by x.

    Args:
        rotation: End effector to inertial axes. Shape (3, 3).
        turn: Of the end effector by x, in its axes. Shape (3, variables).
    """
    wanted = pin.Quaternion(target.quaternion_xyzw).toRotationMatrix()
    if target.orientation is Orientation.FREE:
        return np.empty(0), np.empty((0, turn.shape[1]))
    if target.orientation is Orientation.FIXED:
        off = wanted.T @ rotation
        # In the target's axes, where it is the same vector as in the end effector's.
        value, by_x = pin.log3(off), pin.Jlog3(off) @ turn
        if robot.base is Base.PLANAR:
            normal = wanted[2:]
            return normal @ value, normal @ by_x
        return value, by_x
    axis, across = _free_axis(target), _across(target)
    there = rotation.T @ wanted @ axis
    there_by_x = skew(there) @ turn
    cosine = float(np.clip(axis @ there, -1.0 + _ALIGNED, 1.0))
    beyond = 1.0 - cosine
    if beyond < _ALIGNED:
        part, slope = 1.0 + beyond / 3.0, -1.0 / 3.0
    else:  # angle over its sine, and its derivative by the cosine
        part = np.arccos(cosine) / np.sqrt(1.0 - cosine**2)
        slope = (cosine * part - 1.0) / (1.0 - cosine**2)
    sines = skew(axis) @ there
    by_x = part * skew(axis) @ there_by_x + slope * np.outer(sines, axis @ there_by_x)
    return across @ (part * sines), across @ by_x


def _across(target: Target) -> Array:
    """Return axes of the end effector across that about which it is free to turn. Shape (2, 3)."""
    _, _, rows = np.linalg.svd(_free_axis(target)[None])
    across: Array = rows[1:]
    return across


def _free_axis(target: Target) -> Array:
    return np.zeros(3) if target.free_axis_in_ee is None else target.free_axis_in_ee
