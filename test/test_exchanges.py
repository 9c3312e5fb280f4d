"""Requests in a bag find their answers, and the task that was planned."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from answers import exchange, write_bag
from evil_bags import EVIL_BAGS, defined
from ff_planner_msgs.msg import PlanAnswer, PlanRequest, PlanStatus
from std_msgs.msg import String

from ff_planner_ros.bag.exchanges import Exchange, exchanges, publication_exchanges
from ff_planner_ros.bag.plans import recorded_requests
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.scenario.task_json import task_json
from ff_planner_ros.planning.task.planning_task import PlanningTask


def read(directory: Path, *told: Any, **attached: bytes) -> list[Exchange]:
    documents = {name.replace("_", "."): data for name, data in attached.items()}
    with open_bag(write_bag(directory, *told, attached=documents)) as bag:
        found = list(exchanges(bag))
        assert bag.notes == ()
    return found


def received(plan_id: str, **told: Any) -> Any:
    return exchange(request=PlanRequest(end_behaviour=plan_id), plan_id=plan_id, **told)


def answered(plan_id: str, code: int = Status.BUSY, **told: Any) -> Any:
    status = PlanStatus(code=int(code))
    asked = PlanRequest(end_behaviour=plan_id)
    return exchange(PlanAnswer(plan_id=plan_id, status=status), asked, **told)


def test_answers_come_in_their_order_each_with_the_time_of_its_request(tmp_path: Path) -> None:
    second, first = read(
        tmp_path / "bag",
        received("first", ns=900),
        received("second", ns=100),
        answered("second", ns=150, interface="service", requester="fleet"),
        answered("first", ns=950),
    )
    assert [first.plan_id, first.asked_ns, first.answered_ns, first.logged_ns] == [
        "first",
        900,
        950,
        3,
    ]
    assert [second.asked_ns, second.answered_ns, second.logged_ns] == [100, 150, 2]
    assert [second.interface, second.requester, second.event] == ["service", "fleet", "answered"]
    assert first.request.end_behaviour == first.answer.plan_id == "first"
    assert first.status is Status.BUSY


def test_a_request_without_an_answer_comes_last(tmp_path: Path) -> None:
    told, alone = read(tmp_path / "bag", received("lost", ns=7), received("a"), answered("a"))
    assert told.plan_id == "a"
    assert (alone.event, alone.asked_ns, alone.answered_ns) == ("received", 7, 0)
    assert alone.request.end_behaviour == "lost"
    assert (alone.answer, alone.status) == (None, None)
    with pytest.raises(InvalidInput, match="recording, or the planner, ended before its answer"):
        alone.planned_task()


def test_an_answer_whose_request_came_before_the_recording_stands_alone(tmp_path: Path) -> None:
    (found,) = read(tmp_path / "bag", answered("a", 999, ns=5))
    assert (found.asked_ns, found.answered_ns) == (0, 5)
    assert found.request.end_behaviour == "a"
    assert found.status is None, "this version does not know it"
    with pytest.raises(InvalidInput, match="refused before its task was complete"):
        found.planned_task()


def test_a_plan_that_is_published_or_dropped_keeps_its_answer(tmp_path: Path) -> None:
    """Requests to publish are about the same plan ids, and are read apart."""
    publishing: dict[str, Any] = {"plan_id": "a", "interface": "publish_plan"}
    bag = write_bag(
        tmp_path / "bag",
        received("a", ns=1),
        exchange(**publishing, ns=2),
        answered("a", ns=3),
        exchange(PlanAnswer(), **publishing | {"event": "published"}, ns=4),
        exchange(**publishing | {"plan_id": "b"}),
        exchange(plan_id="b", event="dropped"),
    )
    with open_bag(bag) as opened:
        (found,) = exchanges(opened)
        published, waiting = publication_exchanges(opened)
    assert (found.event, found.asked_ns, found.answered_ns) == ("answered", 1, 3)
    assert (published.event, published.asked_ns, published.answered_ns) == ("published", 2, 4)
    assert (waiting.plan_id, waiting.answer) == ("b", None)


def test_two_planners_may_use_one_plan_id(tmp_path: Path) -> None:
    topics = ("/first/exchanges", "/second/exchanges")
    asked = [(topic, received("a", ns=ns)) for ns, topic in enumerate(topics, 1)]
    told = [(topic, answered("a")) for topic in reversed(topics)]
    found = [(one.planner, one.asked_ns) for one in read(tmp_path / "bag", *asked, *told)]
    assert found == [("/second", 2), ("/first", 1)]


@pytest.mark.parametrize(
    "make",
    [
        EVIL_BAGS["a number for an approach"],
        EVIL_BAGS["a number for plans"],
        lambda: defined("octet plan_id;", cdr=b"\0"),
    ],
)
def test_contents_of_another_type_are_told_and_left_out(
    make: Callable[[], bytes], tmp_path: Path
) -> None:
    file = tmp_path / "bag.mcap"
    file.write_bytes(make())
    with open_bag(file) as bag:
        assert recorded_requests(bag) == []
        assert any("on /exchanges cannot be understood" in note for note in bag.notes)


@pytest.mark.law("BAG-02")
@pytest.mark.parametrize("place", ["attached", "on a topic", "in the task"])
def test_a_task_is_read_as_it_was_planned(
    place: str, lemur_capture: PlanningProblem, tmp_path: Path
) -> None:
    """Its robot is in the bag, or stands in the task."""
    task = PlanningTask(lemur_capture, load_parameters().planner)
    urdf = task.problem.robot.drawn_urdf
    told = answered("a", task=task_json(task, "" if place == "in the task" else urdf))
    messages = [("/robot_model", String(data=urdf)), told] if place == "on a topic" else [told]
    attached = {"robot_urdf": urdf.encode()} if place == "attached" else {}
    (found,) = read(tmp_path / "bag", *messages, **attached)
    assert found.planned_task().digest == task.digest


@pytest.mark.parametrize(
    ("damage", "field", "allowed"),
    [
        (lambda text: text[:-1], "task", "JSON"),
        (lambda text: f"[{text}]", "task", "it must hold a scenario"),
        (
            lambda text: re.sub(r'"starts": \d+, ', "", text),
            "planner.starts",
            "a recorded task has",
        ),
        (lambda text: text.replace("<robot", "<rabbit"), "robot.urdf", "robot"),
    ],
)
def test_a_damaged_task_is_refused(
    damage: Callable[[str], str],
    field: str,
    allowed: str,
    lemur_capture: PlanningProblem,
    tmp_path: Path,
) -> None:
    text = damage(task_json(PlanningTask(lemur_capture, load_parameters().planner)))
    (found,) = read(tmp_path / "bag", answered("a", task=text))
    with pytest.raises(InvalidInput, match=allowed) as told:
        found.planned_task()
    assert told.value.field == field


def test_a_task_whose_robot_the_bag_lacks_is_refused(
    lemur_capture: PlanningProblem, tmp_path: Path
) -> None:
    task = PlanningTask(lemur_capture, load_parameters().planner)
    text = task_json(task, lemur_capture.robot.drawn_urdf)
    (found,) = read(tmp_path / "bag", answered("a", task=text), robot_urdf=b"<another/>")
    with pytest.raises(InvalidInput, match=r"robot\.urdf is sha256:\w+: the bag must hold it"):
        found.planned_task()
