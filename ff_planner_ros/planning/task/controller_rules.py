"""The rules by which ROS's `joint_trajectory_controller` accepts trajectories, checked beforehand.

The controller logs a refusal where no planner sees it, and the arm stays where it is. Its rules are
in `JointTrajectoryController::validate_trajectory_msg` of ros-controls/ros2_controllers, here as of
branch jazzy, version 4.42.1:

1. times from start strictly increase;
2. the last point's velocities are zero, unless the controller's parameter
   `allow_nonzero_velocity_at_trajectory_end` is true; by default it is not;
3. the trajectory does not end before now.

What else it asks for every plan has: each joint once, and numbers for each of them at each point.

After the last point the controller keeps that point's positions and velocities as its reference
(`tolerances.hpp`). Joints that stop there are off by these velocities. If the controller measures
velocities and one is off by more than `constraints.stopped_velocity_tolerance`, it reports no
success and aborts the plan after `constraints.goal_time`. A goal of its action can erase that
tolerance, a topic cannot.

The last rule is stricter here: a trajectory that began before now starts in its middle, so that
the arm jumps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ff_planner_ros.common.declared import declare
from ff_planner_ros.common.forms import TRUTH, a_number
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.planning.motion.plan import Plan

# The controller's own: single precision's [rad/s].
REST = float(np.finfo(np.float32).eps)


@dataclass(frozen=True)
class Controller:
    """The parameters of the controller that its rules depend on."""

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


def require_acceptable(controller: Controller, plan: Plan) -> None:
    """Refuse a plan that the controller would not accept, or not execute as it is.

    Raises:
        NoPlanFound: A rule is broken; the message names it and the place (CONTROLLER_CONSTRAINT).
    """
    steps_ns = np.diff(np.rint(plan.trajectory.time * NANOSECONDS))
    if not (steps_ns > 0.0).all():
        point = int(np.argmin(steps_ns)) + 1
        raise _refusal(f"points[{point}] is less than a nanosecond after the point before")
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
    for name, rate in zip(plan.joint_names, plan.trajectory.joint_velocities[-1], strict=True):
        if not abs(rate) <= fastest:
            raise _refusal(
                f"joint {name} still moves at {rate:.3g} rad/s at the last point: {advice}"
            )


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


def _refusal(finding: str) -> NoPlanFound:
    return NoPlanFound(
        Status.CONTROLLER_CONSTRAINT,
        f"a joint_trajectory_controller would not take the plan: {finding}",
    )
