"""Parameters of the arm's controller, and of how plans are handed over to it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from ff_planner_ros.common.declared import tunable
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.task.controller_rules import Controller

# A tolerance in a goal of the controller: no limit.
ERASED = -1.0
_TOLERANCES = ("path_tolerance", "goal_tolerance", "goal_time_tolerance")


class HandOver(StrEnum):
    """How a plan reaches the controller."""

    TOPIC = "topic"
    ACTION = "action"


class Setting(NamedTuple):
    """A parameter of joint_trajectory_controller, and with what value it keeps plans true."""

    name: str
    value: str | bool | float
    why: str


# A plan of a free-floating robot holds at its own times alone.
KEEPS_PLANS = (
    Setting(
        "speed_scaling.initial_scaling_factor",
        1.0,
        "with another factor the plan runs at another pace and misses its goal",
    ),
    Setting(
        "speed_scaling.state_interface",
        "",
        "hardware that tells its speed scaling changes the pace by itself",
    ),
    Setting("speed_scaling.command_interface", "", "nobody is to scale the hardware's speed"),
    Setting(
        "interpolation_method",
        "splines",
        "with none the joints jump from point to point, and the chaser with them",
    ),
    Setting(
        "interpolate_from_desired_state",
        True,
        "a plan that takes over in motion begins where the one before has the joints, not where "
        "they are measured",
    ),
    Setting(
        "allow_partial_joints_goal",
        False,
        "joints that a goal leaves out are held; true only if the controller has locked joints",
    ),
    Setting("cmd_timeout", 0.0, "after it, joints of a plan that ends in motion are stopped"),
)


@dataclass(frozen=True)
class ControllerParameters:
    """Setup of the arm's joint_trajectory_controller, which must accept every published plan.

    Raises:
        InvalidInput: A tolerance is negative and not -1.0.
    """

    allow_nonzero_velocity_at_trajectory_end: bool = tunable(
        False,
        "The controller's parameter; if false, plans must end with stop_joints to be published",
    )
    effort_interface: bool = tunable(
        False, "Whether its command_interfaces hold effort: then joint_trajectory carries torques"
    )
    stopped_velocity_tolerance: float = tunable(
        0.0,
        "Its constraints.stopped_velocity_tolerance, if it measures velocities and has a "
        "constraints.goal_time: with hand_over topic no plan is published whose joints are faster "
        "at its end; 0.0: any [rad/s]",
    )
    hand_over: str = tunable(
        "topic",
        "topic: plans go out on joint_trajectory; action: to the controller's action, too",
        words=HandOver,
    )
    action: str = tunable(
        "joint_trajectory_controller/follow_joint_trajectory",
        "Name of the controller's action, control_msgs/action/FollowJointTrajectory",
    )
    hand_over_lead: float = tunable(
        0.05, "With action: time before its start at which a plan is sent [s]", (0.0, 3600.0)
    )
    path_tolerance: float = tunable(
        0.0,
        "With action: deviation of a joint on the way; 0.0: the controller's; -1.0: any [rad]",
        (-1.0, None),
    )
    goal_tolerance: float = tunable(
        0.0,
        "With action: deviation of a joint at the end; 0.0: the controller's; -1.0: any [rad]",
        (-1.0, None),
    )
    goal_time_tolerance: float = tunable(
        0.0, "With action: delay at the end; 0.0: the controller's; -1.0: any [s]", (-1.0, None)
    )

    state_topic: str = tunable(
        "",
        "Topic of the controller's state, by which a plan is aborted whose times it does not keep; "
        "empty: controller_state beside the action, with hand_over topic none",
    )
    reference_tolerance: float = tunable(
        0.002,
        "Allowed difference of the controller's reference from the running plan, its velocity "
        "counting by 0.1 s of it [rad]",
        (1e-5, None),
    )

    def __post_init__(self) -> None:
        """Check the tolerances."""
        for name in _TOLERANCES:
            given = getattr(self, name)
            if given < 0.0 and given != ERASED:
                allowed = "it must not be negative, but for -1.0, which leaves it out"
                raise InvalidInput(Status.OUT_OF_RANGE, f"controller.{name}", given, allowed)

    @property
    def watched_topic(self) -> str:
        """Topic of the controller's state; empty: it is not watched."""
        if self.state_topic or self.hand_over == HandOver.TOPIC:
            return self.state_topic
        return f"{self.action.rpartition('/')[0]}/controller_state"

    @property
    def setup(self) -> Controller:
        """The controller's setup, as its rules need it."""
        allowed = self.allow_nonzero_velocity_at_trajectory_end
        on_topic = self.hand_over == HandOver.TOPIC
        slowest = self.stopped_velocity_tolerance if on_topic else 0.0
        return Controller(allowed, self.effort_interface, slowest)
