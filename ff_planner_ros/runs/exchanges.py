"""Requests and their answers, as the events of the service and of the action tell them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from ff_planner_msgs.srv import PlanTrajectory
from service_msgs.msg import ServiceEventInfo

from ff_planner_ros.bag.decoding import as_installed
from ff_planner_ros.bag.reader import Bag
from ff_planner_ros.ros.messages.from_messages import NANOSECONDS
from ff_planner_ros.ros.recorder.recorder import type_name
from ff_planner_ros.ros.requests.action_events import (
    GET_RESULT,
    SEND_GOAL,
    goal_topic,
    result_topic,
)

SERVICE_DOOR, ACTION_DOOR = "service", "action"

_EVENTS = "/_service_event"


@dataclass(frozen=True, eq=False)
class Exchange:
    """A request and its answer.

    Attributes:
        door: SERVICE_DOOR or ACTION_DOOR.
        name: Of the service or action, resolved.
        logged_ns: When the request was recorded, or else its answer, by the recorder's clock [ns].
        received_ns: When it came, by the node's clock [ns].
        request: None where the bag holds the answer alone.
        response: None where the bag holds no answer.
        answered_ns: When the answer went out, by the node's clock [ns]; zero without an answer.
    """

    door: str
    name: str
    logged_ns: int
    received_ns: int
    request: PlanTrajectory.Request | None
    response: PlanTrajectory.Response | None
    answered_ns: int = 0


def exchanges(bag: Bag) -> list[Exchange]:
    """Return every request in a bag with its answer, in the order in which they came.

    Raises:
        BagError: A field was recorded as another type than is installed here.
    """
    found: dict[object, Exchange] = {}
    _add_service(bag, found)
    _add_goals(bag, found)
    _add_results(bag, found)
    return sorted(found.values(), key=lambda exchange: exchange.logged_ns)


def _add_service(bag: Bag, found: dict[object, Exchange]) -> None:
    for message, event in bag.decoded(type_name(PlanTrajectory.Event)):
        info = event.info
        name = message.topic.removesuffix(_EVENTS)
        key = (name, bytes(info.client_gid), int(info.sequence_number))
        if info.event_type == ServiceEventInfo.REQUEST_RECEIVED and event.request:
            request = as_installed(event.request[0], PlanTrajectory.Request)
            stamp_ns = _nanoseconds(info.stamp)
            found[key] = Exchange(SERVICE_DOOR, name, message.log_time_ns, stamp_ns, request, None)
        elif info.event_type == ServiceEventInfo.RESPONSE_SENT and event.response:
            response = as_installed(event.response[0], PlanTrajectory.Response)
            answered_ns = _nanoseconds(info.stamp)
            _answer(
                found,
                key,
                Exchange(SERVICE_DOOR, name, message.log_time_ns, 0, None, response, answered_ns),
            )


def _add_goals(bag: Bag, found: dict[object, Exchange]) -> None:
    for message, event in bag.decoded(type_name(SEND_GOAL.Event)):
        for asked in event.request:
            name = message.topic.removesuffix(goal_topic(""))
            request = as_installed(asked.goal, PlanTrajectory.Request)
            stamp_ns = _nanoseconds(event.info.stamp)
            found[name, bytes(asked.goal_id.uuid)] = Exchange(
                ACTION_DOOR, name, message.log_time_ns, stamp_ns, request, None
            )


def _add_results(bag: Bag, found: dict[object, Exchange]) -> None:
    for message, event in bag.decoded(type_name(GET_RESULT.Event)):
        for asked, answered in zip(event.request, event.response, strict=False):
            name = message.topic.removesuffix(result_topic(""))
            response = as_installed(answered.result, PlanTrajectory.Response)
            answered_ns = _nanoseconds(event.info.stamp)
            _answer(
                found,
                (name, bytes(asked.goal_id.uuid)),
                Exchange(ACTION_DOOR, name, message.log_time_ns, 0, None, response, answered_ns),
            )


def _answer(found: dict[object, Exchange], key: object, alone: Exchange) -> None:
    """Put an answer to its request, or by itself where the bag has none."""
    asked = found.get(key)
    if asked is None:
        found[key] = alone
    elif asked.response is None:
        found[key] = replace(asked, response=alone.response, answered_ns=alone.answered_ns)


def _nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)
