"""Where a plan has chaser, end effector, target and wheels, and how far the system is from it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

import numpy as np
import pinocchio as pin
from ff_planner_msgs.msg import WheelState
from geometry_msgs.msg import PoseStamped
from scipy.spatial.transform import Rotation
from std_msgs.msg import Header

from ff_planner_ros.analysis.drawing.tracking import planned_poses
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.parameters.published_plans import TrackingParameters
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.motion.plan import Trajectory, WheelMotion
from ff_planner_ros.planning.motion.pose_motion import cubics_between
from ff_planner_ros.planning.task.captured import CapturedBody
from ff_planner_ros.robot.configuration import without_turns
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.messages.to_messages import pose_message, time_message

# The frame_id of poses in the frame of the target body's grasp.
GRASP_FRAME = "target_grasp"
_POSES = "max_position", "max_angle", "max_joint_position"


class FramePose(NamedTuple):
    """Pose of a frame in the inertial frame."""

    position: Array  # of its origin, shape (3,) [m]
    rotation: Rotation  # its axes to inertial axes


class PoseError(NamedTuple):
    """Difference between a frame's predicted and its measured pose."""

    position: float  # distance of the origins [m]
    angle: float  # of the rotation between the two attitudes [rad]


class Deviation(NamedTuple):
    """How far one number of a system is from where a plan has it."""

    what: str
    tolerance: str  # field of `TrackingParameters` that limits it
    amount: float
    unit: str

    def words(self, allowed: TrackingParameters) -> str:
        """Return a phrase if the amount is more than allowed, or NaN; else an empty string."""
        limit: float = getattr(allowed, self.tolerance)
        if self.amount <= limit:
            return ""
        return (
            f"{self.what} by {self.amount:.3g} {self.unit}, more than tracking.{self.tolerance}, "
            f"{limit:g} {self.unit}"
        )


def predicted_pose(
    trajectory: Trajectory, frame: Literal["chaser", "ee"], time: float
) -> FramePose | None:
    """Return a frame's predicted pose at a time from the start [s]; None outside the plan."""
    times = trajectory.time
    if not times[0] <= time <= times[-1]:
        return None
    (position,), (quaternion,) = planned_poses(
        trajectory, frame, np.array([time]), _around(trajectory, time)
    )
    return FramePose(position, Rotation.from_quat(quaternion))


def predicted_chaser_pose(
    trajectory: Trajectory, start_ns: int, time_ns: int, inertial_frame: str
) -> PoseStamped | None:
    """Return the predicted pose at time_ns [ns], which becomes its stamp; None outside the plan."""
    pose = predicted_pose(trajectory, "chaser", (time_ns - start_ns) / NANOSECONDS)
    if pose is None:
        return None
    return PoseStamped(
        header=Header(stamp=time_message(time_ns), frame_id=inertial_frame),
        pose=pose_message(pose.position.tolist(), pose.rotation.as_quat().tolist()),
    )


def predicted_target(trajectory: Trajectory, time: float, captured: CapturedBody) -> FramePose:
    """Return the predicted pose of a target body's frame at a time from the plan's start [s]."""
    ee = None if time <= captured.held_from else predicted_pose(trajectory, "ee", time)
    if ee is None:
        there = captured.body.motion(np.zeros(3), np.array([time]))
        return FramePose(there.positions[0], Rotation.from_matrix(there.rotations[0]))
    return _fixed_to(ee, captured.place)


def predicted_relative_pose(
    trajectory: Trajectory, start_ns: int, time_ns: int, captured: CapturedBody
) -> PoseStamped | None:
    """Return the end effector's predicted pose in the grasp frame; None outside the plan.

    While the end effector holds the body, this pose is the identity.

    Args:
        time_ns: Time of the prediction, which becomes its stamp [ns].
    """
    time = (time_ns - start_ns) / NANOSECONDS
    ee = predicted_pose(trajectory, "ee", time)
    if ee is None:
        return None
    grasp = _fixed_to(predicted_target(trajectory, time, captured), captured.place.inverse())
    attitude = grasp.rotation.inv()
    way = attitude.apply(ee.position - grasp.position)
    return PoseStamped(
        header=Header(stamp=time_message(time_ns), frame_id=GRASP_FRAME),
        pose=pose_message(way.tolist(), (attitude * ee.rotation).as_quat().tolist()),
    )


