"""Forward kinematics of the arm for many configurations at once.

Pinocchio's takes one configuration a call: reading every joint's origin from it costs more than
following the chain here, in one go for all points of a motion.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.kept_with import kept_with_it
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.quaternion import rotation_from_quaternion


def joint_rotations(robot: Robot, angles: Array) -> Array:
    """Return the rotation of each joint's frame to that of the body before, by Rodrigues' formula.

    R = P (I + sin K + (1 - cos) K^2), with the joint's own placement P and the cross-product matrix
    K of its axis, which is zero for prismatic joints.

    Args:
        angles: Positions of all joints; those of prismatic joints do not matter. Shape
            (points, all) [rad].

    Returns:
        Shape (points, all, 3, 3).
    """
    held, once, twice = _turning(robot)
    sine, versine = np.sin(angles)[..., None, None], 1.0 - np.cos(angles)[..., None, None]
    turned: Array = held + sine * once + versine * twice
    return turned


def joint_frames(robot: Robot, q: Array) -> tuple[Array, Array]:
    """Return the frames of bodies from base to tip, and the end effector's origin, inertial frame.

    Args:
        q: Configurations. Shape (points, 7 + joints).

    Returns:
        Rotations of the base and of every joint there, shape (joints + 1, points, 3, 3), and
        origins of these joints and of the end effector, shape (points, joints + 1, 3) [m].
    """
    way, positions = robot.tree.to_tip, robot.tree.positions(q[:, 7:])
    rotations = np.empty((len(way) + 1, len(q), 3, 3))
    rotations[0] = rotation_base_to_inertial(q)
    turned = joint_rotations(robot, positions)
    for number, k in enumerate(way):
        np.matmul(rotations[number], turned[:, k], out=rotations[number + 1])
    steps = np.einsum("kpij,kj->pki", rotations, joint_offsets(robot))
    if robot.tree.slides.any():
        slid = positions[:, way, None] * robot.tree.slides[way]
        steps[:, :-1] += np.einsum("kpij,pkj->pki", rotations[1:], slid)
    origins: Array = q[:, None, :3] + np.cumsum(steps, axis=1)
    return rotations, origins


@kept_with_it
def joint_offsets(robot: Robot) -> Array:
    """Return the origins of the joints to the tip, then the end effector's, in the frame before.

    Prismatic joints are at zero. Shape (joints + 1, 3) [m].
    """
    model = robot.model
    placements = [model.jointPlacements[2 + k] for k in robot.tree.to_tip]
    placements.append(model.frames[robot.tip_frame_id].placement)
    return np.array([placement.translation for placement in placements])


def arm_reach(robot: Robot) -> float:
    """Return the arm's length, stretched out: of all links from the first joint to the end [m]."""
    lengths = sum(float(np.linalg.norm(offset)) for offset in joint_offsets(robot)[1:])
    return lengths + float(robot.furthest_slides[robot.tree.to_tip].sum())


def rotation_base_to_inertial(q: Array) -> Array:
    """Return the rotation from base to inertial axes at each configuration. Shape (..., 3, 3)."""
    return rotation_from_quaternion(q[:, 3:7])


@kept_with_it
def _turning(robot: Robot) -> tuple[Array, Array, Array]:
    """Return P, P K and P K^2 of each joint; see `joint_rotations`."""
    held = np.array([placement.rotation for placement in robot.model.jointPlacements[2:]])
    axis = np.array([pin.skew(axis) for axis in robot.tree.axes])
    return held, held @ axis, held @ axis @ axis
