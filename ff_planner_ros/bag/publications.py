"""Requests in a bag to publish or reject a waiting plan, with their answers."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeVar

from ff_planner_ros.bag.answers import Cell
from ff_planner_ros.bag.plans import status_name
from ff_planner_ros.bag.reader import Bag
from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import Status
from ff_planner_ros.messages.service_events import (
    PUBLISH_EVENT,
    REQUEST_RECEIVED,
    RESPONSE_SENT,
    SERVICE_EVENTS,
)

_PUBLISHED = "ff_planner_msgs/msg/PublishedPlan"
# Topics that states come by, the first that a bag has, and their types.
_STATES = (
    ("chaser_state", "ff_planner_msgs/msg/ChaserState"),
    ("odometry", "nav_msgs/msg/Odometry"),
)
_Value = TypeVar("_Value")
_STAMP = struct.Struct("<iI")  # behind the four bytes that each message begins with


@dataclass(frozen=True)
class Publication:
    """A request to publish or reject a plan, and its answer."""

    plan_id: str
    requester: str  # as the request says; may be empty
    asked_ns: int  # when the request was received, by the node's clock
    answered_ns: int  # when the answer went out, by the node's clock
    status: str  # its name
    message: str
    published: bool
    # Age of the state that the plan had to fit, at the request [s]; None: the bag has no state
    state_age_s: float | None
    previous_plan_id: str  # id of the plan published before; empty: the bag has none

    def row(self) -> dict[str, Cell]:
        """Return the publication as a row of a table, with units in the names of its columns."""
        return {name: None if value == "" else value for name, value in vars(self).items()}


def publications(bag: Bag) -> list[Publication]:
    """Return every answered request to publish or reject a plan, in the order of the answers.

    Args:
        bag: An open bag, which gets a note for each event that cannot be understood.

    Raises:
        BagError: The disk fails.
    """
    asked: dict[object, tuple[Any, int, int]] = {}
    found = list[Publication]()
    heard = dict[str, _Heard]()
    events = list(bag.decoded(PUBLISH_EVENT))
    moments = sorted(message.log_time_ns for message, _ in events)
    for message, event in events:
        try:
            info = event.info
            key = message.topic, bytes(info.client_gid), int(info.sequence_number)
            stamp_ns = nanoseconds(info.stamp)
            if info.event_type == REQUEST_RECEIVED:
                asked[key] = event.request[0], stamp_ns, message.log_time_ns
            elif info.event_type == RESPONSE_SENT and (of := asked.pop(key, None)) is not None:
                request, asked_ns, logged_ns = of
                status = event.response[0].status
                namespace = message.topic.removesuffix(SERVICE_EVENTS).rsplit("/", 2)[0]
                if namespace not in heard:
                    heard[namespace] = _Heard(bag, namespace, moments)
                state_ns = heard[namespace].state_ns(request, asked_ns, logged_ns)
                found.append(
                    Publication(
                        str(request.plan_id),
                        str(request.requester),
                        asked_ns,
                        stamp_ns,
                        status_name(int(status.code)),
                        str(status.message),
                        # A plan that was rejected is answered with SOLVED, too.
                        status.code == Status.SOLVED and not request.reject,
                        None if state_ns is None else (asked_ns - state_ns) / NANOSECONDS,
                        heard[namespace].plan_before(logged_ns),
                    )
                )
        except (AttributeError, TypeError, ValueError, LookupError, OverflowError) as error:
            bag.note(f"an event on {message.topic} cannot be understood: {error}")
    return sorted(found, key=lambda one: one.answered_ns)


class _Heard:
    """The last state that a planner received, and the last plan that it published, by moments."""

    def __init__(self, bag: Bag, namespace: str, moments: Sequence[int]) -> None:
        """Read the bag once, and keep what counts: an hour at 1 kHz has millions of states.

        Args:
            moments: Times of the record [ns], in order.
        """
        self._states: dict[int, int] = {}  # stamps [ns]
        for name, type_name in _STATES:
            topic = _topic(bag, f"{namespace}/{name}", type_name)
            if topic is not None and not self._states:
                self._states = _last_by(moments, _stamps(bag, topic))
        topic = _topic(bag, f"{namespace}/published_plan", _PUBLISHED)
        published = (
            (message.log_time_ns, str(plan.plan_id))
            for message, plan in bag.decoded(_PUBLISHED)
            if message.topic == topic
        )
        self._plans = _last_by(moments, published)  # ids

    def state_ns(self, request: Any, asked_ns: int, logged_ns: int) -> int | None:
        """Return the stamp of the state that counted for a request: its own, or the latest."""
        own = value_at(request, "start_state[0].header.stamp", None)
        if own is not None:
            return nanoseconds(own) or asked_ns  # zero: as if measured now
        return self._states.get(logged_ns)

    def plan_before(self, logged_ns: int) -> str:
        """Return the id of the plan published last before a record; empty: none."""
        return self._plans.get(logged_ns, "")


def _stamps(bag: Bag, topic: str) -> Iterator[tuple[int, int]]:
    """Yield the time of the record and the stamp of each message of a topic [ns]."""
    for message in bag.messages(topic):
        seconds, rest_ns = _STAMP.unpack_from(message.cdr, 4)
        yield message.log_time_ns, seconds * NANOSECONDS + rest_ns


def _last_by(moments: Sequence[int], found: Iterable[tuple[int, _Value]]) -> dict[int, _Value]:
    """Return the last value at or before each moment, without those that have none.

    Args:
        moments: In order [ns].
        found: Times [ns], in order, with their values.
    """
    last, waiting = dict[int, _Value](), deque(moments)
    for at_ns, value in found:
        while waiting and waiting[0] < at_ns:
            waiting.popleft()
        if not waiting:
            break
        last[waiting[0]] = value
    for before, moment in pairwise(moments):
        if before in last:
            last.setdefault(moment, last[before])
    return last


def _topic(bag: Bag, name: str, type_name: str) -> str | None:
    """Return the topic of a name, or else the only one of its type."""
    of_type = [one.name for one in bag.topics.values() if one.type_name == type_name]
    return name if name in of_type else of_type[0] if len(of_type) == 1 else None
