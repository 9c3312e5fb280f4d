"""The motion of the joints between the points of a trajectory, as a controller makes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BPoly

from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.plan import Trajectory


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Joints on the quintics through positions, velocities and accelerations.

    This is how ROS's `joint_trajectory_controller` interpolates a trajectory that has all three.
    """

    time: Array  # strictly increasing, two or more; shape (points,) [s]
    positions: Array  # shape (points, joints) [rad]
    velocities: Array  # shape (points, joints) [rad/s]
    accelerations: Array  # shape (points, joints) [rad/s2]

    def at(self, time: Array) -> tuple[Array, Array, Array]:
        """Return positions, velocities and accelerations, each of shape (times, joints).

        Before the first and after the last point their quintics go on.
        """
        of_time = zip(self.positions, self.velocities, self.accelerations, strict=True)
        quintics = BPoly.from_derivatives(self.time, list(of_time))
        return quintics(time), quintics(time, 1), quintics(time, 2)


def joint_motion(trajectory: Trajectory, start: float = 0.0) -> JointMotion:
    """Return the motion that a controller makes of a trajectory; it begins at `start` [s]."""
    return JointMotion(
        start + trajectory.time,
        trajectory.joint_positions,
        trajectory.joint_velocities,
        trajectory.joint_accelerations,
    )


def steady_motion(begin: float, end: float, positions: Array, rates: Array) -> JointMotion:
    """Return the motion at constant rates [rad/s] from some positions [rad] on.

    It lasts from `begin` to `end` [s], and for a second at least.
    """
    # Quintics neither go far beyond their points nor have room between two at nearly one time.
    span, none = max(end - begin, 1.0), np.zeros((2, len(rates)))
    return JointMotion(
        np.array([begin, begin + span]),
        np.array([positions, positions + span * rates]),
        none + rates,
        none,
    )
