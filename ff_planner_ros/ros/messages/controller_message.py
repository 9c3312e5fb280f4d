"""The plan as the arm's controller gets it."""

from __future__ import annotations

from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint


def controller_message(trajectory: JointTrajectory, effort_interface: bool) -> JointTrajectory:
    """Return what to publish for the controller, without torques where it takes none."""
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
