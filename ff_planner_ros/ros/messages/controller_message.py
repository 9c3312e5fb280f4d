"""The plan as the arm's controller gets it, once it is sure that the controller takes it."""

from __future__ import annotations

from dataclasses import dataclass

from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from ff_planner_ros.planning.controller_rules import Command, Controller, require_acceptable
from ff_planner_ros.planning.settings import tunable
from ff_planner_ros.ros.messages.from_messages import nanoseconds


@dataclass(frozen=True)
class ControllerParameters:
    """How the arm's joint_trajectory_controller is set up: it must take every plan."""

    allow_nonzero_velocity_at_trajectory_end: bool = tunable(
        "Its parameter of this name; if false, only plans whose end_behaviour is stop_joints are "
        "published"
    )
    effort_interface: bool = tunable(
        "Whether its command_interfaces hold effort; if false, joint_trajectory carries no "
        "torques, which answers do all the same"
    )


def controller_message(
    trajectory: JointTrajectory,
    parameters: ControllerParameters,
    joint_names: tuple[str, ...],
    now_ns: int,
) -> JointTrajectory:
    """Return what to publish for the controller.

    Args:
        now_ns: The time now [ns].

    Raises:
        NoPlanFound: The controller would not take it (CONTROLLER_RULE), or it is late (TOO_LATE).
    """
    message = trajectory if parameters.effort_interface else _without_effort(trajectory)
    controller = Controller(
        joint_names,
        parameters.allow_nonzero_velocity_at_trajectory_end,
        parameters.effort_interface,
    )
    command = Command(
        joint_names=message.joint_names,
        start_ns=nanoseconds(message.header.stamp),
        time_from_start_ns=[nanoseconds(point.time_from_start) for point in message.points],
        positions=[point.positions for point in message.points],
        velocities=[point.velocities for point in message.points],
        accelerations=[point.accelerations for point in message.points],
        effort=[point.effort for point in message.points],
    )
    require_acceptable(controller, command, now_ns)
    return message


def _without_effort(trajectory: JointTrajectory) -> JointTrajectory:
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
