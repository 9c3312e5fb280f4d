"""Goals and results of an action as service events, so that a bag records them.

In Jazzy the services of an action have no introspection of their own.
"""

from __future__ import annotations

from itertools import count

from ff_planner_msgs.action import PlanTrajectory
from ff_planner_msgs.msg import PlanAnswer
from rclpy.node import Node
from rclpy.qos import QoSProfile
from service_msgs.msg import ServiceEventInfo

from ff_planner_ros.messages.service_events import GOAL_EVENTS, RESULT_EVENTS
from ff_planner_ros.ros.messages.interfaces import GET_RESULT, SEND_GOAL


class ActionEvents:
    """Publishes the goals and results of one action server."""

    def __init__(self, node: Node, action: str, qos: QoSProfile) -> None:
        """Create the publishers."""
        self._node, self._numbers = node, count(1)
        self._goals = node.create_publisher(SEND_GOAL.Event, f"{action}{GOAL_EVENTS}", qos)
        self._results = node.create_publisher(GET_RESULT.Event, f"{action}{RESULT_EVENTS}", qos)

    def goal_received(self, asked: SEND_GOAL.Request) -> None:
        """Publish the event of a received goal."""
        info = self._info(ServiceEventInfo.REQUEST_RECEIVED)
        self._goals.publish(SEND_GOAL.Event(info=info, request=[asked]))

    def result_sent(self, asked: GET_RESULT.Request, status: int, answer: PlanAnswer) -> None:
        """Publish the event of a result, even of a rejected goal's, which no client can get."""
        result = PlanTrajectory.Result(answer=answer)
        response = GET_RESULT.Response(status=status, result=result)
        info = self._info(ServiceEventInfo.RESPONSE_SENT)
        self._results.publish(GET_RESULT.Event(info=info, request=[asked], response=[response]))

    def destroy(self) -> None:
        """Destroy the publishers."""
        for publisher in (self._goals, self._results):
            self._node.destroy_publisher(publisher)

    def _info(self, event_type: int) -> ServiceEventInfo:
        stamp = self._node.get_clock().now().to_msg()
        return ServiceEventInfo(
            event_type=event_type, stamp=stamp, sequence_number=next(self._numbers)
        )
