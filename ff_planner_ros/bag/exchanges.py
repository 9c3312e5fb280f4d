"""Pairs the requests in a bag with their responses; the only reader of their events."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

from ff_planner_ros.bag.reader import Bag, Message
from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.common.times import nanoseconds
from ff_planner_ros.messages.service_events import (
    GOAL_EVENT,
    GOAL_EVENTS,
    REQUEST_RECEIVED,
    RESPONSE_SENT,
    RESULT_EVENT,
    RESULT_EVENTS,
    SERVICE_EVENT,
    SERVICE_EVENTS,
)

SERVICE, ACTION = "service", "action"  # where a request comes in

Request = TypeVar("Request")
Response = TypeVar("Response")


@dataclass(frozen=True, eq=False)
class Exchange(Generic[Request, Response]):
    """A request and its response."""

    door: str  # SERVICE or ACTION
    name: str  # of the service or action, resolved
    logged_ns: int  # when the request was recorded, or else its response, by the recorder's clock
    received_ns: int = 0  # when the request came, by the node's clock; zero without a request
    request: Request | None = None  # None where the bag holds the response alone
    response: Response | None = None  # None where the bag holds no response
    answered_ns: int = 0  # when the response went out, by the node's clock; zero without a response
    answered_by: Message | None = None  # the event that holds the response; None without one

    @property
    def namespace(self) -> str:
        """Namespace of the planner, without a trailing slash."""
        return self.name.rpartition("/")[0]


def exchanges(
    bag: Bag,
    read_request: Callable[[Any], Request],
    read_response: Callable[[Message, Any], Response | None],
) -> list[Exchange[Request, Response]]:
    """Return every request with its response, in the order in which the requests were recorded.

    Args:
        bag: An open bag, which gets a note for each event that cannot be understood.
        read_request: Called with each request, as it was decoded.
        read_response: Called with the event's message and the answer, as it was decoded; None
            leaves the answer out.

    Raises:
        BagError: The disk fails.
    """
    asked: dict[object, deque[Exchange[Request, Response]]] = defaultdict(deque)
    answered: list[tuple[object, Exchange[Request, Response]]] = []
    for message, event in bag.decoded(SERVICE_EVENT, GOAL_EVENT, RESULT_EVENT):
        try:
            stamp_ns = nanoseconds(event.info.stamp)
            for door, name, key, request, response in list(_parts(message, event)):
                at = (door, name, message.log_time_ns)
                if request is not None:
                    asked[key].append(Exchange(*at, stamp_ns, read_request(request)))
                elif (read := read_response(message, response)) is not None:
                    answered.append((key, Exchange(*at, 0, None, read, stamp_ns, message)))
        except (AttributeError, TypeError, ValueError, LookupError, OverflowError) as error:
            bag.note(f"an event on {message.topic} cannot be understood: {error}")
    found = [_joined(asked[key], alone) for key, alone in answered]
    found += [exchange for waiting in asked.values() for exchange in waiting]
    return sorted(found, key=lambda exchange: exchange.logged_ns)


def _parts(message: Message, event: Any) -> Iterator[tuple[str, str, object, Any, Any]]:
    """Yield door, name, key, and either the request or the response, of all that an event holds."""
    kind, topic = event.info.event_type, message.topic
    if message.type_name == SERVICE_EVENT:
        name = topic.removesuffix(SERVICE_EVENTS)
        key = (name, _bytes(event.info.client_gid), int(event.info.sequence_number))
        if kind == REQUEST_RECEIVED:
            yield from ((SERVICE, name, key, one.request, None) for one in event.request)
        elif kind == RESPONSE_SENT:
            yield from ((SERVICE, name, key, None, one.answer) for one in event.response)
    elif message.type_name == GOAL_EVENT and kind == REQUEST_RECEIVED:
        name = topic.removesuffix(GOAL_EVENTS)
        for one in event.request:
            yield ACTION, name, (name, _bytes(one.goal_id.uuid)), one.goal.request, None
    elif message.type_name == RESULT_EVENT and kind == RESPONSE_SENT:
        name = topic.removesuffix(RESULT_EVENTS)
        goals = [_bytes(one.goal_id.uuid) for one in event.request]
        for number, one in enumerate(event.response):
            goal = goals[number] if number < len(goals) else None
            yield ACTION, name, (name, goal), None, one.result.answer


def answer_in(event: Any) -> Any:
    """Return the answer in a decoded event of a response."""
    response = event.response[0]
    return value_at(response, "result", response).answer


def _bytes(values: Any) -> bytes:
    if isinstance(values, int):  # by another definition; `bytes` would make so many zeros of it
        raise TypeError("an identity is one number")
    return bytes(values)


def _joined(
    waiting: deque[Exchange[Request, Response]], alone: Exchange[Request, Response]
) -> Exchange[Request, Response]:
    """Return a response with its request; alone where the bag does not hold the request."""
    if not waiting:
        return alone
    return replace(
        waiting.popleft(),
        response=alone.response,
        answered_ns=alone.answered_ns,
        answered_by=alone.answered_by,
    )
