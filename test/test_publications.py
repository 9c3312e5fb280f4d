"""Requests to publish a plan that waits, from the bag to every page and table."""

from __future__ import annotations

import csv
import json
import tracemalloc
from collections.abc import Iterator
from itertools import repeat
from pathlib import Path
from typing import Any

import pyarrow.parquet
import pytest
from answers import received, sent
from ff_planner_msgs.msg import ChaserState, PlanAnswer, PlanRequest, PlanStatus, PublishedPlan
from ff_planner_msgs.srv import PlanTrajectory, PublishPlan
from read_page import Page
from service_msgs.msg import ServiceEventInfo
from std_msgs.msg import Header

from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.publications import Publication, publications
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.cli import main
from ff_planner_ros.errors import Status
from ff_planner_ros.ros.messages.interfaces import type_name
from ff_planner_ros.ros.messages.to_messages import time_message

SECOND = 10**9
START = 1_760_000_000 * SECOND
NAMESPACE = "/chaser_1"
SERVICE = f"{NAMESPACE}/ff_planner/publish_plan/_service_event"
ANSWERS = f"{NAMESPACE}/plan_trajectory/_service_event"
STATES, PUBLISHED = f"{NAMESPACE}/chaser_state", f"{NAMESPACE}/published_plan"
MOVED = "the system will not be where run.2 begins"


def stamped(seconds: float) -> Header:
    return Header(stamp=time_message(START + round(seconds * SECOND)))


def asked(number: int, at: float, request: PublishPlan.Request) -> PublishPlan.Event:
    info = ServiceEventInfo(event_type=ServiceEventInfo.REQUEST_RECEIVED, sequence_number=number)
    info.stamp = stamped(at).stamp
    return PublishPlan.Event(info=info, request=[request])


def answered(number: int, at: float, code: Status, message: str) -> PublishPlan.Event:
    info = ServiceEventInfo(event_type=ServiceEventInfo.RESPONSE_SENT, sequence_number=number)
    info.stamp = stamped(at).stamp
    status = PlanStatus(code=int(code), message=message)
    return PublishPlan.Event(info=info, response=[PublishPlan.Response(status=status)])


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of five requests three are granted, one of them to reject.

    States come every half second, 0.2 s after their stamp.
    """
    directory = tmp_path_factory.mktemp("bags") / "run"
    own = ChaserState(header=stamped(3.9))
    now = ChaserState()
    calls = [
        (1.0, PublishPlan.Request(plan_id="run.1", requester="fleet"), Status.SOLVED, "published"),
        (2.0, PublishPlan.Request(plan_id="run.2"), Status.STATE_MOVED, MOVED),
        (3.0, PublishPlan.Request(plan_id="run.3", start_state=[now]), Status.SOLVED, "published"),
        (4.0, PublishPlan.Request(plan_id="run.9", start_state=[own]), Status.UNKNOWN_PLAN, "no"),
        (4.4, PublishPlan.Request(plan_id="run.4", reject=True), Status.SOLVED, "rejected"),
    ]
    with BagWriter(directory, flush_interval=1.0) as writer:
        for topic, kind in (
            (SERVICE, PublishPlan.Event),
            (ANSWERS, PlanTrajectory.Event),
            (STATES, ChaserState),
            ("/chaser_2/chaser_state", ChaserState),
            (PUBLISHED, PublishedPlan),
        ):
            writer.add_topic(topic, type_name(kind), [])

        def write(topic: str, message: object, seconds: float) -> None:
            at_ns = START + round(seconds * SECOND)
            writer.write(topic, encode(message), at_ns, at_ns)

        write(ANSWERS, received(PlanRequest()), 0.1)
        write(ANSWERS, sent(PlanAnswer(plan_id="run.1", status=PlanStatus(code=301))), 0.2)
        for number in range(10):
            at = 0.5 * number
            write(STATES, ChaserState(header=stamped(at - 0.2)), at)
            write("/chaser_2/chaser_state", ChaserState(header=stamped(at)), at)
        for number, (at, request, code, message) in enumerate(calls):
            write(SERVICE, asked(number, at + 0.1, request), at + 0.1)
            if code == Status.SOLVED and not request.reject:
                write(PUBLISHED, PublishedPlan(plan_id=request.plan_id), at + 0.2)
            write(SERVICE, answered(number, at + 0.3, code, message), at + 0.3)
    return directory


def test_each_has_its_answer_the_age_of_its_state_and_the_plan_before(bag: Path) -> None:
    with open_bag(bag) as opened:
        found = publications(opened)
        assert opened.notes == ()
    told = [(one.plan_id, one.status, one.published, one.previous_plan_id) for one in found]
    assert told == [
        ("run.1", "SOLVED", True, ""),
        ("run.2", "STATE_MOVED", False, "run.1"),
        ("run.3", "SOLVED", True, "run.1"),
        ("run.9", "UNKNOWN_PLAN", False, "run.3"),
        ("run.4", "SOLVED", False, "run.3"),
    ]
    # The latest that was received, another one's states left out; as if measured now; its own.
    assert [one.state_age_s for one in found] == pytest.approx([0.3, 0.3, 0.0, 0.2, 0.2])
    assert [one.requester for one in found] == ["fleet", "", "", "", ""]
    assert [one.answered_ns - one.asked_ns for one in found] == [SECOND // 5] * 5


def test_states_of_an_hour_are_not_kept(bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A thousand a second are millions; those that count for a request are a handful."""
    many = 100_000
    with open_bag(bag) as opened:
        before = publications(opened)
        messages, peak = opened.messages, 0
        first = next(iter(messages(STATES)))

        def repeated(*topics: str, **only: Any) -> Iterator[Any]:
            if topics == (STATES,):
                yield from repeat(first, many)
            yield from messages(*topics, **only)

        monkeypatch.setattr(opened, "messages", repeated)
        tracemalloc.start()
        found = publications(opened)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert found == before
    assert peak < 8 * many, "one number of each would be as much"


