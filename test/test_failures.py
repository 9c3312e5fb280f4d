"""What an operator is told of an attempt that does not meet its constraints."""

from __future__ import annotations

import pickle
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from shared_plans import planned

from ff_planner_ros.errors import BagError, Failure, FfPlannerError, OutOfTime, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.check.check import failures, measure, refusal
from ff_planner_ros.planning.distance.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.motion.metrics import METRIC_BY_NAME
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.problem.problem import Limits, PlanningProblem, Sphere
from ff_planner_ros.planning.problem.settings import PlannerSettings


@pytest.fixture(scope="module")
def settings() -> PlannerSettings:
    return load_parameters().planner


@pytest.fixture(scope="module")
def sound(lemur_capture: PlanningProblem, settings: PlannerSettings) -> Plan:
    return planned(lemur_capture, settings)


def judged(
    problem: PlanningProblem, sound: Plan, settings: PlannerSettings, **metrics: float
) -> list[Failure]:
    """The failures of a sound plan as the answer to another problem, with other metrics."""
    measured = replace(measure(problem, sound.trajectory, settings), **metrics)
    return list(failures(problem, replace(sound, metrics=measured), settings))


def test_a_sound_plan_has_none(
    lemur_capture: PlanningProblem, sound: Plan, settings: PlannerSettings
) -> None:
    assert judged(lemur_capture, sound, settings) == []


@pytest.mark.law("PLAN-28")
def test_every_constraint_is_told_and_the_first_gives_the_status(
    lemur_capture: PlanningProblem, sound: Plan, settings: PlannerSettings
) -> None:
    robot = lemur_capture.robot
    cramped = replace(
        lemur_capture,
        robot=replace(
            robot,
            upper_position_limits=robot.upper_position_limits - 3.0,
            velocity_limits=robot.velocity_limits / 100.0,
            effort_limits=robot.effort_limits / 100.0,
        ),
        obstacles=(Sphere("bolt", sound.trajectory.ee_positions[25], 0.05),),
        limits=Limits(joint_velocities=True),
    )
    inaccurate = {
        "min_singular_value": 0.001,
        "final_position_error": 0.1,
        "final_orientation_error": 0.1,
        "momentum_error": 0.1,
        "torque_error": 0.1,
        "start_velocity_jump": 0.1,
    }
    found = judged(cramped, sound, settings, **inaccurate)
    assert [failure.status for failure in found] == [
        Status.COLLISION,
        Status.LIMIT_VIOLATED,
        Status.LIMIT_VIOLATED,
        Status.SINGULAR,
        Status.TORQUE_TOO_HIGH,
        *[Status.CHECK_FAILED] * 5,
    ]
    error = refusal(sound, found)
    assert error.status is Status.COLLISION
    assert error.attempt is sound
    for failure in found:
        assert failure.finding in str(error)
        for word in failure.advice:
            assert str(error).count(word) >= 1
    # Both position and velocity limits say so, the operator reads it once.
    assert str(error).count("more planner.starts") == 1


def test_the_number_of_attempts_is_told(sound: Plan) -> None:
    failure = Failure(Status.COLLISION, "c1 is in the way", ("more points",))
    solver = replace(sound.solver, starts=8)
    assert str(refusal(replace(sound, solver=solver), [failure])) == (
        "no plan found in 8 attempts; in the best, c1 is in the way. What may help: more points"
    )
    assert str(refusal(sound, [failure])) == (
        "no plan found in the only attempt, c1 is in the way. What may help: more points"
    )
    assert str(refusal(sound, [failure], advice=["patience", "luck"])) == (
        "no plan found in the only attempt, c1 is in the way. What may help: patience, luck"
    )


def test_a_constraint_that_is_not_met_at_the_goal_is_told_as_the_goals(
    lemur_capture: PlanningProblem, sound: Plan, settings: PlannerSettings
) -> None:
    """Another posture or another way cannot help: the goal must change."""
    clamp = Sphere("clamp", sound.trajectory.ee_positions[-1], 0.01)
    (failure,) = judged(replace(lemur_capture, obstacles=(clamp,)), sound, settings)
    assert "inside obstacle clamp at the goal, t = 10.00 s of 10 s" in failure.finding


