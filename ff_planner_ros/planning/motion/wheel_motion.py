"""Momenta and torques of the wheels that hold a chaser's attitude along a motion.

See `robot.wheels`. Angular momenta are those of Pinocchio's centroidal algorithms. The search,
which needs derivatives, computes its own by inverse dynamics.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.followed import FollowedMotion, Peaks, peaks_of_steps
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import angular_momenta, angular_momentum_bounds
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.robot.wheels import Wheels, momenta_of

# Half of the fraction of its limits by which a plan may exceed them.
_GAP = 5e-5
# Into so many parts an interval is divided: with two it takes more rounds, and more time.
_PARTS = 4
# Pieces that are looked at: a motion that needs more, no joint makes, and the bound is higher.
_MOST_PIECES = 1 << 16
_TINY = np.finfo(np.float64).tiny


class WheelPeaks(NamedTuple):
    """The largest momentum and torque of each wheel."""

    momenta: Peaks  # [N m s]
    torques: Peaks  # [N m]
    # At the times of the motion, each of shape (times, wheels)
    along: tuple[Array, Array]


def wheel_peaks(
    robot: Robot, wheels: Wheels, start: SystemState, motion: FollowedMotion
) -> WheelPeaks:
    """Return the peak momentum and torque of each wheel along a motion, between its points too."""
    stored, accelerations = momenta_of(wheels, start), motion.joint_accelerations
    loads = wheels_along(robot, wheels, stored, motion.q, motion.v, accelerations)
    return peaks_of_wheels(*loads, motion)


def peaks_of_wheels(momenta: Array, torques: Array, motion: FollowedMotion) -> WheelPeaks:
    """Return the peaks of momenta [N m s] and torques [N m] at each step of a motion."""
    of_momenta, of_torques = (peaks_of_steps(loads, motion) for loads in (momenta, torques))
    return WheelPeaks(of_momenta, of_torques, (momenta, torques))


def certain_peaks(
    robot: Robot, wheels: Wheels, motion: FollowedMotion, found: WheelPeaks, allowed: Array
) -> Array:
    """Return what no load ever exceeds, as far as it takes to tell whether that is allowed.

    Between two times a load with a bounded second derivative is nowhere above the line through both
    values and the parabola of that second derivative that is zero at both times. Intervals that
    this does not decide are divided.

    Args:
        found: Of the motion.
        allowed: Momenta [N m s], then torques [N m], of all wheels. Shape (2 wheels,).

    Returns:
        Less than what is allowed, or at most `_GAP` of it above the highest values found, or more
        where the motion is too fast to tell. Shape (2 wheels,).
    """
    stored, sizes = found.along[0][0], np.linalg.norm(wheels.shares, axis=1)
    _, _, bend, bend_of_torques = angular_momentum_bounds(robot, motion.joints.largest(5))
    of_pieces = np.hstack([np.outer(bend, sizes), np.outer(bend_of_torques, sizes)]) / 2
    bends = np.repeat(of_pieces, motion.pieces, axis=0)

    def loads_at(times: Array) -> Array:
        positions, rates, accelerations = motion.joints.at(times)
        q, v = np.tile(motion.q[0], (len(times), 1)), np.zeros((len(times), motion.v.shape[1]))
        q[:, 7:], v[:, 6:] = positions, rates
        loads: Array = np.hstack(wheels_along(robot, wheels, stored, q, v, accelerations))
        return loads

    known = np.hstack(found.along)
    certain: Array = np.abs(known).max(axis=0)
    begin, step, loads = motion.time[:-1], np.diff(motion.time), (known[:-1], known[1:])
    looked = 0
    while True:
        bent, change = step[:, None] ** 2 * bends, np.abs(loads[1] - loads[0])
        rise = np.maximum(bent - change, 0.0) ** 2 / (4 * np.maximum(bent, _TINY))
        highest = np.abs(loads).max(axis=0) + rise
        is_open = ((highest > allowed) & (bent / 4 > _GAP * allowed)).any(axis=1)
        is_open, looked = is_open & (looked < _MOST_PIECES), looked + len(begin)
        certain = np.maximum(certain, highest[~is_open].max(axis=0, initial=0.0))
        if not is_open.any():
            return certain
        step = step[is_open] / _PARTS
        begins = begin[is_open] + np.outer(np.arange(_PARTS), step)
        inside = loads_at(np.append(motion.time[0], begins[1:]))[1:].reshape(
            _PARTS - 1, len(step), -1
        )
        every = np.concatenate([loads[0][None, is_open], inside, loads[1][None, is_open]])
        begin, step = begins.ravel(), np.tile(step, _PARTS)
        bends = np.tile(bends[is_open], (_PARTS, 1))
        loads = every[:-1].reshape(len(begin), -1), every[1:].reshape(len(begin), -1)


def wheels_along(
    robot: Robot, wheels: Wheels, stored: Array, q: Array, v: Array, accelerations: Array
) -> tuple[Array, Array]:
    """Return momenta [N m s] and torques [N m] of the wheels, each of shape (times, wheels).

    Args:
        stored: Momenta at the first time. Shape (wheels,) [N m s].
        q: Configurations. Shape (times, 7 + joints).
        v: Tangent velocities. Shape (times, 6 + joints).
        accelerations: Of the joints. Shape (times, joints) [rad/s2, m/s2].
    """
    parts, rates = angular_momenta(robot, q, v, accelerations)
    momenta = stored + (parts[0] - parts) @ wheels.shares.T
    return momenta, -rates @ wheels.shares.T
