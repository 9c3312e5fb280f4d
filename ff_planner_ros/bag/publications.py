"""The requests to publish a plan that waits, with their answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ff_planner_ros.bag.plans import status_name
from ff_planner_ros.bag.reader import Bag
from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.common.times import nanoseconds
from ff_planner_ros.messages.service_events import PUBLISH_EVENT, REQUEST_RECEIVED, RESPONSE_SENT


@dataclass(frozen=True)
class Publication:
    """A request to publish a plan, and its answer."""

    plan_id: str
    requester: str  # empty: it does not say
    answered_ns: int  # when the answer went out, by the node's clock
    status: str  # its name
    message: str


def publications(bag: Bag) -> list[Publication]:
    """Return every answer to a request to publish a plan, in the order in which they went out.

    Args:
        bag: Open; notes the events that cannot be understood.

    Raises:
        BagError: The disk fails.
    """
    asked: dict[object, Any] = {}
    found = list[Publication]()
    for message, event in bag.decoded(PUBLISH_EVENT):
        try:
            info = event.info
            key = message.topic, bytes(info.client_gid), int(info.sequence_number)
            if info.event_type == REQUEST_RECEIVED:
                asked[key] = event.request[0]
            elif info.event_type == RESPONSE_SENT and (request := asked.pop(key, None)) is not None:
                status = event.response[0].status
                found.append(
                    Publication(
                        str(request.plan_id),
                        # Until version 0.3 it was called otherwise.
                        str(value_at(request, "requester", value_at(request, "asked_by", ""))),
                        nanoseconds(info.stamp),
                        status_name(int(status.code)),
                        str(status.message),
                    )
                )
        except (AttributeError, TypeError, ValueError, LookupError, OverflowError) as error:
            bag.note(f"an event on {message.topic} cannot be understood: {error}")
    return sorted(found, key=lambda one: one.answered_ns)
