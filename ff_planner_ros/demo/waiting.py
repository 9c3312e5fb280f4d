"""How a testbed waits for its first plan: its time stands still until the planner is asked."""

from __future__ import annotations

from collections.abc import Callable

from ff_planner_msgs.msg import Exchange, PlanAnswer
from rclpy.node import Node

from ff_planner_ros.common.times import nanoseconds
from ff_planner_ros.errors import Status
from ff_planner_ros.messages.exchange_words import Event, Interface
from ff_planner_ros.ros.topics import EXCHANGES


class Wait:
    """Stops a testbed's time by the requests and answers of the planner.

    Time runs while a request is planned: the planner compares the plan with a newer state before it
    publishes the plan. Time stands still again after a refusal, and after the start of a plan that
    is not flown.
    """

    def __init__(self, node: Node, found: Callable[[PlanAnswer], None]) -> None:
        """Subscribe to exchanges; `found` is called with every answer that is SOLVED."""
        self._clock, self._found = node.get_clock(), found
        self._unanswered = 0  # requests
        self._plan_begins_ns = 0  # the last plan that was found
        self.is_over = False
        # Not those of before this testbed
        node.create_subscription(Exchange, EXCHANGES.name, self._heard, 10)

    def stands_still(self) -> bool:
        """Tell whether the testbed's time stands still now."""
        idle = self._unanswered == 0 and self._clock.now().nanoseconds > self._plan_begins_ns
        return idle and not self.is_over

    def end(self) -> None:
        """Let time run from now on, as a plan is flown."""
        self.is_over = True

    def _heard(self, exchange: Exchange) -> None:
        if exchange.interface == Interface.PUBLISH_PLAN:
            return
        if exchange.event == Event.RECEIVED:
            self._unanswered += 1
            return
        # The request may have come before this testbed.
        self._unanswered = max(self._unanswered - 1, 0)
        for answer in exchange.answer:
            if answer.status.code == Status.SOLVED:
                self._plan_begins_ns = nanoseconds(answer.plans[0].joint_trajectory.header.stamp)
                self._found(answer)
