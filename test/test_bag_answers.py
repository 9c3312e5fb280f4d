"""Answers of a bag: when they came, until when their plans reach, and for how many joints."""

from __future__ import annotations

from pathlib import Path

import pytest
from answers import exchange, write_bag
from ff_planner_msgs.msg import Plan
from std_msgs.msg import Empty
from test_bag_plans import response, write

from ff_planner_ros.bag import read_plans
from ff_planner_ros.bag.info import bag_document
from ff_planner_ros.errors import Status

SECOND = 10**9
START = 1_760_000_000 * SECOND


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Half a second of something else, then a refusal, plans, and something else."""
    tried = response("tried", Status.COLLISION)
    to_goal, without_tail = response("to a goal"), response("without a tail")
    tried.solver.rollouts = 3
    tried.plans = [Plan(duration=9.0)]  # which counts for nothing
    to_goal.plans[0].duration = 0.375
    answers = map(exchange, (tried, to_goal, without_tail))
    told = ("/else", Empty())
    half = SECOND // 2
    return write_bag(tmp_path / "run", told, *answers, told, start_ns=START, step_ns=half)


def test_answers_are_told_by_when_they_came_after_the_beginning(bag: Path) -> None:
    told = bag_document(bag)["answers"]
    assert [one["answered_after_s"] for one in told] == [0.5, 1.0, 1.5]


def test_the_time_of_the_goal_is_that_of_the_answer_if_it_has_a_plan(bag: Path) -> None:
    assert [plan.duration for plan in read_plans(bag)] == [None, 0.375, None]
    assert [plan.row()["planned_duration_s"] for plan in read_plans(bag)] == [None, 0.375, None]


def test_a_refusal_has_the_joints_of_the_plans(bag: Path) -> None:
    assert [plan.joint_names for plan in read_plans(bag)] == 3 * [("j0", "j1")]


def test_what_is_zero_for_want_of_an_attempt_is_none(bag: Path, tmp_path: Path) -> None:
    tried, solved, _ = read_plans(bag)
    assert tried.row()["iterations"] == 0
    (refused,) = read_plans(write(tmp_path / "other", response("refused", Status.BUSY)))
    assert {refused.row()[name] for name in ("starts", "iterations", "rollouts")} == {None}
    assert solved.row()["points"] == 3
