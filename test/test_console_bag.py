"""A bag in the console: every request, refused ones too, with the plan that was recorded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from answers import answer_with, exchange, write_bag

from ff_planner_ros.bag.exchanges import exchanges
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.console.from_bag import entries_of_bag
from ff_planner_ros.console.search import Answer, Search
from ff_planner_ros.errors import BagError, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.scenario.task_json import task_json
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.runs.offline_bag import record_answer

NODE = Path(__file__).parent / "golden_bags" / "node"


def test_every_request_of_a_bag_is_listed_with_its_answer() -> None:
    entries, _ = entries_of_bag(NODE)
    with open_bag(NODE) as opened:
        requests = list(exchanges(opened))
    assert len({entry.name for entry in entries}) == len(entries) == len(requests)
    for entry, request in zip(entries, requests, strict=True):
        assert request.answer.status.message in entry.words
        assert (entry.plan is not None) == (request.status is Status.SOLVED)
        assert (entry.task is not None) == bool(request.task)
        if entry.plan is not None:
            points = request.answer.plans[0].joint_trajectory.points
            motion = entry.plan.phases[0].trajectory
            assert motion.joint_positions.tolist() == [list(one.positions) for one in points]
            assert entry.stages
        else:
            assert request.status is not None
            assert entry.status == f"refused, {request.status.name}"
            assert entry.error is not None
            assert entry.error.status is request.status


def test_what_is_missing_or_damaged_is_told(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path: Path
) -> None:
    task = PlanningTask(lemur_capture, load_parameters().planner)
    damaged = answer_with(lemur_plan)
    damaged.plans[0].joint_trajectory.points.pop()
    bag = write_bag(
        tmp_path / "bag",
        exchange(answer_with(lemur_plan), task=task_json(task)),
        exchange(damaged, task=task_json(task)),
        exchange(answer_with(lemur_plan)),
        exchange(plan_id="run.2"),
    )
    entries, _ = entries_of_bag(bag)
    assert [entry.name for entry in entries] == ["run.1", "run.1 (2)", "run.1 (3)", "run.2"]
    assert [entry.plan is not None for entry in entries] == [True, False, False, False]
    _, unread, without_task, unanswered = entries
    assert "its motion cannot be read: plans is damaged: the shape of poses" in unread.words
    assert "not drawn: task is missing" in without_task.words
    assert unanswered.status == "no answer"
    assert "recording, or the planner, ended before its answer" in unanswered.words


def test_a_bag_without_requests_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="it holds no ff_planner_msgs/msg/Exchange"):
        entries_of_bag(write_bag(tmp_path / "bag"))


def test_what_was_recorded_can_be_planned_again(tmp_path: Path) -> None:
    scenario = share_directory() / "config" / "scenarios" / "lemur_capture.yaml"
    task = load_task(scenario, Defaults(load_parameters().planner))
    made = perform(task)
    record_answer(tmp_path / "bag", task, made, 0.1, scenario, "optimal")
    (entry,), _ = entries_of_bag(tmp_path / "bag")
    answers = list[Answer]()
    assert entry.task is not None
    Search(entry.task, lambda _: None, answers.append).wait()
    again = answers[0].plan
    assert again is not None
    assert np.array_equal(again.trajectory.joint_positions, made.trajectory.joint_positions)