def test_they_stand_in_info(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(bag)]) == 0
    text = capsys.readouterr().out
    assert "publish_plan  5: 3 SOLVED, 1 STATE_MOVED, 1 UNKNOWN_PLAN" in text
    assert f"STATE_MOVED  run.2  {MOVED}  state 0.300 s old  after run.1" in text
    assert main(["info", str(bag), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["publications"]
    assert [one["published"] for one in told] == [True, False, True, False, False]


def test_they_stand_in_the_tables(bag: Path, tmp_path: Path) -> None:
    assert main(["export", str(bag), "--csv", str(tmp_path / "csv")]) == 0
    with (tmp_path / "csv" / "publications.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == list(Publication.__dataclass_fields__)
    columns = ("plan_id", "published", "state_age_s", "previous_plan_id", "message")
    assert [rows[1][name] for name in columns] == ["run.2", "False", "0.3", "run.1", MOVED]

    assert main(["export", str(bag), "--parquet", str(tmp_path / "fleet.parquet")]) == 0
    table = pyarrow.parquet.read_table(tmp_path / "fleet_publications.parquet").to_pylist()
    assert [one["published"] for one in table] == [True, False, True, False, False]
    assert [one["previous_plan_id"] for one in table] == [None, "run.1", "run.1", "run.3", "run.3"]
    assert {one["bag"] for one in table} == {"run"}


def test_they_stand_in_the_report_of_a_run_and_of_many(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", str(bag), "--out", str(tmp_path / "run.html")]) == 0
    rows = Page((tmp_path / "run.html").read_text()).rows
    (moved,) = [cells for cells in rows if cells[0] == "run.2"]
    assert moved[3:] == ["STATE_MOVED", "no", "0.300", "run.1"]
    assert [MOVED] in rows
    assert main(["report", str(bag.parent), "--out", str(tmp_path / "all.html")]) == 0
    assert ["STATE_MOVED", "1"] in Page((tmp_path / "all.html").read_text()).rows
    capsys.readouterr()
    assert main(["info", str(bag.parent)]) == 0
    assert "publish_plan  5: 3 SOLVED" in capsys.readouterr().out
