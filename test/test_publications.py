"""Requests to publish a plan that waits, from the bag to every page and table."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pyarrow.parquet
import pytest
from answers import exchange, write_bag
from ff_planner_msgs.msg import PlanAnswer, PlanInputs, PlanRequest, PlanStatus
from read_page import Page

from ff_planner_ros.bag.publications import Publication, publications
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.cli import main
from ff_planner_ros.errors import Status
from ff_planner_ros.ros.messages.to_messages import time_message

SECOND = 10**9
START = 1_760_000_000 * SECOND
MOVED = "the system will not be where run.2 begins"
# Plan, event, status, its message, who asks, age of the state that the node looked at [s]
CALLS = [
    ("run.1", "published", Status.SOLVED, "published", "fleet", 0.3),
    ("run.2", "answered", Status.STATE_MOVED, MOVED, "", 0.3),
    ("run.3", "published", Status.SOLVED, "published", "", 0.0),
    ("run.9", "answered", Status.UNKNOWN_PLAN, "no", "", None),
    ("run.4", "rejected", Status.SOLVED, "rejected", "", 0.2),
]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of five requests three are granted, one of them to reject; a sixth has no answer."""
    refused = PlanAnswer(plan_id="run.1", status=PlanStatus(code=301))
    told = [exchange(refused, PlanRequest(), START)]
    before = ""
    for number, (plan_id, event, code, message, requester, age) in enumerate(CALLS, 1):
        who = {"plan_id": plan_id, "interface": "publish_plan", "requester": requester}
        asked_ns = START + number * SECOND
        inputs = PlanInputs(received_stamp=time_message(asked_ns), previous_plan_id=before)
        if age is not None:
            inputs.state_stamp = time_message(asked_ns - round(age * SECOND))
        status = PlanStatus(code=int(code), message=message)
        answer = PlanAnswer(plan_id=plan_id, status=status, inputs=inputs)
        told.append(exchange(ns=asked_ns, **who))
        told.append(exchange(answer, ns=asked_ns + SECOND // 5, event=event, **who))
        before = plan_id if event == "published" else before
    told.append(exchange(plan_id="run.5", interface="publish_plan"))
    return write_bag(tmp_path_factory.mktemp("bags") / "run", *told, start_ns=START)


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
    assert [one.state_age_s for one in found] == [0.3, 0.3, 0.0, None, 0.2]
    assert [one.requester for one in found] == ["fleet", "", "", "", ""]
    assert [one.answered_ns - one.asked_ns for one in found] == [SECOND // 5] * 5


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
