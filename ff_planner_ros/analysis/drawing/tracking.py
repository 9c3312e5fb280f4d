"""Deviations of a measured motion from its plan, at the time of every measurement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from ff_planner_ros.analysis.drawing.panels import Panel
from ff_planner_ros.analysis.methods import DEVIATION
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.motion import chaser_motion
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.motion.pose_motion import poses_between
from ff_planner_ros.robot.configuration import configuration, without_turns
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.quaternion import (
    quaternion_inverse,
    quaternion_product,
    rotation_vector_from_quaternion,
)
from ff_planner_ros.robot.state import SystemState


@dataclass(frozen=True, eq=False)
class Deviations:
    """Magnitudes of the differences between a measured and a planned motion."""

    time: Array  # of the measurements, from the start of the plan. Shape (times,) [s]
    chaser_position: Array  # distance of the centres of mass. Shape (times,) [m]
    chaser_angle: Array  # rotation angle between the attitudes. Shape (times,) [rad]
    ee_position: Array  # distance. Shape (times,) [m]
    ee_angle: Array  # rotation angle between the orientations. Shape (times,) [rad]
    joint_position: Array  # largest of all joints, weighted. Shape (times,) [rad]
    joint_velocity: Array  # largest of all joints, weighted. Shape (times,) [rad/s]


def measured_motion(robot: Robot, time: Array, states: list[SystemState]) -> Trajectory:
    """Return states measured at `time`, (times,) [s]; accelerations and torques are NaN."""
    model, data, tip = robot.model, robot.model.createData(), robot.tip_frame_id
    poses, twists = np.empty((len(states), 7)), np.empty((len(states), 6))
    for k, state in enumerate(states):
        pin.forwardKinematics(model, data, *configuration(robot, state))
        poses[k] = pin.SE3ToXYZQUAT(pin.updateFramePlacement(model, data, tip))
        twists[k] = pin.getFrameVelocity(model, data, tip, pin.LOCAL_WORLD_ALIGNED).vector
    joint_positions = np.array([state.joint_positions for state in states])
    not_known = np.full(joint_positions.shape, np.nan)
    return Trajectory(
        time=time,
        joint_positions=joint_positions,
        joint_velocities=np.array([state.joint_velocities for state in states]),
        joint_accelerations=not_known,
        joint_torques=not_known,
        **chaser_motion(states),
        ee_positions=poses[:, :3],
        ee_quaternions_xyzw=poses[:, 3:],
        ee_linear_velocities=twists[:, :3],
        ee_angular_velocities=twists[:, 3:],
    )


def deviations(
    planned: Trajectory,
    measured: Trajectory,
    weights: Array | float = 1.0,
    continuous: Sequence[bool] | bool = False,
) -> Deviations:
    """Return the deviations of a measured motion from the plan, interpolated at its times.

    Args:
        weights: `Robot.joint_weights`, shape (joints,): 1, or rad/m for prismatic joints.
        continuous: `Robot.continuous`: a joint is where it was a turn ago.
    """
    time = measured.time
    chaser, chaser_attitude = planned_poses(planned, "chaser", time)
    ee, ee_orientation = planned_poses(planned, "ee", time)
    positions, velocities, _ = joint_motion(planned).at(time)
    aside = without_turns(measured.joint_positions - positions, continuous)
    return Deviations(
        time=time,
        chaser_position=np.linalg.norm(measured.chaser_positions - chaser, axis=1),
        chaser_angle=_turn(chaser_attitude, measured.chaser_quaternions_xyzw),
        ee_position=np.linalg.norm(measured.ee_positions - ee, axis=1),
        ee_angle=_turn(ee_orientation, measured.ee_quaternions_xyzw),
        joint_position=np.abs(weights * aside).max(axis=1),
        joint_velocity=np.abs(weights * (measured.joint_velocities - velocities)).max(axis=1),
    )


def planned_poses(
    planned: Trajectory,
    frame: Literal["chaser", "ee"],
    at: Array,
    points: slice = slice(None),
) -> tuple[Array, Array]:
    """Return the inertial poses of a frame at some times, also between the plan's points.

    Args:
        at: Times since the start of the plan, within it. Shape (times,) [s].
        points: The plan's points around these times, to save work.

    Returns:
        Positions, shape (times, 3) [m], and quaternions to inertial axes, shape (times, 4).
    """
    parts = ("positions", "quaternions_xyzw", "linear_velocities", "angular_velocities")
    x, q, v, omega = (getattr(planned, f"{frame}_{part}")[points] for part in parts)
    return poses_between(planned.time[points], x, q, v, omega, at)


def in_shown_units(found: Deviations) -> list[tuple[str, Array]]:
    """Return label and values of each deviation, in mm, deg and deg/s."""
    return [
        ("chaser [mm]", 1e3 * found.chaser_position),
        ("chaser [deg]", np.rad2deg(found.chaser_angle)),
        ("end effector [mm]", 1e3 * found.ee_position),
        ("end effector [deg]", np.rad2deg(found.ee_angle)),
        ("worst joint [deg]", np.rad2deg(found.joint_position)),
        ("worst joint [deg/s]", np.rad2deg(found.joint_velocity)),
    ]


def deviation_panels(found: Deviations, rows: slice | Array = slice(None)) -> list[Panel]:
    """Return a panel for each deviation."""
    shown, time = in_shown_units(found), found.time[rows]
    return [Panel(label, {DEVIATION: (time, values[rows])}) for label, values in shown]


def _turn(planned_xyzw: Array, measured_xyzw: Array) -> Array:
    turn = quaternion_product(quaternion_inverse(planned_xyzw), measured_xyzw)
    angle: Array = np.linalg.norm(rotation_vector_from_quaternion(turn), axis=1)
    return angle