@pytest.mark.parametrize(("depth", "told"), [(0.001, True), (0.01, False)])
def test_a_smaller_margin_is_advised_where_it_can_make_the_difference(
    lemur_capture: PlanningProblem, sound: Plan, settings: PlannerSettings, depth: float, told: bool
) -> None:
    tip = sound.trajectory.ee_positions[-1]
    toward_arm = sound.trajectory.ee_positions[-2] - tip
    beyond = tip - 0.2 * toward_arm / np.linalg.norm(toward_arm)
    sphere = Sphere("dish", beyond, _distance(lemur_capture, sound, beyond) + depth)
    (failure,) = judged(replace(lemur_capture, obstacles=(sphere,)), sound, settings)
    assert f"{depth:g} m inside obstacle dish" in failure.finding
    assert ("a smaller planner.clearance_margin" in failure.advice) is told


def _distance(problem: PlanningProblem, sound: Plan, place: Any) -> float:
    """How near the arm comes to a place at its points."""
    q, _ = from_trajectory(problem.robot, sound.trajectory)
    positions = arm_points(problem.robot, q)
    point = Sphere("point", place, 1e-9)
    return float(
        clearances(positions, sound.trajectory.time, segments(positions), [point]).distance.min()
    )


def test_a_collision_between_the_points_is_told_as_such(
    lemur_capture: PlanningProblem, sound: Plan, settings: PlannerSettings
) -> None:
    (failure,) = judged(lemur_capture, sound, settings, min_clearance=-0.0004)
    assert "may touch obstacle" in failure.finding
    assert "all that is certain is a clearance of -0.40 mm" in failure.finding
    assert "more points" in failure.advice


def test_a_refusal_crosses_processes_with_its_attempt_and_all_failures(lemur_plan: Plan) -> None:
    failures = (
        Failure(Status.COLLISION, "the arm touches a sphere", ("more points",)),
        Failure(Status.CHECK_FAILED, "the goal is missed", ()),
    )
    copy = pickle.loads(pickle.dumps(refusal(lemur_plan, failures)))
    assert (copy.status, copy.failures) == (Status.COLLISION, failures)
    assert str(copy) == copy.constraint == str(refusal(lemur_plan, failures))
    assert copy.attempt.metrics == lemur_plan.metrics
    for item in fields(Trajectory):
        expected = getattr(lemur_plan.trajectory, item.name)
        assert np.array_equal(getattr(copy.attempt.trajectory, item.name), expected)


@pytest.mark.parametrize("error", [OutOfTime("no time is left"), BagError("the bag is damaged")])
def test_an_error_of_one_status_crosses_processes(error: FfPlannerError) -> None:
    copy = pickle.loads(pickle.dumps(error))
    assert (type(copy), copy.status, str(copy)) == (type(error), error.status, str(error))


def test_a_clearance_tells_what_it_is_of_and_when(lemur_plan: Plan) -> None:
    near = replace(
        lemur_plan.metrics,
        min_self_clearance=0.0042,
        min_self_clearance_pair="chaser/link_7",
        min_self_clearance_time=3.456,
    )
    assert near.told("min_self_clearance") == "4.2 mm, chaser/link_7 at 3.46 s"
    assert lemur_plan.metrics.told("min_self_clearance") == "no pairs"
    line, obstacle = lemur_plan.metrics.min_clearance_pair.split("/")
    assert (line, obstacle) == ("joint_4-joint_5", "c2")


@pytest.mark.parametrize(
    ("value", "words"), [(0.0123, "12.3 mm"), (np.inf, "no obstacles"), (np.nan, "none")]
)
def test_a_clearance_in_words_says_when_there_is_nothing_to_be_clear_of(
    value: float, words: str
) -> None:
    assert METRIC_BY_NAME["min_clearance"].text(value) == words
