"""A bag in the console: every request, refused ones too, with the plan that was recorded."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.console.from_bag import entries_of_bag
from ff_planner_ros.console.search import Answer, Search
from ff_planner_ros.errors import Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.task.task import perform
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.recorded_run import recorded_run

NODE = Path(__file__).parent / "golden_bags" / "node"


def test_every_request_of_a_bag_is_listed_with_its_answer() -> None:
    entries, _ = entries_of_bag(NODE)
    with open_bag(NODE) as opened:
        requests = recorded_run(opened).requests
    assert len({entry.name for entry in entries}) == len(entries) == len(requests)
    for entry, request in zip(entries, requests, strict=True):
        assert request.response is not None
        assert request.response.status.message in entry.words
        assert (entry.plan is not None) == (request.status is Status.SOLVED)
        if entry.plan is not None:
            points = request.response.plans[0].joint_trajectory.points
            motion = entry.plan.phases[0].trajectory
            assert motion.joint_positions.tolist() == [list(one.positions) for one in points]
            assert entry.stages
        else:
            assert request.status is not None
            assert entry.status == f"refused, {request.status.name}"
            assert entry.error is not None
            assert entry.error.status is request.status


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
