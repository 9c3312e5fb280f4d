"""State from a testbed's own messages: odometry of a sensor on the chaser, and joint states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array, finite_vector, unit_quaternion
from ff_planner_ros.common.times import ROUNDING
from ff_planner_ros.parameters.interfaces import OdometryParameters
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.messages.from_messages import require_frame, xyz, xyzw
from ff_planner_ros.ros.messages.joint_names import joint_order, of_joints_in

if TYPE_CHECKING:
    from nav_msgs.msg import Odometry
    from sensor_msgs.msg import JointState

# Position, quaternion, linear and angular velocity; positions and velocities: see SystemState.
ChaserPart: TypeAlias = tuple[Array, Array, Array, Array]
JointPart: TypeAlias = tuple[Array, Array]


def chaser_from_odometry(
    message: Odometry, inertial_frame: str, parameters: OdometryParameters
) -> ChaserPart:
    """Read the motion of the chaser's centre of mass from that of a sensor fixed to the chaser.

    With r the sensor's position in the chaser frame, turned to inertial axes, and omega the
    angular velocity of the one rigid body that both belong to:
    p_chaser = p_sensor - r, v_chaser = v_sensor - omega x r.

    Args:
        message: Pose of the sensor in the inertial frame; its twist in axes of the sensor, as
            nav_msgs/Odometry defines it. The covariances are not looked at.
        inertial_frame: The only frame that the pose may be given in.
        parameters: The sensor's frame and where it is on the chaser.

    Returns:
        Position, quaternion, linear and angular velocity of the chaser in the inertial frame.

    Raises:
        InvalidInput: A field of the message cannot be used; the error names it.
    """
    require_frame("odometry.header.frame_id", message.header.frame_id, inertial_frame)
    require_frame("odometry.child_frame_id", message.child_frame_id, parameters.child_frame_id)
    pose, twist = message.pose.pose, message.twist.twist
    position_sensor = finite_vector("odometry.pose.pose.position", xyz(pose.position), 3)
    quaternion = unit_quaternion("odometry.pose.pose.orientation", xyzw(pose.orientation))
    linear = finite_vector("odometry.twist.twist.linear", xyz(twist.linear), 3)
    angular = finite_vector("odometry.twist.twist.angular", xyz(twist.angular), 3)

    sensor_to_inertial = Rotation.from_quat(quaternion)
    sensor_to_chaser = Rotation.from_quat(parameters.sensor_quaternion_in_chaser_xyzw)
    chaser_to_inertial = sensor_to_inertial * sensor_to_chaser.inv()
    omega = sensor_to_inertial.as_matrix() @ angular
    r = chaser_to_inertial.as_matrix() @ np.array(parameters.sensor_position_in_chaser)
    return (
        position_sensor - r,
        chaser_to_inertial.as_quat(),
        sensor_to_inertial.as_matrix() @ linear - np.cross(omega, r),
        omega,
    )


def joints_from_joint_state(message: JointState, robot: Robot) -> JointPart:
    """Return positions and velocities of the arm's joints, in the robot's order.

    The message may name joints in any order, and others than the arm's. What it says nothing of is
    NaN; of a part of the arm each controller may publish its own.

    Raises:
        InvalidInput: A field of the message cannot be used; the error names it.
    """
    named = [joint for joint, name in enumerate(robot.joint_names) if name in message.name]
    wanted = [robot.joint_names[joint] for joint in named] or robot.joint_names
    order = joint_order("joint_states.name", message.name, wanted, others_allowed=True)
    both = np.full((2, robot.joints), np.nan)
    for row, field in zip(both, ("position", "velocity"), strict=True):
        values = getattr(message, field)
        row[named] = of_joints_in(f"joint_states.{field}", values, order, len(message.name))
    return both[0], both[1]


def merged(parts: Sequence[JointPart]) -> JointPart:
    """Return positions and velocities of all joints, each from the first part that tells of it.

    What none of them tells of is NaN.
    """
    both = np.array(parts)
    joints = np.arange(both.shape[2])
    first = np.argmax(np.isfinite(both[:, 0]), axis=0)
    return both[first, 0, joints], both[first, 1, joints]


def is_pair(apart: float, synchronization: float) -> bool:
    """Return whether a chaser and joints measured `apart` seconds from each other make a state."""
    return apart <= synchronization + ROUNDING
