"""The free-floating system forward in time: momentum is conserved, the joints' motion is given."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, finite_number
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.joint_motion import JointMotion, steady_motion
from ff_planner_ros.planning.motion.runge_kutta import turned_by_momentum
from ff_planner_ros.planning.motion.system_frame import system_frame
from ff_planner_ros.planning.problem.target_body import MOST_TURNS
from ff_planner_ros.robot.configuration import configuration, eigen_quaternion, system_state
from ff_planner_ros.robot.dynamics import accelerations
from ff_planner_ros.robot.ee_at_rest import was_asked_to_rest
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.momentum import (
    base_twist,
    total_momentum,
    with_wheel_momenta,
)
from ff_planner_ros.robot.quaternion import rotation_from_quaternion
from ff_planner_ros.robot.rotation import skew
from ff_planner_ros.robot.state import SystemState

# Largest rotation in one step [rad]. The error of RK4 in a radian is about its fourth power, 1e-7,
# far less than that of a measured state, and a second of a moving arm takes milliseconds.
_STEP_TURN = 0.02


def carried_forward(
    robot: Robot, state: SystemState, seconds: float, joints: JointMotion | None
) -> SystemState:
    """Return the predicted state of a measured system after so many seconds.

    Total momentum is conserved. Without a motion, or before it begins, the joints keep their
    measured velocities. While it runs, they move as it does, from their measured positions, so that
    the controller's tracking error is neither lost nor turned into a jump. After its end they rest.

    Joint accelerations are those of the motion while it runs, and zero after its end. Without one,
    or before it begins, they stay the state's: along a plan of 10 s, that is nearer to the truth
    than zero for 0.5 s; velocities integrated from them would be wrong after 2 s.

    Args:
        joints: The motion that a controller executes, its time counted from the state's; None:
            none.

    Raises:
        InvalidInput: `seconds` is negative or not finite, or the system rotates too far until then.
    """
    if finite_number("seconds", seconds) < 0.0:
        raise InvalidInput(
            Status.OUT_OF_RANGE, "seconds", seconds, "a state can be carried forward only"
        )
    if seconds == 0.0 and (joints is None or joints.time[0] > 0.0):
        return state
    frame = system_frame(robot, state)
    q, v = configuration(robot, frame.start)
    momentum = total_momentum(robot, robot.model.createData(), q, v)
    for phase, begin, end in _phases(state, seconds, joints):
        time = _steps(robot, q, momentum, phase, begin, end)
        q, v = (samples[-1] for samples in carried_base(robot, q, momentum, phase, time))
    there = frame.state_seen_by_user(system_state(robot, q, v), seconds)
    there = replace(there, joint_accelerations=_accelerations(state, seconds, joints))
    return with_wheel_momenta(robot, state, there)


def driven(
    robot: Robot, q_start: Array, momentum: Array, joints: JointMotion, time: Array
) -> tuple[Array, Array, Array]:
    """Return the free-floating motion of a system whose joints move as given.

    Args:
        q_start: Configuration at the first time. If `joints` begins at other positions, the joints
            jump, and the system's centre of mass stays. Shape (7 + joints,).
        momentum: Total P and L about the inertial origin. Shape (6,).
        time: Times of the points, one Runge-Kutta step apart, which is of order four if no point of
            `joints` lies between. Shape (points,) [s].

    Returns:
        Configurations, shape (points, 7 + joints), tangent velocities and accelerations dv/dt, each
        of shape (points, 6 + joints).
    """
    q, v, of_joints, _ = carried(robot, q_start, momentum, joints, time)
    return q, v, accelerations(robot, q, v, of_joints)


def carried_base(
    robot: Robot, q_start: Array, momentum: Array, joints: JointMotion, time: Array
) -> tuple[Array, Array]:
    """Return configurations and tangent velocities of `driven`, at a third of its cost."""
    q, v, _, _ = carried(robot, q_start, momentum, joints, time)
    return q, v


def carried(
    robot: Robot, q_start: Array, momentum: Array, joints: JointMotion, time: Array
) -> tuple[Array, Array, Array, Array]:
    """Return the results of `carried_base`, and joint accelerations and `momentum_maps` there."""
    model, data = robot.model, robot.model.createData()
    points = len(time)
    half_steps = np.interp(np.arange(2 * points - 1), 2 * np.arange(points), time)
    positions, rates, joint_accelerations = joints.at(half_steps)
    # The momentum map depends on the joints alone, so that Eq. (27) is prepared for all times.
    of_joints = np.empty((len(half_steps), model.nq))
    of_joints[:, :7], of_joints[:, 7:] = pin.neutral(model)[:7], positions
    # To momentum about the centre of mass, in axes of the base.
    maps = np.array([pin.computeCentroidalMap(model, data, row) for row in of_joints])
    # The system's centre of mass moves uniformly: its position is known without integration. In the
    # base frame the map holds it: mass times its cross-product matrix.
    mass, linear, angular = pin.computeTotalMass(model), momentum[:3], momentum[3:]
    in_base = maps[::2, [1, 2, 0], [5, 3, 4]] / mass
    centers = pin.centerOfMass(model, data, q_start) + np.outer(time - time[0], linear / mass)
    # The angular momentum about it is constant, and consists of these parts of the base's rotation
    # and of the joints, whatever the linear velocity is.
    constant = angular - pin.skew(centers[0]) @ linear
    about_center, maps = maps[:, 3:, 3:], maps[::2]
    turning = [row - 3 for row in robot.base.rows if row >= 3]
    of_momentum = np.zeros((len(about_center), 3, 3))
    rows, columns = np.ix_(turning, turning)
    of_momentum[:, rows, columns] = np.linalg.inv(about_center[:, rows, columns])
    of_rates = (of_momentum @ (about_center[:, :, 3:] @ rates[:, :, None]))[:, :, 0]
    attitude = pin.XYZQUATToSE3(q_start[:7]).rotation
    steps = np.diff(time)
    if turning:
        turned = turned_by_momentum(attitude, constant, of_momentum, of_rates, steps)
    else:
        turned = np.tile(eigen_quaternion(attitude), (points, 1))
    base_to_inertial = rotation_from_quaternion(turned)
    q, v = np.empty((points, model.nq)), np.empty((points, model.nv))
    q[:, :3] = centers - (base_to_inertial @ in_base[:, :, None])[:, :, 0]
    q[:, 3:7] = turned
    q[:, 7:], v[:, 6:] = positions[::2], rates[::2]
    seen = (constant @ base_to_inertial)[:, :, None]
    v[:, 3:6] = (of_momentum[::2] @ seen)[:, :, 0] - of_rates[::2]
    of_turns = (maps[:, :3, 3:] @ v[:, 3:, None])[:, :, 0]
    v[:, :3] = (linear @ base_to_inertial - of_turns) / mass
    if robot.base is Base.PLANAR:
        q[:, 2], v[:, 2] = q_start[2], 0.0
    maps[:, 3:] += skew(in_base) @ maps[:, :3]
    return q, v, joint_accelerations[::2], maps


def _phases(
    state: SystemState, seconds: float, running: JointMotion | None
) -> Iterator[tuple[JointMotion, float, float]]:
    """Yield the joints' motion before, during and after a running motion, with begin and end."""
    positions, rates = state.joint_positions, state.joint_velocities
    if running is None:
        yield steady_motion(0.0, seconds, positions, rates), 0.0, seconds
        return
    first, last = running.time[[0, -1]].tolist()
    if first > 0.0:
        end = min(first, seconds)
        yield steady_motion(0.0, end, positions, rates), 0.0, end
        positions = positions + end * rates
    begin, end = np.clip([0.0, seconds], first, last).tolist()
    if begin < end or first <= seconds <= last:
        (at_begin, at_end), _, _ = running.at(np.array([begin, end]))
        off = positions - at_begin
        yield replace(running, positions=running.positions + off), begin, end
        positions = at_end + off
    if last < seconds:
        begin = max(last, 0.0)
        yield steady_motion(begin, seconds, positions, np.zeros_like(rates)), begin, seconds


