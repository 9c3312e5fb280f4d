"""The joint trajectory in the form that the arm's controller accepts."""

from __future__ import annotations

from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint


def controller_message(trajectory: JointTrajectory, effort_interface: bool) -> JointTrajectory:
    """Return the trajectory for the controller; without torques if it takes no effort."""
    if effort_interface:
        return trajectory
    return JointTrajectory(
        header=trajectory.header,
        joint_names=trajectory.joint_names,
        points=[
            JointTrajectoryPoint(
                positions=point.positions,
                velocities=point.velocities,
                accelerations=point.accelerations,
                time_from_start=point.time_from_start,
            )
            for point in trajectory.points
        ],
    )
