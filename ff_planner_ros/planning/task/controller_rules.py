"""The rules by which ROS's `joint_trajectory_controller` accepts trajectories, checked beforehand.

The controller logs a refusal where no planner sees it, and the arm stays where it is. Its rules are
in `JointTrajectoryController::validate_trajectory_msg` of ros-controls/ros2_controllers, here as of
branch jazzy, version 4.42.1:

1. there are points and joint names, as many names as the controller has joints, each one of them;
2. times from start strictly increase;
3. every point has a position for each joint, and velocities and accelerations for each or for none;
4. the last point's velocities are zero, unless the controller's parameter
   `allow_nonzero_velocity_at_trajectory_end` is true; by default it is not;
5. there is no effort, unless the controller claims the `effort` command interface (since 4.22.0;
   before that never);
6. the trajectory does not end before now.

After the last point the controller keeps that point's positions and velocities as its reference
(`tolerances.hpp`). Joints that stop there are off by these velocities. If the controller measures
velocities and one is off by more than `constraints.stopped_velocity_tolerance`, it reports no
success and aborts the plan after `constraints.goal_time`. A goal of its action can erase that
tolerance, a topic cannot.

Three rules here are stricter, because the controller accepts what does harm: a joint named twice
takes the place of another one, numbers that are not finite go to the motors, and a trajectory that
began before now starts in its middle, so that the arm jumps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ff_planner_ros.common.declared import declare
from ff_planner_ros.common.forms import TRUTH, a_number
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.planning.motion.plan import Plan

# The controller's own: single precision's [rad/s].
REST = float(np.finfo(np.float32).eps)

_Rows = Sequence[Sequence[float]]


@dataclass(frozen=True)
class Controller:
    """The parameters of the controller that its rules depend on."""

    joints: Sequence[str]  # its parameter `joints`
    allow_nonzero_velocity_at_trajectory_end: bool = declare(TRUTH, "its parameter of this name")
    effort_interface: bool = declare(
        TRUTH, "whether effort is among its parameter command_interfaces"
    )
    stopped_velocity_tolerance: float = declare(
        a_number(at_least=0.0),
        "rate of joints at the end, above which it gives a plan up: its parameter "
        "constraints.stopped_velocity_tolerance; 0: it gives none up for that",
        unit="rad/s",
        default=0.0,
    )

    @property
    def takes_every_end(self) -> bool:
        """Whether joints may move at the end, however fast."""
        return self.allow_nonzero_velocity_at_trajectory_end and not self.stopped_velocity_tolerance


@dataclass(frozen=True)
class Command:
    """The content of a trajectory message: for each quantity one row per point, empty if absent."""

    joint_names: Sequence[str]  # of the columns
    time_from_start_ns: Sequence[int]  # one per point
    positions: _Rows  # [rad or m]
    velocities: _Rows  # [rad/s or m/s]
    accelerations: _Rows  # [rad/s2 or m/s2]
    effort: _Rows  # [N m or N]


def command_of(plan: Plan, controller: Controller) -> Command:
    """Return a plan as the message that a controller is sent."""
    motion = plan.trajectory
    torques = motion.joint_torques if controller.effort_interface else motion.joint_torques[:, :0]
    return Command(
        joint_names=plan.joint_names,
        time_from_start_ns=np.rint(motion.time * NANOSECONDS).astype(np.int64).tolist(),
        positions=motion.joint_positions.tolist(),
        velocities=motion.joint_velocities.tolist(),
        accelerations=motion.joint_accelerations.tolist(),
        effort=torques.tolist(),
    )


def require_acceptable(controller: Controller, command: Command) -> None:
    """Refuse a trajectory that the controller would not accept, or not execute as it is.

    Raises:
        NoPlanFound: A rule is broken; the message names it and the place (CONTROLLER_CONSTRAINT).
    """
    _require_joints(controller.joints, command.joint_names)
    _require_times(command.time_from_start_ns)
    for name in ("positions", "velocities", "accelerations", "effort"):
        _require_rows(name, getattr(command, name), command, mandatory=name == "positions")
    if not controller.effort_interface:
        for point, row in enumerate(command.effort):
            if len(row):
                raise _refusal(
                    f"points[{point}].effort is given: only a controller whose command_interfaces "
                    "hold effort takes it"
                )
    _require_end(controller, command)


def require_in_time(start_ns: int, now_ns: int) -> None:
    """Refuse a trajectory that begins, by the stamp in its header, before now.

    Raises:
        NoPlanFound: It begins before now (TOO_LATE).
    """
    if start_ns < now_ns:
        raise NoPlanFound(
            Status.TOO_LATE,
            f"the trajectory was to begin {(now_ns - start_ns) / 1e9:.3f} s ago: the stamp "
            "in its header must not be in the past",
        )


def _require_end(controller: Controller, command: Command) -> None:
    """Refuse joints that move at the last point, or too fast there."""
    fastest = controller.stopped_velocity_tolerance or math.inf
    advice = (
        f"more than stopped_velocity_tolerance, {fastest:g} rad/s: choose the end_behaviour "
        "stop_joints, or controller.hand_over action, whose goals leave that tolerance out"
    )
    if not controller.allow_nonzero_velocity_at_trajectory_end:
        fastest = REST
        advice = (
            "choose the end_behaviour stop_joints, or set the controller's parameter "
            "allow_nonzero_velocity_at_trajectory_end and say so to the planner"
        )
    for name, rate in zip(command.joint_names, command.velocities[-1], strict=False):
        if not abs(rate) <= fastest:
            raise _refusal(
                f"joint {name} still moves at {rate:.3g} rad/s at the last point: {advice}"
            )


def _require_joints(joints: Sequence[str], names: Sequence[str]) -> None:
    known = ", ".join(joints)
    for name in names:
        if name not in joints:
            raise _refusal(f"joint_names holds {name}: the controller's joints are {known}")
        if list(names).count(name) > 1:
            raise _refusal(f"joint_names holds {name} more than once")
    for name in joints:
        if name not in names:
            raise _refusal(f"joint_names misses {name}: the controller's joints are {known}")


def _require_times(times_ns: Sequence[int]) -> None:
    if not len(times_ns):
        raise _refusal("points is empty")
    if times_ns[0] < 0:
        raise _refusal(f"points[0].time_from_start is {times_ns[0]} ns: it must not be negative")
    for point in range(1, len(times_ns)):
        before, time = times_ns[point - 1], times_ns[point]
        if not time > before:
            raise _refusal(
                f"points[{point}].time_from_start is {time} ns: it must be greater than the "
                f"{before} ns of the point before"
            )


def _require_rows(name: str, rows: _Rows, command: Command, mandatory: bool) -> None:
    points, joints = len(command.time_from_start_ns), len(command.joint_names)
    if len(rows) != points:
        raise _refusal(f"{name} are given for {len(rows)} points: there are {points}")
    for point, row in enumerate(rows):
        if len(row) != joints and (mandatory or len(row)):
            or_none = "" if mandatory else " or none"
            raise _refusal(
                f"points[{point}].{name} has {len(row)} entries: it must have {joints}{or_none}"
            )
        for joint, value in zip(command.joint_names, row, strict=False):
            if not np.isfinite(value):
                raise _refusal(f"points[{point}].{name} of {joint} is {value}: it must be finite")


def _refusal(finding: str) -> NoPlanFound:
    return NoPlanFound(
        Status.CONTROLLER_CONSTRAINT,
        f"a joint_trajectory_controller would not take the plan: {finding}",
    )
