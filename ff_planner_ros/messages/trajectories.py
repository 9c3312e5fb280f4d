"""The trajectory in a plan message, from ROS or decoded from a bag, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.planning.motion.plan import Trajectory


def trajectory_in(plan: Any) -> Trajectory:
    """Return the trajectory in a plan message; a quantity that the message lacks is NaN.

    Raises:
        ValueError: Two arrays of the message differ in their number of points or joints.
    """
    joints = plan.joint_trajectory
    points, count = joints.points, len(joints.joint_names)

    def of_joints(name: str) -> Array:
        return table(f"joint {name}", [getattr(one, name) for one in points], len(points), count)

    chaser = poses_in(plan.chaser_path, len(points))
    chaser_twists = twists_in(plan.chaser_twists, len(points))
    ee = poses_in(plan.end_effector_path, len(points))
    ee_twists = twists_in(plan.end_effector_twists, len(points))
    return Trajectory(
        time=np.array([nanoseconds(point.time_from_start) / NANOSECONDS for point in points]),
        joint_positions=of_joints("positions"),
        joint_velocities=of_joints("velocities"),
        joint_accelerations=of_joints("accelerations"),
        joint_torques=of_joints("effort"),
        chaser_positions=chaser[:, :3],
        chaser_quaternions_xyzw=chaser[:, 3:],
        chaser_linear_velocities=chaser_twists[:, :3],
        chaser_angular_velocities=chaser_twists[:, 3:],
        ee_positions=ee[:, :3],
        ee_quaternions_xyzw=ee[:, 3:],
        ee_linear_velocities=ee_twists[:, :3],
        ee_angular_velocities=ee_twists[:, 3:],
    )


def trajectory_of(plans: Sequence[Any]) -> Trajectory:
    """Return the trajectory over the plans of all phases, one after the other.

    Raises:
        ValueError: Two arrays of a plan differ in their number of points or joints.
    """
    first, *others = map(trajectory_in, plans)
    for phase, motion in enumerate(others, start=1):
        first = first.followed_by(motion, begin_of(plans, phase))
    return first


def begin_of(plans: Sequence[Any], phase: int) -> float:
    """Return when a phase (0: the first) begins, from the first phase's first point on [s]."""
    begins = [nanoseconds(plans[k].joint_trajectory.header.stamp) for k in (0, phase)]
    return (begins[1] - begins[0]) / NANOSECONDS


def poses_in(path: Any, points: int) -> Array:
    """Return a path's poses, x y z [m] and quaternion x y z w. Shape (points, 7); NaN if empty."""
    poses = [stamped.pose for stamped in path.poses]
    rows = [[*_xyz(p.position), *_xyz(p.orientation), p.orientation.w] for p in poses]
    return table("poses", rows, points, 7)


def twists_in(twists: Any, points: int) -> Array:
    """Return twists, linear first. Shape (points, 6) [m/s, rad/s]; NaN if there are none."""
    rows = [[*_xyz(twist.linear), *_xyz(twist.angular)] for twist in twists]
    return table("twists", rows, points, 6)


def _xyz(vector: Any) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def table(name: str, rows: list[Any], points: int, width: int) -> Array:
    """Return rows as an array of shape (points, width); NaN if every row is empty.

    Args:
        name: What the rows are, for the error.

    Raises:
        ValueError: The rows have another number or width.
    """
    if not any(len(row) for row in rows):
        return np.full((points, width), np.nan)
    table = np.array(rows, dtype=np.float64)
    if table.shape != (points, width):
        raise ValueError(f"the shape of {name} is {table.shape}, not {(points, width)}")
    return table
