"""Answers of the planner, and the events of its service that a bag holds."""

from __future__ import annotations

from typing import Any

from ff_planner_msgs.msg import PlanAnswer, PlanRequest
from ff_planner_msgs.srv import PlanTrajectory
from service_msgs.msg import ServiceEventInfo

from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.planning.task.captured import CapturedBody
from ff_planner_ros.ros.messages.to_messages import answer_with_plan, plan_message

FRAME = "inertial"


def answer_of(
    plan: Plan,
    plan_id: str = "run.1",
    start_ns: int = 10**18,
    solve_time: float = 0.1,
    body: TargetBody | None = None,
) -> PlanAnswer:
    """Answer with a plan, as the node does."""
    captured = None if body is None else CapturedBody(body)
    return answer_with_plan(
        plan, [plan_message(plan, start_ns, FRAME, captured)], plan_id, solve_time
    )


def received(request: PlanRequest, **info: Any) -> PlanTrajectory.Event:
    """Tell that a request came in."""
    kind = ServiceEventInfo.REQUEST_RECEIVED
    return PlanTrajectory.Event(
        info=ServiceEventInfo(event_type=kind, **info),
        request=[PlanTrajectory.Request(request=request)],
    )


def sent(answer: PlanAnswer, **info: Any) -> PlanTrajectory.Event:
    """Tell that an answer went out."""
    kind = ServiceEventInfo.RESPONSE_SENT
    return PlanTrajectory.Event(
        info=ServiceEventInfo(event_type=kind, **info),
        response=[PlanTrajectory.Response(answer=answer)],
    )
