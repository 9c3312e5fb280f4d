"""Requests and responses of a bag find each other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ff_planner_msgs.srv import PlanTrajectory
from service_msgs.msg import ServiceEventInfo

from ff_planner_ros.bag.encoding import encode
from ff_planner_ros.bag.exchanges import SERVICE_EVENT, SERVICE_EVENTS, Exchange, exchanges
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.bag.writer import BagWriter

TOPIC = f"/plan_trajectory{SERVICE_EVENTS}"
RECEIVED, SENT = ServiceEventInfo.REQUEST_RECEIVED, ServiceEventInfo.RESPONSE_SENT


def event(kind: int, number: int, word: str) -> PlanTrajectory.Event:
    told = PlanTrajectory.Event()
    told.info.event_type, told.info.sequence_number = kind, number
    if kind == RECEIVED:
        told.request = [PlanTrajectory.Request(end_behaviour=word)]
    else:
        told.response = [PlanTrajectory.Response(plan_id=word)]
    return told


def read(directory: Path, *events: PlanTrajectory.Event) -> list[Exchange[Any, Any]]:
    with BagWriter(directory, flush_interval=0.0) as bag:
        bag.add_topic(TOPIC, SERVICE_EVENT, [])
        for time, told in enumerate(events):
            bag.write(TOPIC, encode(told), time, time)
    with open_bag(directory) as opened:
        return exchanges(
            opened, lambda request: request.end_behaviour, lambda _, response: response.plan_id
        )


def test_each_response_goes_to_the_request_of_its_number(tmp_path: Path) -> None:
    found = read(
        tmp_path / "bag",
        event(RECEIVED, 1, "first"),
        event(RECEIVED, 2, "second"),
        event(SENT, 2, "to second"),
        event(SENT, 1, "to first"),
    )
    assert [(one.request, one.response, one.logged_ns) for one in found] == [
        ("first", "to first", 0),
        ("second", "to second", 1),
    ]
    assert {(one.name, one.namespace) for one in found} == {("/plan_trajectory", "")}


def test_a_response_recorded_before_its_request_is_the_response_to_it(tmp_path: Path) -> None:
    (found,) = read(tmp_path / "bag", event(SENT, 1, "answer"), event(RECEIVED, 1, "question"))
    assert (found.request, found.response, found.logged_ns) == ("question", "answer", 1)


def test_what_has_no_partner_stands_alone(tmp_path: Path) -> None:
    found = read(
        tmp_path / "bag",
        event(SENT, 1, "answer"),
        event(RECEIVED, 2, "question"),
        event(SENT, 1, "answered twice"),
    )
    assert [(one.request, one.response) for one in found] == [
        (None, "answer"),
        ("question", None),
        (None, "answered twice"),
    ]
