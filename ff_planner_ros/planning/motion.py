"""A motion as Pinocchio writes it to a motion as a user reads it, and back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.plan import Trajectory
from ff_planner_ros.robot.configuration import configuration, system_state
from ff_planner_ros.robot.dynamics import inverse_dynamics
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState


def to_trajectory(
    robot: Robot, time: Array, q: Array, v: Array, accelerations: Array
) -> Trajectory:
    """Return chaser, joints with their torques, and end effector of a motion.

    Args:
        time: Shape (points,) [s].
        q: Configurations. Shape (points, 7 + joints).
        v: Tangent velocities. Shape (points, 6 + joints).
        accelerations: dv/dt. Shape (points, 6 + joints).
    """
    model, data, tip = robot.model, robot.model.createData(), robot.tip_frame_id
    states, torques, ee_poses, ee_twists = [], [], [], []
    for q_i, v_i, acceleration in zip(q, v, accelerations, strict=True):
        states.append(system_state(robot, q_i, v_i))
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
        **chaser_motion(states),
        ee_positions=poses[:, :3],
        ee_quaternions_xyzw=poses[:, 3:],
        ee_linear_velocities=twists[:, :3],
        ee_angular_velocities=twists[:, 3:],
    )


def chaser_motion(states: Sequence[SystemState]) -> dict[str, Array]:
    """Return the chaser's part of a trajectory, from the state at each point."""
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


def from_trajectory(robot: Robot, trajectory: Trajectory) -> tuple[Array, Array]:
    """Return configurations, (points, 7 + joints), and tangent velocities, (points, 6 + joints)."""
    samples = [
        configuration(
            robot,
            SystemState(
                position_chaser_in_inertial=trajectory.chaser_positions[i],
                quaternion_chaser_to_inertial_xyzw=trajectory.chaser_quaternions_xyzw[i],
                linear_velocity_chaser_in_inertial=trajectory.chaser_linear_velocities[i],
                angular_velocity_chaser_in_inertial=trajectory.chaser_angular_velocities[i],
                joint_positions=trajectory.joint_positions[i],
                joint_velocities=trajectory.joint_velocities[i],
            ),
        )
        for i in range(len(trajectory.time))
    ]
    return np.array([q for q, _ in samples]), np.array([v for _, v in samples])
