"""Laws of others that move the joints: resolved velocities, springs, and servos on a circle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.gallery.motions import Law, Torques, at_start, by_torques, ee_pose
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import arm_jacobian, generalised_jacobian, momentum_maps

# Of a time [s]: position, rotation matrix, linear and angular velocity that the end effector
# should have, inertial axes.
Reference: TypeAlias = Callable[[float], tuple[Array, Array, Array, Array]]

# Of space-robot-dq: damping, gain of errors and of the posture in the null space [1/s].
_DAMPING, _GAIN, _TO_POSTURE = 1e-6, 1.0, 0.5


def resolved(
    robot: Robot, joints: Array, reference: Reference, position_only: bool, fixed_base: bool
) -> Law:
    """Return the resolved-rate law of space-robot-dq.

    Args:
        joints: Posture that the null space goes back to, if only the position counts.
        fixed_base: Whether the law believes that the base does not move.
    """
    jacobian, data = arm_jacobian if fixed_base else generalised_jacobian, robot.model.createData()

    def law(time: float, q: Array) -> Array:
        position, attitude, linear, angular = reference(time)
        there = ee_pose(robot, q)
        of_rates = jacobian(robot, data, q)
        off = Rotation.from_matrix(attitude @ there.rotation.T).as_rotvec()
        twist = np.concatenate(
            [linear + _GAIN * (position - there.translation), angular + _GAIN * off]
        )
        if position_only:
            of_rates, twist = of_rates[:3], twist[:3]
        inverse = _damped(of_rates, _DAMPING)
        rates = inverse @ twist
        if position_only:
            rates += _TO_POSTURE * (joints - q[7:]) - inverse @ (
                of_rates @ (_TO_POSTURE * (joints - q[7:]))
            )
        return np.asarray(rates, np.float64)

    return law


def _damped(matrix: Array, damping: float) -> Array:
    """Return the damped inverse A^T (A A^T + damping)^-1."""
    rows = len(matrix)
    inverse: Array = matrix.T @ np.linalg.inv(matrix @ matrix.T + damping * np.eye(rows))
    return inverse


def springs(
    reference: Callable[[float], tuple[Array, Array]], stiffness: float, damping: float
) -> Torques:
    """Return torques that hold the joints at a reference's positions and velocities."""

    def torques(time: float, q: Array, v: Array) -> Array:
        positions, rates = reference(time)
        held: Array = stiffness * (positions - q[7:]) + damping * (rates - v[6:])
        return held

    return torques


def smoothed_bang_bang(
    goals: Array, accelerations: Array, smoothing: float
) -> Callable[[float], tuple[Array, Array]]:
    """Return positions and velocities from zero to the goals, as Basilisk's profiler has them.

    The acceleration rises to its largest value in the time of smoothing, as 3 s^2 - 2 s^3, stays
    there for a time b, falls likewise to the opposite value in twice that time, stays there for b,
    and rises to zero: a way of a (b^2 + 3 b s + 2.1 s^2) with acceleration a and smoothing s.

    Args:
        goals: Shape (joints,) [rad].
        accelerations: Largest of each joint. Shape (joints,) [rad/s2].
        smoothing: In seconds.
    """
    way, most = np.abs(goals), accelerations
    bang = (-3.0 * smoothing + np.sqrt(0.6 * smoothing**2 + 4.0 * way / most)) / 2.0
    still = np.zeros_like(bang)
    # Durations of the pieces, and the accelerations at their ends
    pieces = (
        (still + smoothing, still, most),
        (bang, most, most),
        (still + 2.0 * smoothing, most, -most),
        (bang, -most, -most),
        (still + smoothing, -most, still),
    )

    def profile(time: float) -> tuple[Array, Array]:
        position, rate, begin = still, still, still
        for duration, first, last in pieces:
            inside = np.clip(time - begin, 0.0, duration)
            u = inside / duration
            change = last - first
            position = position + rate * inside + first * inside**2 / 2
            position = position + change * duration**2 * (u**4 / 4 - u**5 / 10)
            rate = rate + first * inside + change * duration * (u**3 - u**4 / 2)
            begin = begin + duration
        return np.sign(goals) * position, np.sign(goals) * rate

    return profile


# Of reactionless-compliance: gain of errors [1/s], largest velocity [rad/s], damping of least
# squares, weight of the task, gain of the base's attitude and of the posture [1/s], distance from
# limits at which joints are locked [rad]; servos [N m s/rad], motors [kg m2], time of control [s].
_ERROR_GAIN, _FASTEST, _LEAST_SQUARES = 4.0, 2.0, 0.02
_TASK, _ATTITUDE, _POSTURE, _MARGIN = 100.0, 5.0, 1.0, 0.05
_SERVO, _MOTOR, _CONTROL = 150.0, 0.5, 0.01
_RADIUS, _LOOP = 0.1, 15.0  # m, s
CIRCLE_DURATION = 2 * _LOOP


