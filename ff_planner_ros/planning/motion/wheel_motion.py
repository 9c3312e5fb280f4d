"""Momenta and torques of the wheels that hold a chaser's attitude along a motion.

See `robot.wheels`. Angular momenta are those of Pinocchio's centroidal algorithms. The search,
which needs derivatives, computes its own by inverse dynamics.
"""

from __future__ import annotations

from typing import NamedTuple

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.followed import FollowedMotion, Peaks, peaks_of_steps
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import angular_momenta
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.robot.wheels import Wheels, momenta_of


class WheelPeaks(NamedTuple):
    """The largest momentum and torque of each wheel."""

    momenta: Peaks  # [N m s]
    torques: Peaks  # [N m]
    first: tuple[Array, Array]  # momenta and torques at the first time, each of shape (wheels,)


def wheel_peaks(
    robot: Robot, wheels: Wheels, start: SystemState, motion: FollowedMotion
) -> WheelPeaks:
    """Return the peak momentum and torque of each wheel along a motion, between its points too."""
    _, _, accelerations = motion.joints.at(motion.time)
    stored = momenta_of(wheels, start)
    loads = wheels_along(robot, wheels, stored, motion.q, motion.v, accelerations)
    return peaks_of_wheels(*loads, motion)


def peaks_of_wheels(momenta: Array, torques: Array, motion: FollowedMotion) -> WheelPeaks:
    """Return the peaks of momenta [N m s] and torques [N m] at each step of a motion."""
    of_momenta, of_torques = (peaks_of_steps(loads, motion) for loads in (momenta, torques))
    return WheelPeaks(of_momenta, of_torques, (momenta[0], torques[0]))


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