def predicted_wheels(
    time_of_points: Array, wheels: WheelMotion, start_ns: int, time_ns: int, base_link: str
) -> WheelState | None:
    """Return the wheels' predicted momenta and torques; None outside the plan.

    Between two points a momentum follows the cubic Hermite spline whose slopes are the torques.

    Args:
        time_of_points: From the plan's first point on. Shape (points,) [s].
        time_ns: Time of the prediction, which becomes its stamp [ns].
    """
    time = (time_ns - start_ns) / NANOSECONDS
    if not time_of_points[0] <= time <= time_of_points[-1]:
        return None
    (momenta,), (torques,) = cubics_between(
        time_of_points, wheels.momenta, wheels.torques, np.array([time])
    )
    return WheelState(
        header=Header(stamp=time_message(time_ns), frame_id=base_link),
        momenta=momenta.tolist(),
        torques=torques.tolist(),
    )


def deviations(
    state: SystemState, motion: Trajectory, time: float, robot: Robot
) -> list[Deviation]:
    """Return how far a system is from where a plan has it at a time from its start [s].

    Empty outside the plan. The chaser's position and attitude come first, then its velocities, then
    position and rate of each joint. Between two points poses follow cubics, joints quintics, and
    the chaser's velocities the straight line.
    """
    pose = predicted_pose(motion, "chaser", time)
    if pose is None:
        return []
    points = _around(motion, time)
    part = (time - motion.time[points][0]) / np.ptp(motion.time[points])

    def between(rows: Array) -> Array:
        before, after = rows[points]
        found: Array = before + part * (after - before)
        return found

    attitude = Rotation.from_quat(state.quaternion_chaser_to_inertial_xyzw)
    off = difference(pose, FramePose(state.position_chaser_in_inertial, attitude))
    velocity = state.linear_velocity_chaser_in_inertial - between(motion.chaser_linear_velocities)
    turning = state.angular_velocity_chaser_in_inertial - between(motion.chaser_angular_velocities)
    joints = JointMotion(
        motion.time[points],
        motion.joint_positions[points],
        motion.joint_velocities[points],
        motion.joint_accelerations[points],
    )
    positions, rates, _ = joints.at(np.array([time]))
    aside = without_turns(state.joint_positions - positions[0], robot.continuous)
    found = [
        Deviation("the chaser's position", "max_position", off.position, "m"),
        Deviation("its attitude", "max_angle", off.angle, "rad"),
        Deviation("its velocity", "max_velocity", float(np.linalg.norm(velocity)), "m/s"),
        Deviation(
            "its angular velocity", "max_angular_velocity", float(np.linalg.norm(turning)), "rad/s"
        ),
    ]
    for what, tolerance, differences, unit in (
        ("position", "max_joint_position", aside, "rad"),
        ("rate", "max_joint_velocity", state.joint_velocities - rates[0], "rad/s"),
    ):
        amounts = np.abs(robot.joint_weights * differences).tolist()
        found += [
            Deviation(f"{name}'s {what}", tolerance, amount, unit)
            for name, amount in zip(robot.joint_names, amounts, strict=True)
        ]
    return found


def too_far(
    found: Iterable[Deviation], allowed: TrackingParameters, *, at_rates: bool = False
) -> str:
    """Return in words which deviations are more than allowed; empty: none is.

    Args:
        at_rates: Whether velocities and rates count, too, which are measured less well.
    """
    counted = (one for one in found if at_rates or one.tolerance in _POSES)
    return "; ".join(words for one in counted if (words := one.words(allowed)))


def difference(predicted: FramePose, found: FramePose) -> PoseError:
    """Return distance and rotation angle between a predicted and a found pose."""
    distance = float(np.linalg.norm(found.position - predicted.position))
    return PoseError(distance, float((predicted.rotation.inv() * found.rotation).magnitude()))


def _fixed_to(frame: FramePose, place: pin.SE3) -> FramePose:
    """Return the pose of a frame whose pose in another frame is `place`."""
    position = frame.position + frame.rotation.apply(place.translation.copy())
    return FramePose(position, frame.rotation * Rotation.from_matrix(place.rotation))


def _around(motion: Trajectory, time: float) -> slice:
    """Return the two points before and behind a time within a plan [s]."""
    before = int(np.searchsorted(motion.time, time, side="right")) - 1
    before = min(before, len(motion.time) - 2)
    return slice(before, before + 2)
