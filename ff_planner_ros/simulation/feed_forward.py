"""Joint torques between the points of a plan."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.forward import carried_base
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.robot.dynamics import joint_torques
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import total_momentum


class FeedForward(NamedTuple):
    """Torques to command, at the ends and in the middle of every step of an execution."""

    # From the start of the plan [s], shape (2 * steps + 1,); every point of the plan ends a step
    time: Array
    torques: Array  # shape (2 * steps + 1, joints) [N m]
    steps_per_point: int  # steps between two points of the plan


def feed_forward(robot: Robot, trajectory: Trajectory, steps_per_point: int) -> FeedForward:
    """Return the torques of a plan at its points and between them.

    Between two points each joint follows the quintic through both positions, velocities and
    accelerations, as ROS's `joint_trajectory_controller` lets it. The torques are those that this
    motion needs, so that it is back on the plan at every point. A spline through the torques alone
    (`torque_spline`) has small errors, but they add up over the motion; a light wrist shows it.

    At the points the torques are the plan's own. Where these differ from what the motion needs, the
    difference is interpolated linearly. For a sound plan it is rounding.
    """
    time = _half_steps(trajectory, steps_per_point)
    torques = _torques_of_motion(robot, trajectory, time)
    difference = trajectory.joint_torques - torques[:: 2 * steps_per_point]
    torques += np.array([np.interp(time, trajectory.time, joint) for joint in difference.T]).T
    return FeedForward(time, torques, steps_per_point)


def torque_spline(trajectory: Trajectory, steps_per_point: int) -> FeedForward:
    """Return the cubic spline through the torques at the points of a plan."""
    time = _half_steps(trajectory, steps_per_point)
    torques = CubicSpline(trajectory.time, trajectory.joint_torques)(time)
    return FeedForward(time, torques, steps_per_point)


def _half_steps(trajectory: Trajectory, steps_per_point: int) -> Array:
    points, half_steps = len(trajectory.time), 2 * steps_per_point
    return np.interp(
        np.arange(half_steps * (points - 1) + 1), half_steps * np.arange(points), trajectory.time
    )


def _torques_of_motion(robot: Robot, trajectory: Trajectory, time: Array) -> Array:
    """Return the torques that the motion between the points needs. Shape (times, joints)."""
    q, v = from_trajectory(robot, trajectory)
    momentum = total_momentum(robot, robot.model.createData(), q[0], v[0])
    joints = joint_motion(trajectory)
    _, _, accelerations = joints.at(time)
    return joint_torques(robot, *carried_base(robot, q[0], momentum, joints, time), accelerations)
