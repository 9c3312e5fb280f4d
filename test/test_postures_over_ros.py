"""Goals of the joints in requests, answers and bags."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ff_planner_msgs.msg import Goal, PlanRequest
from recorded_requests import motions_in, only_request
from robots import CONFIG

from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import PlanningProblem, Posture
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.report.from_bag import report_of_bag
from ff_planner_ros.ros.messages.from_messages import problem_from_request
from ff_planner_ros.ros.messages.to_messages import request_message
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.replay import Verdict, replay

FRAME = "inertial"
PARAMETERS = load_parameters()
PROBLEM = replace(
    load_scenario(CONFIG / "scenarios/lemur_capture.yaml"),
    posture=Posture(np.linspace(-0.6, 0.6, 7), np.linspace(0.01, 0.02, 7)),
)


def read(request: PlanRequest) -> PlanningProblem:
    return problem_from_request(request, PROBLEM.robot, PROBLEM.start, (), PARAMETERS)


def test_a_posture_comes_back_out_of_a_request_whatever_the_order_of_its_joints() -> None:
    request = request_message(PROBLEM, FRAME)
    assert request.goal.kind == Goal.JOINTS
    joints = request.goal.joints
    joints.name = joints.name[::-1]
    joints.position, joints.velocity = joints.position[::-1], joints.velocity[::-1]
    back, asked = read(request).posture, PROBLEM.posture
    assert back is not None
    assert asked is not None
    np.testing.assert_array_equal(back.positions, asked.positions)
    np.testing.assert_array_equal(back.velocities, asked.velocities)
    joints.velocity = []
    still = read(request).posture
    assert still is not None
    assert still.velocities is None


def test_rest_comes_back_out_of_a_request() -> None:
    request = request_message(replace(PROBLEM, posture=Posture(at_rest=True)), FRAME)
    assert request.goal.kind == Goal.AT_REST
    back = read(request).posture
    assert back is not None
    assert back.at_rest


def test_a_posture_that_the_robot_does_not_have_is_refused_by_the_field_of_the_request() -> None:
    request = request_message(PROBLEM, FRAME)
    request.goal.joints.position = [0.0] * 6
    with pytest.raises(InvalidInput, match=r"goal\.joints\.position .*7 entries"):
        read(request)
    request.goal.joints.position = [9.0] * 7
    with pytest.raises(InvalidInput, match=r"goal\.joints\.position\[joint_1\]"):
        read(request)
    request.goal.joints.name[0] = "elbow"
    with pytest.raises(InvalidInput, match=r"goal\.joints\.name .*unknown: elbow"):
        read(request)


@pytest.mark.parametrize("at_rest", [False, True], ids=["posture", "rest"])
def test_a_recorded_plan_is_replayed_to_the_last_bit_and_reported(
    tmp_path: Path, at_rest: bool
) -> None:
    problem = replace(PROBLEM, posture=Posture(at_rest=True)) if at_rest else PROBLEM
    task = PlanningTask(problem, PARAMETERS.planner)
    plan = perform(task)
    record_answer(tmp_path / "bag", task, plan, 0.1)
    recorded = only_request(tmp_path / "bag")
    assert replay(recorded).verdict is Verdict.IDENTICAL
    ((*_, scene, _, _, _),) = motions_in(tmp_path / "bag")
    assert scene is not None
    assert scene.target is None
    (request,) = report_of_bag(tmp_path / "bag", 5).requests
    assert request.plan is not None
    assert ("with joints at rest the system turns" in request.message) == at_rest
