"""What a replay says of a recorded answer, and of a bag that it cannot plan again."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answers import answer_with, exchange, write_bag
from ff_planner_msgs.msg import Exchange, PlanAnswer
from recorded_requests import recorded

from ff_planner_ros.bag.provenance import versions
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.cli import main
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.scenario.task_json import task_json
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.ros.messages.answers import answer_of
from ff_planner_ros.runs import replay as replay_module
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.replay import ALL_SAME, DIFFERS, Verdict, replay


@pytest.fixture(scope="module")
def task(lemur_capture: PlanningProblem) -> PlanningTask:
    return PlanningTask(lemur_capture, load_parameters().planner)


def off(plan: Plan, **changes: float) -> Plan:
    """A plan whose last sample of some quantities is off."""
    motion = plan.trajectory
    for name, by in changes.items():
        samples = np.array(getattr(motion, name))
        samples[-1, -1] += by
        motion = replace(motion, **{name: samples})
    return replace(plan, trajectory=motion)


def refusal(status: Status) -> FfPlannerError:
    return FfPlannerError(status, "because")


def refused(status: Status) -> PlanAnswer:
    return answer_of(refusal(status), "run.1", 0.1)


@pytest.fixture
def again(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Sets what the planner answers now."""

    def answers(answer: Plan | FfPlannerError) -> None:
        monkeypatch.setattr(replay_module, "answer_to", lambda _: answer)

    return answers


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({}, Verdict.IDENTICAL),
        ({"joint_positions": 1e-9}, Verdict.WITHIN_TOLERANCE),
        ({"joint_positions": -1e-9, "ee_positions": 1e-9}, Verdict.WITHIN_TOLERANCE),
        ({"joint_positions": 1e-3}, Verdict.DIFFERENT),
        ({"joint_positions": -1e-3}, Verdict.DIFFERENT),
        ({"joint_positions": 1e-9, "ee_positions": -1e-3}, Verdict.DIFFERENT),
        ({"chaser_positions": -1e-3, "joint_torques": 1e-9}, Verdict.DIFFERENT),
    ],
)
def test_one_difference_that_counts_makes_an_answer_another_one(
    task: PlanningTask, lemur_plan: Plan, again: Any, changes: dict[str, float], verdict: Verdict
) -> None:
    again(off(lemur_plan, **changes))
    found = replay(recorded(task, answer_with(lemur_plan)))
    assert found.verdict is verdict
    assert {one.quantity for one in found.differences} == changes.keys()


def test_a_plan_and_a_refusal_are_different_and_so_are_two_refusals(
    task: PlanningTask, lemur_plan: Plan, again: Any
) -> None:
    for then, now in (
        (answer_with(lemur_plan), refusal(Status.COLLISION)),
        (refused(Status.COLLISION), lemur_plan),
        (refused(Status.COLLISION), refusal(Status.SINGULAR)),
    ):
        again(now)
        assert replay(recorded(task, then)).verdict is Verdict.DIFFERENT
    again(refusal(Status.COLLISION))
    assert replay(recorded(task, refused(Status.COLLISION))).verdict is Verdict.IDENTICAL


@pytest.mark.parametrize(
    ("status", "verdict"),
    [
        *((status, Verdict.WITHOUT_CLOCK) for status in (Status.TOO_LATE, Status.TIMED_OUT)),
        *(
            (status, Verdict.NOT_PLANNED)
            for status in (
                *(Status.BUSY, Status.CANCELLED, Status.PREEMPTED, Status.NOT_ACTIVE),
                *(Status.SHUT_DOWN, Status.SOLVER_DIED, Status.CLOCK_JUMPED),
            )
        ),
    ],
)
def test_what_the_clock_or_the_world_answered_is_no_difference(
    task: PlanningTask, lemur_plan: Plan, again: Any, status: Status, verdict: Verdict
) -> None:
    again(lemur_plan)
    assert replay(recorded(task, refused(status))).verdict is verdict
    # Without a task, nothing is planned of either.
    assert replay(recorded(None, refused(status))).verdict is Verdict.NOT_PLANNED


@pytest.mark.parametrize("found", [True, False])
def test_a_search_that_a_clock_ended_is_compared_where_its_step_is_known(
    task: PlanningTask, lemur_plan: Plan, again: Any, found: bool
) -> None:
    """Its words tell of a clock then, and of a step now."""
    again(lemur_plan if found else refusal(Status.TIMED_OUT))
    then = answer_of(FfPlannerError(Status.TIMED_OUT, "the time is over"), "run.1", 0.1)
    verdict = replay(recorded(task.ended_at(7), then)).verdict
    assert verdict is (Verdict.DIFFERENT if found else Verdict.IDENTICAL)


def test_a_request_without_answer_or_robot_is_not_read_and_says_why(
    task: PlanningTask, lemur_plan: Plan
) -> None:
    found = replay(recorded(None, None))
    assert found.verdict is Verdict.NOT_READ
    assert "recording, or the planner, ended before its answer" in found.words
    text = task_json(task, task.problem.robot.drawn_urdf)
    found = replay(replace(recorded(None, answer_with(lemur_plan)), task=text))
    assert found.verdict is Verdict.NOT_READ
    assert found.words.startswith("robot.urdf is sha256:")


