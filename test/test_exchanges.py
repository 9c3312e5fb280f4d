"""Requests and responses of a bag find each other."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answers import received, sent
from evil_bags import EVIL_BAGS
from ff_planner_msgs.msg import PlanAnswer, PlanRequest
from ff_planner_msgs.srv import PlanTrajectory
from service_msgs.msg import ServiceEventInfo

from ff_planner_ros.bag.exchanges import Exchange, exchanges
from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.plans import planning_exchanges
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.messages.service_events import SERVICE_EVENTS
from ff_planner_ros.ros.messages.interfaces import type_name

TOPIC = f"/plan_trajectory{SERVICE_EVENTS}"
RECEIVED, SENT = ServiceEventInfo.REQUEST_RECEIVED, ServiceEventInfo.RESPONSE_SENT


def event(kind: int, number: int, word: str, client: int = 0, ns: int = 0) -> PlanTrajectory.Event:
    question, answer = PlanRequest(end_behaviour=word), PlanAnswer(plan_id=word)
    told = received(question) if kind == RECEIVED else sent(answer)
    told.info.event_type, told.info.sequence_number = kind, number
    told.info.client_gid = np.full(16, client, np.uint8)
    told.info.stamp.nanosec = ns
    return told


def read(
    directory: Path, *events: PlanTrajectory.Event, topics: Sequence[str] = (TOPIC,)
) -> list[Exchange[Any, Any]]:
    """The events go to the topics in turn."""
    with BagWriter(directory, flush_interval=0.0) as bag:
        for topic in topics:
            bag.add_topic(topic, type_name(PlanTrajectory.Event), [])
        for time, told in enumerate(events):
            bag.write(topics[time % len(topics)], encode(told), time, time)
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


def test_two_clients_may_count_alike(tmp_path: Path) -> None:
    found = read(
        tmp_path / "bag",
        event(RECEIVED, 1, "one", client=7),
        event(RECEIVED, 1, "other", client=8),
        event(SENT, 1, "to other", client=8),
        event(SENT, 1, "to one", client=7),
    )
    assert [(one.request, one.response) for one in found] == [
        ("one", "to one"),
        ("other", "to other"),
    ]


def test_two_planners_may_be_asked_by_one_client_under_one_number(tmp_path: Path) -> None:
    found = read(
        tmp_path / "bag",
        event(RECEIVED, 1, "one", client=7),
        event(RECEIVED, 1, "other", client=7),
        event(SENT, 9, "to nobody", client=7),
        event(SENT, 1, "to other", client=7),
        event(SENT, 1, "to one", client=7),
        topics=[f"/{name}{TOPIC}" for name in ("first", "second")],
    )
    assert [(one.namespace, one.request, one.response) for one in found] == [
        ("/first", "one", "to one"),
        ("/second", "other", "to other"),
        ("/first", None, "to nobody"),
    ]


def test_a_number_that_is_used_again_is_answered_in_the_order_of_asking(tmp_path: Path) -> None:
    """A client that began anew, and events of other kinds between."""
    found = read(
        tmp_path / "bag",
        event(RECEIVED, 1, "before"),
        event(ServiceEventInfo.REQUEST_SENT, 1, "of the client"),
        event(RECEIVED, 1, "after"),
        event(SENT, 1, "to before"),
        event(SENT, 1, "to after"),
        event(ServiceEventInfo.RESPONSE_RECEIVED, 1, "of the client"),
    )
    assert [(one.request, one.response) for one in found] == [
        ("before", "to before"),
        ("after", "to after"),
    ]


def test_each_has_the_times_of_the_node_and_of_the_recorder(tmp_path: Path) -> None:
    """They come in the order of recording, whatever the node's clock says."""
    late, early, alone = read(
        tmp_path / "bag",
        event(RECEIVED, 1, "first", ns=900),
        event(RECEIVED, 2, "second", ns=100),
        event(SENT, 2, "to second", ns=150),
        event(SENT, 1, "to first", ns=950),
        event(SENT, 3, "to nobody", ns=50),
    )
    times = [(one.logged_ns, one.received_ns, one.answered_ns) for one in (late, early, alone)]
    assert times == [(0, 900, 950), (1, 100, 150), (4, 0, 50)]
    assert (late.response, early.response, alone.response) == (
        "to first",
        "to second",
        "to nobody",
    )
    assert late.answered_by is not None
    assert late.answered_by.log_time_ns == 3


@pytest.mark.parametrize("name", ["a number for an approach", "a number for plans"])
def test_parts_of_another_type_are_told_and_left_out(name: str, tmp_path: Path) -> None:
    file = tmp_path / "bag.mcap"
    file.write_bytes(EVIL_BAGS[name]())
    with open_bag(file) as bag:
        assert planning_exchanges(bag) == []
        assert any(
            "on /plan_trajectory/_service_event cannot be understood" in n for n in bag.notes
        )
