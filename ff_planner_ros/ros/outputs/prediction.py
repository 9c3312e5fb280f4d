"""Poses that a plan predicts for chaser, end effector and target, and tracking errors."""

from __future__ import annotations

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
from ff_planner_ros.planning.motion.plan import Trajectory, WheelMotion
from ff_planner_ros.planning.motion.pose_motion import cubics_between
from ff_planner_ros.planning.task.captured import CapturedBody
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.messages.to_messages import pose_message, time_message

# The frame_id of poses in the frame of the target body's grasp.
GRASP_FRAME = "target_grasp"


class FramePose(NamedTuple):
    """Pose of a frame in the inertial frame."""

    position: Array  # of its origin, shape (3,) [m]
    rotation: Rotation  # its axes to inertial axes


class TrackingError(NamedTuple):
    """Difference between a frame's predicted and its measured pose."""

    position: float  # distance of the origins [m]
    angle: float  # of the rotation between the two attitudes [rad]


def predicted_pose(
    trajectory: Trajectory, frame: Literal["chaser", "ee"], time: float
) -> FramePose | None:
    """Return a frame's predicted pose at a time from the start [s]; None outside the plan."""
    times = trajectory.time
    if not times[0] <= time <= times[-1]:
        return None
    before = min(int(np.searchsorted(times, time, side="right")) - 1, len(times) - 2)
    (position,), (quaternion,) = planned_poses(
        trajectory, frame, np.array([time]), slice(before, before + 2)
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


def tracking_error(
    trajectory: Trajectory, start_ns: int, measured: SystemState, measured_ns: int
) -> TrackingError | None:
    """Return the error of a chaser measured at measured_ns [ns]; None outside the plan."""
    predicted = predicted_pose(trajectory, "chaser", (measured_ns - start_ns) / NANOSECONDS)
    if predicted is None:
        return None
    attitude = Rotation.from_quat(measured.quaternion_chaser_to_inertial_xyzw)
    return difference(predicted, FramePose(measured.position_chaser_in_inertial, attitude))


def difference(predicted: FramePose, found: FramePose) -> TrackingError:
    """Return distance and rotation angle between a predicted and a found pose."""
    distance = float(np.linalg.norm(found.position - predicted.position))
    return TrackingError(distance, float((predicted.rotation.inv() * found.rotation).magnitude()))


def _fixed_to(frame: FramePose, place: pin.SE3) -> FramePose:
    """Return the pose of a frame whose pose in another frame is `place`."""
    position = frame.position + frame.rotation.apply(place.translation.copy())
    return FramePose(position, frame.rotation * Rotation.from_matrix(place.rotation))
