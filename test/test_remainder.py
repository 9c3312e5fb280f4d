"""What remains of the running plan is an answer, unchanged, as long as it keeps everything."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from robots import LEMUR_SCENARIO
from test_continuing import AHEAD, FAMILIES, SETTINGS, continuing, off

from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.planning.motion.forward import carried_forward
from ff_planner_ros.planning.motion.joint_motion import JointMotion, joint_motion
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import Obstacle, Parametrisation, PlanningProblem
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.search import warm_start
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.state import SystemState

SINCE = 4.0  # of the running plan, at the measurement [s]
NONE_AT_ALL = 1  # step at which a search ends that had no time


@pytest.fixture(scope="module", params=FAMILIES)
def problem(request: pytest.FixtureRequest) -> PlanningProblem:
    return replace(load_scenario(LEMUR_SCENARIO), parametrisation=request.param)


@pytest.fixture(scope="module")
def motion(problem: PlanningProblem) -> JointMotion:
    return joint_motion(perform(PlanningTask(problem, SETTINGS)).trajectory)


@pytest.fixture(scope="module")
def truth(problem: PlanningProblem, motion: JointMotion) -> SystemState:
    return carried_forward(problem.robot, problem.start, SINCE, motion)


def without_time(task: PlanningTask) -> Plan:
    return perform(replace(task, effort=NONE_AT_ALL))


def refusal_of(task: PlanningTask) -> NoPlanFound:
    with pytest.raises(NoPlanFound) as refused:
        without_time(task)
    return refused.value


@pytest.mark.law("NODE-13")
def test_a_search_without_time_answers_with_what_remains(
    problem: PlanningProblem, motion: JointMotion, truth: SystemState
) -> None:
    """The joints go on as they would have, from where the chaser is measured."""
    measured = off(truth, np.zeros(7), 1e-5)
    task = continuing(problem, motion, SINCE, measured)
    found = without_time(task)
    assert found.family == "remainder"
    assert found.coefficients.size == 0
    assert found.effort == NONE_AT_ALL
    assert found.message == "the search ends at step 1: the remainder of the running plan"
    then = SINCE + AHEAD + found.trajectory.time
    for name, wanted in zip(
        ("positions", "velocities", "accelerations"), motion.at(then), strict=True
    ):
        told = getattr(found.trajectory, f"joint_{name}")
        np.testing.assert_allclose(told, wanted, rtol=0.0, atol=1e-9, err_msg=name)
    exact = carried_forward(problem.robot, measured, AHEAD, replace(motion, time=motion.time - 4.0))
    away = found.trajectory.chaser_positions[0] - exact.position_chaser_in_inertial
    assert np.abs(away).max() < 1e-9
    assert 1e-6 < found.metrics.final_position_error <= SETTINGS.position_tolerance
    # With time it is looked for as ever.
    assert perform(task).family == problem.parametrisation


def test_with_its_tail_too(
    problem: PlanningProblem, motion: JointMotion, truth: SystemState
) -> None:
    task = continuing(problem, motion, SINCE, truth)
    for behaviour in (EndBehaviour.STOP_JOINTS, EndBehaviour.HOLD_END_EFFECTOR):
        found = without_time(replace(task, end_behaviour=behaviour, tail=1.0))
        assert found.family == "remainder"
        assert found.trajectory.time[-1] == pytest.approx(found.duration + 1.0)


@pytest.mark.law("NODE-13")
def test_what_does_not_keep_everything_any_more_is_no_answer(
    problem: PlanningProblem, motion: JointMotion, truth: SystemState
) -> None:
    task = continuing(problem, motion, SINCE, truth)
    target = replace(problem.target, position=problem.target.position + 0.004)
    moved = replace(task, problem=replace(task.problem, target=target))
    later = replace(task, problem=replace(task.problem, duration=task.problem.duration + 0.5))
    astray = continuing(problem, motion, SINCE, off(truth, np.zeros(7), 1e-3))
    place = without_time(task).trajectory.ee_positions[25]
    among = (*problem.obstacles, Obstacle.sphere("new", place, 0.02))
    blocked = replace(task, problem=replace(task.problem, obstacles=among))
    for other in (moved, later, astray, blocked):
        assert refusal_of(other).status is Status.TIMED_OUT


def test_where_no_path_is_near_it_is_the_answer(
    problem: PlanningProblem,
    motion: JointMotion,
    truth: SystemState,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It is the nearest of all, and the search from nothing would take its usual time."""
    monkeypatch.setattr(warm_start, "plans_near", lambda *_: iter(()))
    task = continuing(problem, motion, SINCE, truth)
    found = perform(task)
    assert found.family == "remainder"
    assert found.effort == 0
    assert found.message == "good enough: the remainder of the running plan"


def test_a_plan_that_passed_singular_postures_remains_an_answer() -> None:
    """A joint spline may pass them: what remains of it needs no velocity map either."""
    problem = load_scenario(LEMUR_SCENARIO)
    problem = replace(problem, parametrisation=Parametrisation.JOINT_SPLINE)
    motion = joint_motion(perform(PlanningTask(problem, SETTINGS)).trajectory)
    truth = carried_forward(problem.robot, problem.start, SINCE, motion)
    strict = replace(SETTINGS, singular_value_threshold=1.0)
    task = continuing(problem, motion, SINCE, truth)
    assert without_time(replace(task, settings=strict)).family == "remainder"
