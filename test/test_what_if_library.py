"""Which library a request is planned with again, and what is told of the answer."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import pytest
from ff_planner_msgs.msg import PlanAnswer, PlanMetrics, PlanRequest

from ff_planner_ros.parameters import NodeParameters, load_parameters
from ff_planner_ros.runs import what_if


@dataclass
class Inputs:
    parameters: NodeParameters
    guesses: str | None


@dataclass
class Recorded:
    request: PlanRequest
    inputs: Inputs


def test_the_library_that_is_asked_for_is_used_and_else_that_of_the_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(what_if, "load_library", lambda path, _said: f"read from {path}")
    recorded: Any = Recorded(PlanRequest(), Inputs(load_parameters(), "of the run"))
    for changes, wanted in (
        ([what_if.Change("planner.library", "other.npz")], "read from other.npz"),
        ([what_if.Change("planner.library", "")], None),
        ([what_if.Change("planner.starts", 3)], "of the run"),
    ):
        assert what_if.changed_request(recorded, changes).inputs.guesses == wanted


def test_an_answer_is_told_in_degrees_and_millimetres() -> None:
    metrics = PlanMetrics(joint_path_length=2.5, min_clearance=0.0125)
    metrics.max_chaser_euler = math.radians(12.5)
    metrics.max_chaser_rotation = math.radians(14.25)
    answer = PlanAnswer(metrics=[metrics])
    answer.solver.rollouts, answer.solver.solve_time = 3, 0.5
    assert what_if._cells(answer)[1:] == ("2.5000", "12.500", "14.250", "12.50", "0.50")
    metrics.max_chaser_rotation = math.nan  # not recorded
    assert what_if._cells(answer)[3] == what_if._NONE
