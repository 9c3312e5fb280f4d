"""Names of the planner's services and action, and the types of the events that tell of them."""

from __future__ import annotations

from ff_planner_msgs.action import PlanTrajectory as PlanTrajectoryAction

SERVICE, ACTION = "plan_trajectory", "plan_trajectory_action"
PUBLISH_PLAN = "~/publish_plan"
SEND_GOAL = PlanTrajectoryAction.Impl.SendGoalService
GET_RESULT = PlanTrajectoryAction.Impl.GetResultService


def type_name(message_type: type) -> str:
    """Return the name of a message class as a bag writes it, `package/msg/Name`."""
    package, kind = message_type.__module__.split(".")[:2]
    return f"{package}/{kind}/{message_type.__name__}"
