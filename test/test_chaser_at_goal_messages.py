"""The chaser's attitude at the goal in requests: read, written and refused by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ff_planner_msgs.msg import Phase, PlanRequest
from geometry_msgs.msg import Quaternion
from robots import CONFIG
from ros_processes import FRAME

from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import ChaserGoal, PlanningProblem, Posture
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.ros.messages.from_messages import problem_from_request
from ff_planner_ros.ros.messages.phases import phases_in
from ff_planner_ros.ros.messages.requests import change_request, request_of_task
from ff_planner_ros.ros.messages.to_messages import request_message

PARAMETERS = replace(load_parameters(), inertial_frame=FRAME)
SETTINGS = PARAMETERS.planner
TURNED = np.array([0.0, 0.6, 0.0, 0.8])
GOALS = [ChaserGoal(rotation=0.02), ChaserGoal(quaternion_xyzw=TURNED, tolerance=0.05)]


def read(problem: PlanningProblem, request: PlanRequest) -> PlanningProblem:
    return problem_from_request(request, problem.robot, problem.start, (), PARAMETERS)


@pytest.mark.parametrize("goal", GOALS, ids=["rotation", "attitude"])
@pytest.mark.parametrize("posture", [None, "posture", "rest"])
def test_a_request_has_it_beside_any_goal(
    lemur_capture: PlanningProblem, goal: ChaserGoal, posture: str | None
) -> None:
    kinds = {"posture": Posture(np.zeros(7)), "rest": Posture(at_rest=True), None: None}
    problem = replace(lemur_capture, chaser_goal=goal, posture=kinds[posture])
    request = request_message(problem, FRAME)
    assert len(request.goal.chaser_rotation) == (goal.rotation is not None)
    assert len(request.goal.chaser_attitude) == (goal.rotation is None)
    if goal.rotation is None:
        told = request.goal.chaser_attitude[0]
        assert [told.x, told.y, told.z, told.w] == TURNED.tolist()
        assert list(request.limits.chaser_tolerance) == [0.05]
    found = read(problem, request).chaser_goal
    assert (found.rotation, found.tolerance) == (goal.rotation, goal.tolerance)
    assert np.array_equal(found.wanted(np.zeros(4)), goal.wanted(np.zeros(4)))


def test_a_request_without_it_asks_for_any_attitude(lemur_capture: PlanningProblem) -> None:
    request = request_message(lemur_capture, FRAME)
    assert read(lemur_capture, request).chaser_goal.most == np.inf


def test_phases_have_their_own() -> None:
    task = load_task(CONFIG / "scenarios/whole_capture.yaml", Defaults(SETTINGS))
    then = (replace(task.then[0], chaser_goal=GOALS[0]), *task.then[1:])
    request = request_of_task(replace(task, then=then), FRAME)
    assert [list(one.goal.chaser_rotation) for one in request.then][:2] == [[0.02], []]
    assert not request.goal.chaser_rotation


@pytest.mark.parametrize(
    ("rotation", "attitude", "words"),
    [
        ([0.0], [], "goal.chaser_rotation is 0.0: it must be greater than 0"),
        ([], [Quaternion(w=2.0)], "goal.chaser_attitude is [0.0, 0.0, 0.0, 2.0]"),
        (
            [0.1],
            [Quaternion(w=1.0)],
            "goal.chaser_attitude is [0.0, 0.0, 0.0, 1.0]: with chaser_rotation it must be left",
        ),
    ],
)
def test_a_request_is_refused_by_the_name_of_its_field(
    lemur_capture: PlanningProblem, rotation: list[float], attitude: list[Quaternion], words: str
) -> None:
    request = request_message(lemur_capture, FRAME)
    request.goal.chaser_rotation, request.goal.chaser_attitude = rotation, attitude
    with pytest.raises(InvalidInput) as refused:
        read(lemur_capture, request)
    assert words in str(refused.value)
    request.then = [Phase(goal=request.goal, duration=5.0)]
    with pytest.raises(InvalidInput) as refused:
        phases_in(request, lemur_capture.robot, PARAMETERS, None)
    assert f"then[0].{words}" in str(refused.value)


def test_ask_sets_it_by_the_keys_of_a_scenario() -> None:
    request = PlanRequest()
    change_request(request, ["target.chaser_rotation=0.1"])
    assert list(request.goal.chaser_rotation) == [0.1]
    change_request(
        request, ["target.chaser_quaternion_xyzw=[0, 0.6, 0, 0.8]", "target.chaser_tolerance=0.2"]
    )
    told = request.goal.chaser_attitude[0]
    assert [told.x, told.y, told.z, told.w] == TURNED.tolist()
    assert list(request.limits.chaser_tolerance) == [0.2]