def _accelerations(state: SystemState, seconds: float, running: JointMotion | None) -> Array | None:
    """Return the joints' accelerations after so many seconds [rad/s2, m/s2]; None: not known."""
    if running is None or seconds < running.time[0]:
        return state.joint_accelerations
    if seconds > running.time[-1]:
        return np.zeros_like(state.joint_velocities)
    _, _, (accelerations,) = running.at(np.array([seconds]))
    return np.asarray(accelerations, np.float64)


def as_measured(
    error: InvalidInput, robot: Robot, measured: SystemState, seconds: float
) -> InvalidInput:
    """Return an error of a predicted state; that of a joint is completed by its measured value.

    A velocity that holds the end effector at rest is the chaser's doing: it was not given.

    Args:
        error: Error of the predicted state.
        measured: State that was carried forward.
        seconds: Time by which it was; zero: the error is unchanged.
    """
    for quantity, values, per_time, verb in (
        ("position", measured.joint_positions, "", "comes to"),
        ("velocity", measured.joint_velocities, "/s", "moves at"),
    ):
        for joint, (name, value) in enumerate(zip(robot.joint_names, values, strict=True)):
            if error.field != f"joints.{quantity}[{name}]":
                continue
            if (per_time or seconds) and was_asked_to_rest(robot, measured):
                linear = np.linalg.norm(measured.linear_velocity_chaser_in_inertial)
                angular = np.linalg.norm(measured.angular_velocity_chaser_in_inertial)
                told = (
                    f"true, for which {name} {verb} {error.value}, while the chaser moves at "
                    f"{linear:.4g} m/s and {angular:.4g} rad/s"
                )
                allowed = (
                    f"{error.allowed}; the end effector is at rest in the inertial frame: choose "
                    "one in which the chaser is slow, or give joints.velocity"
                )
                return InvalidInput(error.status, "joints.end_effector_at_rest", told, allowed)
            if seconds:
                unit = robot.unit(joint) + per_time
                told = f"{error.value}, measured as {value:.6f} {unit} {seconds:.3f} s before"
                return InvalidInput(error.status, error.field, told, error.allowed)
    return error


