"""Parameters of the arm's controller, and of how plans are handed over to it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from ff_planner_ros.common.forms import a_word
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.settings import (
    STRICT_IF_LOW_NOT_ZERO,
    strict_if,
    tunable,
)
from ff_planner_ros.planning.task.controller_rules import Controller

# A tolerance in a goal of the controller: no limit.
ERASED = -1.0
_TOLERANCES = ("path_tolerance", "goal_tolerance", "goal_time_tolerance")


class HandOver(StrEnum):
    """How a plan reaches the controller."""

    TOPIC = "topic"
    ACTION = "action"


@dataclass(frozen=True)
class ControllerParameters:
    """Setup of the arm's joint_trajectory_controller, which must accept every published plan.

    Raises:
        InvalidInput: `hand_over` is unknown, or a tolerance is negative and not -1.0.
    """

    allow_nonzero_velocity_at_trajectory_end: bool = tunable(
        "The controller's parameter of this name; if false, only plans whose end_behaviour is "
        "stop_joints are published",
        strictness=strict_if(False),
    )
    effort_interface: bool = tunable(
        "Whether the controller's command_interfaces hold effort; if false, joint_trajectory "
        "carries no torques; answers always do"
    )
    stopped_velocity_tolerance: float = tunable(
        "Its constraints.stopped_velocity_tolerance, if it measures velocities and has a "
        "constraints.goal_time, after which it gives a plan up: with hand_over topic only plans "
        "whose joints are no faster at the end are published; with action the goal leaves the "
        "tolerance out for joints that are to move; 0.0: any",
        minimum=0.0,
        unit="rad/s",
        strictness=STRICT_IF_LOW_NOT_ZERO,
    )
    hand_over: str = tunable(
        "topic: a plan goes out on joint_trajectory alone; action: it is also sent to the "
        "controller's action, just before its start, and watched"
    )
    action: str = tunable(
        "Name of the controller's action, control_msgs/action/FollowJointTrajectory"
    )
    hand_over_lead: float = tunable(
        "With action: time before its start at which a plan is sent; the controller then drops the "
        "running plan",
        minimum=0.0,
        maximum=3600.0,
        unit="s",
    )
    path_tolerance: float = tunable(
        "With action: allowed deviation of a joint from the plan; 0.0: the controller's "
        "constraints; -1.0: any",
        minimum=-1.0,
        unit="rad",
    )
    goal_tolerance: float = tunable(
        "With action: allowed deviation of a joint at the plan's end; 0.0: the controller's "
        "constraints; -1.0: any",
        minimum=-1.0,
        unit="rad",
    )
    goal_time_tolerance: float = tunable(
        "With action: allowed delay at the plan's end; 0.0: the controller's constraints; -1.0: "
        "any",
        minimum=-1.0,
        unit="s",
    )

    def __post_init__(self) -> None:
        """Check `hand_over` and the tolerances."""
        a_word(HandOver).read("controller.hand_over", self.hand_over)
        for name in _TOLERANCES:
            given = getattr(self, name)
            if given < 0.0 and given != ERASED:
                allowed = "it must not be negative, but for -1.0, which leaves it out"
                raise InvalidInput(Status.OUT_OF_RANGE, f"controller.{name}", given, allowed)

    @property
    def setup(self) -> Controller:
        """The controller's setup, as its rules need it."""
        allowed = self.allow_nonzero_velocity_at_trajectory_end
        on_topic = self.hand_over == HandOver.TOPIC
        slowest = self.stopped_velocity_tolerance if on_topic else 0.0
        return Controller(allowed, self.effort_interface, slowest)