@dataclass(frozen=True)
class OnCircle:
    """What became of a law on the circle."""

    peak: float  # largest rotation of the base in the two loops [deg]
    turn: float  # a second later [deg]
    position_error: float  # root of the mean square in the two loops [m]


def circle(begin: Array, time: float) -> tuple[Array, Array]:
    """Return position and velocity on the circle of reactionless-compliance [m, m/s]."""
    s = min(time, CIRCLE_DURATION) / CIRCLE_DURATION
    angle = 2 * np.pi * (CIRCLE_DURATION / _LOOP) * s * s * (3 - 2 * s)
    rate = 2 * np.pi / _LOOP * 6 * s * (1 - s)
    out = np.array([1 - np.cos(angle), 0.0, np.sin(angle)])
    return begin + _RADIUS * out, _RADIUS * rate * np.array([np.sin(angle), 0.0, np.cos(angle)])


def on_circle(robot: Robot, joints: Array, spares_base: bool, step: float) -> OnCircle:
    """Move along the circle, position only, by one of two laws with servos.

    Args:
        spares_base: Whether the law is impedance with reaction null space; else damped least
            squares.
        step: Of the integration [s]; a part of 10 ms.
    """
    model, data = robot.model, robot.model.createData()
    command, errors = np.zeros(robot.joints), list[float]()
    last, next_time = -1.0, 0.0
    start = ee_pose(robot, at_start(robot, joints)).translation.copy()

    def torques(time: float, q: Array, v: Array) -> Array:
        nonlocal command, last, next_time
        if time > last and time >= next_time - 1e-9:
            next_time, last = next_time + _CONTROL, time
            there = ee_pose(robot, q).translation
            position, velocity = circle(start, time)
            errors.append(float(np.linalg.norm(position - there)))
            wanted = velocity + _ERROR_GAIN * (position - there)
            jacobian = generalised_jacobian(robot, data, q)[:3]
            maps = momentum_maps(robot, data, q[None])[0]
            of_base = -np.linalg.solve(maps[:, :6], maps[:, 6:])[3:]
            turned = Rotation.from_quat(q[3:7]).as_rotvec()
            solve = _sparing if spares_base else _least_squares
            rates = _within_limits(
                robot, q[7:], jacobian, of_base, lambda j, w: solve(j, w, wanted, turned, q, joints)
            )
            command = rates / max(1.0, float(np.abs(rates).max()) / _FASTEST)
        servo: Array = _SERVO * (command - v[6:])
        return servo

    armature = model.armature.copy()
    model.armature[6:] = _MOTOR
    try:
        moved = by_torques(robot, joints, torques, CIRCLE_DURATION + 1.0, step)
    finally:
        model.armature[:] = armature
    turns = np.linalg.norm(moved.turns, axis=1)
    loops = moved.time <= CIRCLE_DURATION + 1e-9
    count = round(CIRCLE_DURATION / _CONTROL) + 1
    mean = float(np.sqrt(np.mean(np.square(errors[:count]))))
    return OnCircle(float(turns[loops].max()), float(turns[-1]), mean)


def _least_squares(jacobian: Array, _w: Array, wanted: Array, *_: Array) -> Array:
    rates: Array = _damped(jacobian, _LEAST_SQUARES**2) @ wanted
    return rates


def _sparing(
    jacobian: Array, of_base: Array, wanted: Array, turned: Array, q: Array, rest: Array
) -> Array:
    rows = np.vstack([_TASK * jacobian, of_base])
    inverse = _damped(rows, 1e-6)
    spare = -_POSTURE * (q[7:] - rest)
    asked = np.concatenate([_TASK * wanted, -_ATTITUDE * turned])
    rates: Array = inverse @ asked + spare - inverse @ (rows @ spare)
    return rates


def _within_limits(
    robot: Robot,
    positions: Array,
    jacobian: Array,
    of_base: Array,
    solve: Callable[[Array, Array], Array],
) -> Array:
    """Lock joints that are at a limit and would move beyond it, and solve again."""
    free = np.ones(robot.joints)
    while True:
        rates = free * solve(jacobian * free, of_base * free)
        high = (positions >= robot.upper_position_limits - _MARGIN) & (rates > 0.0)
        low = (positions <= robot.lower_position_limits + _MARGIN) & (rates < 0.0)
        if not (high | low).any():
            return rates
        free = np.where(high | low, 0.0, free)
