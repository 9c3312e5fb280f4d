"""Paths to follow in requests, answers and bags."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ff_planner_msgs.msg import Goal, PlanRequest
from ff_planner_msgs.msg import Phase as PhaseMessage
from published_paths import p2c, p5
from recorded_requests import only_request

from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import Objective, PlanningProblem
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.ros.messages.from_messages import problem_from_request
from ff_planner_ros.ros.messages.phases import phases_in
from ff_planner_ros.ros.messages.requests import request_of_task
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.replay import Verdict, replay

FRAME = "inertial"
PARAMETERS = load_parameters()
SHORTEST = Objective(joint_path_length=1.0, chaser_attitude=0.0)


def asked(problem: PlanningProblem) -> PlanRequest:
    return request_of_task(PlanningTask(problem, PARAMETERS.planner), FRAME)


def read(request: PlanRequest, problem: PlanningProblem) -> PlanningProblem:
    return problem_from_request(request, problem.robot, problem.start, (), PARAMETERS)


@pytest.mark.parametrize("problem", [p2c(), p5(300.0, 1e-3, 61)], ids=["pose", "place"])
def test_a_path_comes_back_out_of_a_request(problem: PlanningProblem) -> None:
    request = asked(problem)
    assert request.goal.kind == Goal.FOLLOW
    for duration in (request.duration, 0.0):
        request.duration = duration
        back = read(request, problem)
        assert back.path is not None
        assert problem.path is not None
        assert back.duration == problem.duration
        np.testing.assert_array_equal(back.path.times, problem.path.times)
        np.testing.assert_array_equal(back.path.positions, problem.path.positions)
        assert back.path.turns is problem.path.turns
        assert back.path.position_tolerance == problem.path.position_tolerance
        assert back.path.orientation_tolerance == problem.path.orientation_tolerance
        for one, other in zip(back.path.points, problem.path.points, strict=True):
            if one.quaternion_xyzw is not None:
                # Read, a quaternion is scaled to unit length once more.
                np.testing.assert_allclose(one.quaternion_xyzw, other.quaternion_xyzw, atol=1e-15)


def test_tolerances_that_a_request_leaves_out_are_a_thousandth() -> None:
    problem = p2c()
    request = asked(problem)
    request.limits.path_position_tolerance = request.limits.path_orientation_tolerance = []
    back = read(request, problem).path
    assert back is not None
    assert (back.position_tolerance, back.orientation_tolerance) == (1e-3, 1e-3)


def test_a_path_that_cannot_be_followed_is_refused_by_the_field_of_the_request() -> None:
    problem = p2c()

    def refused(words: str) -> None:
        with pytest.raises(InvalidInput, match=words):
            read(request, problem)

    request = asked(problem)
    request.goal.path[0].poses[3].header.stamp.sec = 0
    refused(r"^goal\.path\.poses\[3\]\.header\.stamp is .*later than that of the point before")
    request = asked(problem)
    request.goal.path[0].poses[2].pose.position.y = np.nan
    refused(r"^goal\.path\.poses\[2\]\.pose\.position")
    request = asked(problem)
    request.goal.path[0].poses[2].pose.orientation.w = 7.0
    refused(r"^goal\.path\.poses\[2\]\.pose\.orientation")
    request = asked(problem)
    request.goal.path[0].poses = request.goal.path[0].poses[:1]
    refused(r"^goal\.path\.poses is 1 points")
    request = asked(problem)
    request.goal.path[0].header.frame_id = "moon"
    refused(r"^goal\.path\.header\.frame_id is 'moon'")
    request = asked(problem)
    request.goal.path = []
    refused(r"^goal\.path is missing")
    request = asked(problem)
    request.limits.path_position_tolerance = [-1.0]
    refused(r"^limits\.path_position_tolerance")
    request = asked(problem)
    request.duration = 3.0
    refused(r"^duration is 3")
    request = asked(problem)
    request.goal.orientation = Goal.ABOUT_AXIS
    refused(r"^goal\.orientation is 2")


def test_a_path_in_a_later_phase_is_refused() -> None:
    problem = p2c()
    request = request_of_task(PlanningTask(problem, PARAMETERS.planner), FRAME)
    request.then = [PhaseMessage(goal=request.goal, limits=request.limits)]
    with pytest.raises(InvalidInput, match=r"^then\[0\]\.goal\.path\S* is given: a path is foll"):
        phases_in(request, problem.robot, PARAMETERS, None)


def test_a_recorded_plan_along_a_path_is_replayed_to_the_last_bit(tmp_path: Path) -> None:
    task = PlanningTask(replace(p2c(), objective=SHORTEST), PARAMETERS.planner)
    plan = perform(task)
    record_answer(tmp_path / "bag", task, plan, 0.1)
    recorded = only_request(tmp_path / "bag")
    assert '"position_tolerance"' in recorded.task
    assert replay(recorded).verdict is Verdict.IDENTICAL
