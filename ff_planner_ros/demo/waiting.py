"""How a testbed waits for its first plan: its time stands still until the planner is asked."""

from __future__ import annotations

from collections.abc import Callable

from ff_planner_msgs.msg import PlanAnswer
from ff_planner_msgs.srv import PlanTrajectory
from rclpy.node import Node

from ff_planner_ros.common.times import nanoseconds
from ff_planner_ros.errors import Status
from ff_planner_ros.messages.service_events import (
    GOAL_EVENTS,
    REQUEST_RECEIVED,
    RESPONSE_SENT,
    RESULT_EVENTS,
    SERVICE_EVENTS,
)
from ff_planner_ros.ros.messages.interfaces import ACTION, GET_RESULT, SEND_GOAL, SERVICE
from ff_planner_ros.ros.qos import EVENT_QOS


class Wait:
    """Stops a testbed's time by the requests and answers of the planner's action and service.

    Time runs while a request is planned: the planner compares the plan with a newer state before it
    publishes the plan. Time stands still again after a refusal, and after the start of a plan that
    is not flown.
    """

    def __init__(self, node: Node, found: Callable[[PlanAnswer], None]) -> None:
        """Subscribe to the planner's events; `found` is called with every answer that is SOLVED."""
        self._clock, self._found = node.get_clock(), found
        self._unanswered = 0  # requests
        self._plan_begins_ns = 0  # the last plan that was found
        self.is_over = False
        node.create_subscription(SEND_GOAL.Event, ACTION + GOAL_EVENTS, self._goal, EVENT_QOS)
        node.create_subscription(GET_RESULT.Event, ACTION + RESULT_EVENTS, self._result, EVENT_QOS)
        served = SERVICE + SERVICE_EVENTS
        node.create_subscription(PlanTrajectory.Event, served, self._serve, EVENT_QOS)

    def stands_still(self) -> bool:
        """Tell whether the testbed's time stands still now."""
        idle = self._unanswered == 0 and self._clock.now().nanoseconds > self._plan_begins_ns
        return idle and not self.is_over

    def end(self) -> None:
        """Let time run from now on, as a plan is flown."""
        self.is_over = True

    def _goal(self, _: SEND_GOAL.Event) -> None:
        self._unanswered += 1

    def _result(self, event: GET_RESULT.Event) -> None:
        self._answered(event.response[0].result.answer)

    def _serve(self, event: PlanTrajectory.Event) -> None:
        kind = event.info.event_type
        if kind == REQUEST_RECEIVED:
            self._unanswered += 1
        if kind == RESPONSE_SENT and event.response:
            self._answered(event.response[0].answer)

    def _answered(self, answer: PlanAnswer) -> None:
        # The request may have come before this testbed.
        self._unanswered = max(self._unanswered - 1, 0)
        if answer.status.code == Status.SOLVED:
            self._plan_begins_ns = nanoseconds(answer.plans[0].joint_trajectory.header.stamp)
            self._found(answer)
