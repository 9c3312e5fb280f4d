"""What the wheels that hold a chaser's attitude take up along a motion; see `robot.wheels`.

Angular momenta are those of Pinocchio's centroidal algorithms. The search, which needs derivatives,
takes its own from inverse dynamics.
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
    first: tuple[Array, Array]  # both at the first time, each of shape (wheels,)


def wheel_peaks(
    robot: Robot, wheels: Wheels, start: SystemState, motion: FollowedMotion
) -> WheelPeaks:
    """Return the peaks of each wheel along a motion, between its points too."""
    _, _, accelerations = motion.joints.at(motion.time)
    stored = momenta_of(wheels, start)
    momenta, torques = wheels_along(robot, wheels, stored, motion.q, motion.v, accelerations)
    first = momenta[0], torques[0]
    return WheelPeaks(peaks_of_steps(momenta, motion), peaks_of_steps(torques, motion), first)


def wheels_along(
    robot: Robot, wheels: Wheels, stored: Array, q: Array, v: Array, accelerations: Array
) -> tuple[Array, Array]:
    """Return momenta [N m s] and torques [N m] of the wheels. Each of shape (times, wheels).

    Args:
        stored: What they hold at the first time. Shape (wheels,) [N m s].
        accelerations: Of the joints. Shape (times, joints) [rad/s2].
    """
    parts, rates = angular_momenta(robot, q, v, accelerations)
    momenta = stored + (parts[0] - parts) @ wheels.shares.T
    return momenta, -rates @ wheels.shares.T