def test_an_answer_without_a_task_was_refused_before_there_was_one() -> None:
    found = replay(recorded(None, refused(Status.NO_STATE)))
    assert found.verdict is Verdict.NOT_PLANNED
    assert found.words == "it was refused before its task was complete"


def test_a_damaged_answer_is_told(task: PlanningTask, lemur_plan: Plan, again: Any) -> None:
    again(lemur_plan)
    answer = answer_with(lemur_plan)
    answer.plans[0].joint_trajectory.points.pop()
    found = replay(recorded(task, answer))
    assert found.verdict is Verdict.DIFFERENT
    assert found.words == (
        "the recorded answer is damaged: the shape of poses is (50, 7), not (49, 7)"
    )


def told(task: PlanningTask, plan: Plan, plan_id: str = "run.1", **more: Any) -> Exchange:
    return exchange(answer_with(plan, plan_id), task=task_json(task), **more)


@pytest.mark.parametrize(
    ("by", "missing", "code"),
    [(0.0, False, ALL_SAME), (1e-9, False, ALL_SAME), (1e-3, False, DIFFERS), (0.0, True, DIFFERS)],
)
def test_the_exit_code_tells_whether_every_answer_came_again(
    task: PlanningTask,
    lemur_plan: Plan,
    again: Any,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    by: float,
    missing: bool,
    code: int,
) -> None:
    """One request among others that are the same."""
    again(lemur_plan)
    other = told(task, off(lemur_plan, ee_positions=by), "run.2")
    if missing:
        other.task = task_json(task, task.problem.robot.drawn_urdf)
    each = told(task, lemur_plan), other, told(task, lemur_plan, "run.3")
    bag = write_bag(tmp_path / "bag", *each)
    assert main(["replay", str(bag)]) == code
    out = capsys.readouterr().out
    assert ("DIFFERENT" in out) == (by == 1e-3)
    assert ("1 NOT READ" in out) == missing


def test_a_plan_out_of_a_bag_is_planned_again_to_the_last_bit(
    task: PlanningTask, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record_answer(tmp_path / "bag", task, perform(task), 0.5)
    assert main(["replay", str(tmp_path / "bag")]) == ALL_SAME
    out = capsys.readouterr().out
    assert "1 identical; planning took" in out
    assert "version" not in out


@pytest.mark.parametrize(
    "arguments",
    [("replay",), ("replay", "--set", "points=30"), ("export", "--scenarios", "written")],
    ids=lambda arguments: arguments[-1],
)
def test_a_bag_without_exchanges_is_refused_and_why(
    arguments: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As others record it, or who came too late."""
    with BagWriter(tmp_path / "bag", flush_interval=0.0):
        pass
    command, *options = arguments
    options = [str(tmp_path / one) if one == "written" else one for one in options]
    assert main([command, str(tmp_path / "bag"), *options]) == 2
    words = "cannot be planned again: it holds no ff_planner_msgs/msg/Exchange"
    assert words in capsys.readouterr().err
    assert not (tmp_path / "written").exists()


def test_a_bag_of_a_baseline_is_refused_and_why(
    task: PlanningTask, lemur_plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record_answer(tmp_path / "bag", task, lemur_plan, 0.5, method="apf")
    assert main(["replay", str(tmp_path / "bag")]) == 2
    assert "planned by a baseline, --method apf" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("recorded_versions", "lines"),
    [
        (versions() | {"numpy": "1.0.0"}, ["version: numpy was 1.0.0, is {numpy}"]),
        (
            {name: told for name, told in versions().items() if name != "scipy"},
            ["version: scipy was unknown, is {scipy}"],
        ),
        (versions(), []),
        (None, ["note: the bag does not say with which versions it was recorded"]),
        ("numpy", ["note: the bag does not say with which versions it was recorded"]),
    ],
    ids=["another", "missing", "the same", "none", "no versions"],
)
def test_versions_that_are_others_now_are_named(
    recorded_versions: Any,
    lines: list[str],
    task: PlanningTask,
    lemur_plan: Plan,
    again: Any,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    again(lemur_plan)
    text = "" if recorded_versions is None else json.dumps(recorded_versions)
    each = (told(task, lemur_plan, name, versions=text) for name in ("run.1", "run.2"))
    bag = write_bag(tmp_path / "bag", *each)
    assert main(["replay", str(bag)]) == ALL_SAME
    found = [
        line
        for line in capsys.readouterr().out.splitlines()
        if line.startswith(("version: ", "note: the bag"))
    ]
    assert found == [line.format(**versions()) for line in lines]


def test_requests_with_one_plan_id_are_exported_to_a_file_each(
    task: PlanningTask, lemur_plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = ("a/1", "a_1", "a_1_2", "a_1")
    answers = [told(task, lemur_plan, name) for name in names]
    none = exchange(refused(Status.NO_STATE), plan_id="b")
    bag, out = write_bag(tmp_path / "bag", *answers, none), tmp_path / "out"
    assert main(["export", str(bag), "--scenarios", str(out)]) == 0
    written = sorted(path.name for path in out.glob("*.yaml"))
    assert written == ["a_1.yaml", "a_1_2.yaml", "a_1_2_2.yaml", "a_1_3.yaml"]
    assert "b is left out: task is missing" in capsys.readouterr().err