def _steps(
    robot: Robot, q: Array, momentum: Array, joints: JointMotion, begin: float, end: float
) -> Array:
    """Return the times of the integration: the motion's points, and as many between as needed."""
    inside = joints.time[(begin < joints.time) & (joints.time < end)]
    ends = np.array([begin, *inside, end])
    _, rates, _ = joints.at(np.concatenate([ends, (ends[:-1] + ends[1:]) / 2]))
    twist = base_twist(robot, robot.model.createData(), q, momentum, rates[0])
    # The arm's motion adds less to the chaser's rotation than its joints rotate.
    chaser, arm = float(np.linalg.norm(twist[3:])), float(np.abs(rates).max(axis=0).sum())
    fastest = chaser + arm
    _require_foretold(chaser, arm, end - begin)
    times = [ends[:1]]
    for a, b in pairwise(ends.tolist()):
        steps = max(1, int(np.ceil((b - a) * fastest / _STEP_TURN)))
        times.append(np.linspace(a, b, steps + 1)[1:])
    return np.concatenate(times)


def _require_foretold(chaser: float, arm: float, seconds: float) -> None:
    """Refuse a prediction over too large a rotation, by the sum of angular rates [rad/s]."""
    turns = (chaser + arm) * seconds
    if not turns <= MOST_TURNS:
        field = "chaser.angular_velocity" if chaser > arm else "joints.velocity"
        raise InvalidInput(
            Status.OUT_OF_RANGE,
            field,
            f"{max(chaser, arm):.6g} rad/s",
            f"within {seconds:.6g} s until the plan begins it turns too far to be foretold, by "
            f"{turns:.3g} rad; {MOST_TURNS:g} rad are allowed",
        )
