"""Conversion of motions between Pinocchio's configurations and trajectories."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.robot.dynamics import inverse_dynamics
from ff_planner_ros.robot.kinematics import rotation_base_to_inertial
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.quaternion import (
    canonical_quaternion,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from ff_planner_ros.robot.rotation import cross, euler_from_rotation
from ff_planner_ros.robot.state import SystemState


def to_trajectory(
    robot: Robot, time: Array, q: Array, v: Array, accelerations: Array
) -> Trajectory:
    """Return the trajectory of a motion, with torques by inverse dynamics.

    Args:
        time: Shape (points,) [s].
        q: Configurations. Shape (points, 7 + joints).
        v: Tangent velocities. Shape (points, 6 + joints).
        accelerations: dv/dt. Shape (points, 6 + joints).
    """
    model, data, tip = robot.model, robot.model.createData(), robot.tip_frame_id
    torques, ee_poses, ee_twists = [], [], []
    for q_i, v_i, acceleration in zip(q, v, accelerations, strict=True):
        torques.append(inverse_dynamics(robot, data, q_i, v_i, acceleration)[6:])
        pin.forwardKinematics(model, data, q_i, v_i)
        ee_poses.append(pin.SE3ToXYZQUAT(pin.updateFramePlacement(model, data, tip)))
        ee_twists.append(pin.getFrameVelocity(model, data, tip, pin.LOCAL_WORLD_ALIGNED).vector)
    poses, twists = np.array(ee_poses), np.array(ee_twists)
    return Trajectory(
        time=time,
        joint_positions=q[:, 7:],
        joint_velocities=v[:, 6:],
        joint_accelerations=accelerations[:, 6:],
        joint_torques=np.array(torques),
        **chaser_rows(robot, q, v),
        ee_positions=poses[:, :3],
        ee_quaternions_xyzw=poses[:, 3:],
        ee_linear_velocities=twists[:, :3],
        ee_angular_velocities=twists[:, 3:],
    )


def state_at(motion: Trajectory, point: int) -> SystemState:
    """Return the state of chaser and arm at a point of a motion, without wheel momenta."""
    return SystemState(
        position_chaser_in_inertial=motion.chaser_positions[point],
        quaternion_chaser_to_inertial_xyzw=motion.chaser_quaternions_xyzw[point],
        linear_velocity_chaser_in_inertial=motion.chaser_linear_velocities[point],
        angular_velocity_chaser_in_inertial=motion.chaser_angular_velocities[point],
        joint_positions=motion.joint_positions[point],
        joint_velocities=motion.joint_velocities[point],
        joint_accelerations=motion.joint_accelerations[point],
    )


def chaser_motion(states: Sequence[SystemState]) -> dict[str, Array]:
    """Return the chaser's arrays of a `Trajectory`, by field name, from the state at each point."""
    return {
        "chaser_positions": np.array([s.position_chaser_in_inertial for s in states]),
        "chaser_quaternions_xyzw": np.array([s.quaternion_chaser_to_inertial_xyzw for s in states]),
        "chaser_linear_velocities": np.array(
            [s.linear_velocity_chaser_in_inertial for s in states]
        ),
        "chaser_angular_velocities": np.array(
            [s.angular_velocity_chaser_in_inertial for s in states]
        ),
    }


def chaser_rows(robot: Robot, q: Array, v: Array) -> dict[str, Array]:
    """Return the arrays of `chaser_motion` from all configurations and velocities at once."""
    base_to_inertial = rotation_base_to_inertial(q)
    chaser_from_base = base_to_inertial @ robot.position_chaser_in_base
    omega = np.einsum("pij,pj->pi", base_to_inertial, v[:, 3:6])
    velocity_base = np.einsum("pij,pj->pi", base_to_inertial, v[:, :3])
    attitudes = base_to_inertial @ robot.rotation_chaser_to_base
    return {
        "chaser_positions": q[:, :3] + chaser_from_base,
        "chaser_quaternions_xyzw": canonical_quaternion(quaternion_from_rotation(attitudes)),
        "chaser_linear_velocities": velocity_base + cross(omega, chaser_from_base),
        "chaser_angular_velocities": omega,
    }


def from_trajectory(robot: Robot, trajectory: Trajectory) -> tuple[Array, Array]:
    """Return configurations, (points, 7 + joints), and tangent velocities, (points, 6 + joints).

    The inverse of `to_trajectory`.
    """
    motion = trajectory
    attitudes = rotation_from_quaternion(motion.chaser_quaternions_xyzw)
    base_to_inertial = attitudes @ robot.rotation_chaser_to_base.T
    base_from_chaser = -base_to_inertial @ robot.position_chaser_in_base
    omega = motion.chaser_angular_velocities
    velocity_base = motion.chaser_linear_velocities + cross(omega, base_from_chaser)
    q = np.hstack(
        [
            motion.chaser_positions + base_from_chaser,
            quaternion_from_rotation(base_to_inertial),
            motion.joint_positions,
        ]
    )
    v = np.hstack(
        [
            np.einsum("pji,pj->pi", base_to_inertial, velocity_base),
            np.einsum("pji,pj->pi", base_to_inertial, omega),
            motion.joint_velocities,
        ]
    )
    return q, v


def joint_path_length(joint_velocities: Array, step: float, weights: Array | float = 1.0) -> float:
    """Return J_L of Eq. (44) by the rectangle rule, all points but the last [rad].

    Args:
        joint_velocities: Shape (points, joints) [rad/s, m/s].
        step: Time between two points [s].
        weights: Weight of each joint. Shape (joints,).
    """
    shares = weights * joint_velocities[:-1]
    return float(np.linalg.norm(shares, axis=1).sum() * step)


def straight_way(ends: Array, weights: Array | float = 1.0) -> float:
    """Return the length of the straight joint path between two postures [rad].

    Args:
        ends: Both postures. Shape (2, joints) [rad, m].
        weights: Weight of each joint. Shape (joints,).
    """
    return float(np.linalg.norm(weights * (ends[1] - ends[0])))


def chaser_euler(robot: Robot, q: Array) -> Array:
    """Return the Euler angles phi, theta, psi of the chaser's axes to inertial axes.

    Shape (points, 3) [rad]; the rotation is Rz(psi) Ry(theta) Rx(phi).
    """
    return euler_from_rotation(rotation_base_to_inertial(q) @ robot.rotation_chaser_to_base)
