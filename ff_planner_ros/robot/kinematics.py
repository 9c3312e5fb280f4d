"""Where the joints are and which way they turn, for many configurations at once.

Pinocchio's forward kinematics takes one configuration a call. Reading every joint's origin from
it costs more than to follow the chain here, in one go for all points of a motion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.arrays import Array
from ff_planner_ros.robot.model import Robot


class ArmKinematics(NamedTuple):
    """The chain of joints in the inertial frame."""

    points: Array  # joint origins, then the end effector; shape (configurations, joints + 1, 3) [m]
    axes: Array  # of the joints, unit length; shape (configurations, joints, 3)
    rotation_base_to_inertial: Array  # shape (configurations, 3, 3)


def arm_kinematics(robot: Robot, q: Array) -> ArmKinematics:
    """Follow the chain from the base to the end effector; q: shape (configurations, 7 + joints)."""
    model, tip = robot.model, robot.model.frames[robot.tip_frame_id]
    points = np.empty((len(q), robot.joints + 1, 3))
    axes = np.empty((len(q), robot.joints, 3))
    turns = Rotation.from_rotvec((q[:, 7:, None] * robot.joint_axes).reshape(-1, 3))
    turn = turns.as_matrix().reshape(len(q), robot.joints, 3, 3)
    base = rotation_base_to_inertial(q)
    position, rotation = q[:, :3], base
    for k, placement in enumerate(model.jointPlacements[2:]):
        position = position + rotation @ placement.translation
        points[:, k] = position
        rotation = rotation @ placement.rotation
        axes[:, k] = rotation @ robot.joint_axes[k]
        rotation = rotation @ turn[:, k]
    points[:, -1] = position + rotation @ tip.placement.translation
    return ArmKinematics(points, axes, base)


def rotation_base_to_inertial(q: Array) -> Array:
    """Return the attitude of the base at each configuration. Shape (configurations, 3, 3)."""
    return np.asarray(Rotation.from_quat(q[:, 3:7]).as_matrix(), np.float64)
