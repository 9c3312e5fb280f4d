"""Two answers side by side: nothing is missed, and rounding is told apart from another plan."""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import fields, replace

import numpy as np
import pytest
from answers import answer_with
from ff_planner_msgs.msg import PlanAnswer
from robots import random_urdf
from scipy.spatial.transform import Rotation

from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.metrics import METRICS, Metrics
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.robot.model import robot_from_urdf_text
from ff_planner_ros.ros.messages.answers import answer_of
from ff_planner_ros.runs.differences import QUANTITIES, differences


@pytest.fixture(scope="module")
def task(lemur_capture: PlanningProblem) -> PlanningTask:
    return PlanningTask(lemur_capture, load_parameters().planner)


def answered(plan: Plan, solve_time: float = 0.1) -> PlanAnswer:
    return answer_with(plan, solve_time=solve_time)


def test_the_same_plan_does_not_differ_however_long_it_took(
    lemur_plan: Plan, task: PlanningTask
) -> None:
    assert differences(answered(lemur_plan), task, lemur_plan) == []
    assert differences(answered(lemur_plan, 0.2), task, lemur_plan) == []


@pytest.mark.parametrize("item", fields(Trajectory), ids=lambda item: item.name)
def test_one_bit_of_any_sample_is_told_and_tolerated_and_a_thousandth_is_not(
    lemur_plan: Plan, task: PlanningTask, item: object
) -> None:
    name = item.name  # type: ignore[attr-defined]
    before = answered(lemur_plan)
    for change, is_tolerable in ((1e-15, True), (1e-3, False)):
        samples = np.array(getattr(lemur_plan.trajectory, name))
        # A message counts nanoseconds: there is no smaller change of time.
        if name == "time" and is_tolerable:
            continue
        samples[20] = samples[20] * (1 + change) + change
        changed = replace(lemur_plan, trajectory=replace(lemur_plan.trajectory, **{name: samples}))
        (found,) = differences(before, task, changed)
        assert found.quantity == name
        assert found.is_tolerable == is_tolerable
        assert "point 20" in found.where


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("item", fields(Trajectory), ids=lambda item: item.name)
def test_a_sample_may_differ_by_its_tolerance_to_either_side_and_by_no_more(
    lemur_plan: Plan, task: PlanningTask, item: object, sign: float
) -> None:
    """Of one entry alone, whichever it is; attitudes by half the angle of their turn."""
    name = item.name  # type: ignore[attr-defined]
    tolerance, before = QUANTITIES[name].tolerance, answered(lemur_plan)
    for part in (0.9, 1.1):
        samples = np.array(getattr(lemur_plan.trajectory, name))
        if name.endswith("quaternions_xyzw"):
            turn = Rotation.from_rotvec([0.0, sign * part * tolerance, 0.0])
            samples[20] = (turn * Rotation.from_quat(samples[20])).as_quat()
        else:
            samples.reshape(len(samples), -1)[20, -1] += sign * part * tolerance
        changed = replace(lemur_plan, trajectory=replace(lemur_plan.trajectory, **{name: samples}))
        (found,) = differences(before, task, changed)
        # Of times a message counts nanoseconds.
        assert found.amount == pytest.approx(part * tolerance, abs=2e-9)
        assert found.is_tolerable == (part < 1.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_a_metric_may_differ_by_is_its_own_tolerance_to_either_side(
    lemur_plan: Plan, task: PlanningTask, sign: float
) -> None:
    for metric in METRICS:
        value = getattr(lemur_plan.metrics, metric.name)
        if not isinstance(value, float) or not math.isfinite(value):
            continue
        for part in (0.5, 2.0):
            changed = replace(
                lemur_plan.metrics, **{metric.name: value + sign * part * metric.tolerance}
            )
            again = replace(lemur_plan, metrics=changed)
            found = differences(answered(lemur_plan), task, again)
            if metric.tolerance == 0.0 or math.isinf(metric.tolerance):
                continue
            (one,) = found
            assert one.is_tolerable == (part < 1.0), metric.name


def test_attitudes_differ_by_the_angle_of_the_turn_between_them(
    lemur_plan: Plan, task: PlanningTask
) -> None:
    quaternions = np.array(lemur_plan.trajectory.chaser_quaternions_xyzw)
    turn = Rotation.from_rotvec([0.0, 0.3, 0.0])
    quaternions[5] = (turn * Rotation.from_quat(quaternions[5])).as_quat()
    quaternions[9] *= -1.0  # the same attitude
    trajectory = replace(lemur_plan.trajectory, chaser_quaternions_xyzw=quaternions)
    again = replace(lemur_plan, trajectory=trajectory)
    (found,) = differences(answered(lemur_plan), task, again)
    assert found.amount == pytest.approx(0.3, abs=1e-12)
    assert str(found) == "chaser_quaternions_xyzw by 0.3 rad at point 5 (tolerance 1e-05)"


def test_another_number_of_points_cannot_be_compared(lemur_plan: Plan, task: PlanningTask) -> None:
    fewer = answered(lemur_plan)
    (motion,) = fewer.plans
    motion.joint_trajectory.points = motion.joint_trajectory.points[:-1]
    for path in (motion.chaser_path, motion.end_effector_path):
        path.poses = path.poses[:-1]
    motion.chaser_twists = motion.chaser_twists[:-1]
    motion.end_effector_twists = motion.end_effector_twists[:-1]
    found = {one.quantity: one for one in differences(fewer, task, lemur_plan)}
    assert math.isinf(found["joint_positions"].amount)
    assert found["joint_positions"].where == "shapes 49 x 7 before and 50 x 7 now"
    assert not found["time"].is_tolerable


def test_of_a_refusal_the_best_attempt_is_compared(lemur_plan: Plan, task: PlanningTask) -> None:
    nearer = replace(lemur_plan, metrics=replace(lemur_plan.metrics, min_clearance=-0.25))
    before, now = (
        NoPlanFound(Status.COLLISION, "too near", attempt) for attempt in (lemur_plan, nearer)
    )
    (found,) = differences(answer_of(before, "run.1", 0.1), task, now)
    assert found.quantity == "metrics.min_clearance"
    assert found.amount == pytest.approx(lemur_plan.metrics.min_clearance + 0.25)


def test_infinite_in_both_is_the_same_and_in_one_is_not(
    lemur_plan: Plan, task: PlanningTask
) -> None:
    free = replace(lemur_plan, metrics=replace(lemur_plan.metrics, min_clearance=math.inf))
    assert differences(answered(free), task, deepcopy(free)) == []
    (found,) = differences(answered(free), task, lemur_plan)
    assert math.isinf(found.amount)
    assert not found.is_tolerable


def test_of_a_prismatic_joint_differences_are_metres_and_newtons(
    lemur_plan: Plan, task: PlanningTask
) -> None:
    robot = robot_from_urdf_text(random_urdf(7, 1, sliding=(2,)), "bus", "tool")
    on_rail = replace(task, problem=replace(task.problem, robot=robot))
    units = {"positions": "m", "velocities": "m/s", "accelerations": "m/s2", "torques": "N"}
    for name, unit in units.items():
        for joint, told in ((1, unit), (2, QUANTITIES[f"joint_{name}"].unit)):
            samples = np.array(getattr(lemur_plan.trajectory, f"joint_{name}"))
            samples[20, joint] += 0.5
            motion = replace(lemur_plan.trajectory, **{f"joint_{name}": samples})
            changed = replace(lemur_plan, trajectory=motion)
            (found,) = differences(answered(lemur_plan), on_rail, changed)
            assert f"joint_{name} by 0.5 {told} at point 20, joint {joint + 1} (" in str(found)


def test_how_the_search_came_there_is_told_and_is_no_fault(
    lemur_plan: Plan, task: PlanningTask
) -> None:
    other = replace(lemur_plan, solver=replace(lemur_plan.solver, iterations=99))
    (found,) = differences(answered(lemur_plan), task, other)
    assert (found.quantity, found.is_tolerable) == ("solver.iterations", True)


def test_every_metric_is_compared() -> None:
    # What a clearance is of, and when it is least, is nothing beside the clearance itself.
    compared = [item.name for item in fields(Metrics) if not item.name.endswith(("_pair", "_time"))]
    assert {f"metrics.{name}" for name in compared} <= QUANTITIES.keys()


@pytest.mark.parametrize("name", ["message", "field", "value", "allowed", "retry"])
def test_the_words_of_a_refusal_are_compared_and_whether_to_ask_again_counts(
    lemur_plan: Plan, task: PlanningTask, name: str
) -> None:
    refusal = NoPlanFound(Status.COLLISION, "too near", lemur_plan)
    answer = answer_of(refusal, "run.1", 0.1)
    assert differences(answer, task, refusal) == []
    setattr(answer.status, name, 9 if name == "retry" else "another")
    (found,) = differences(answer, task, refusal)
    assert found.quantity == f"status.{name}"
    assert found.is_tolerable == (name != "retry")
    # A clock ended the recorded search, and a step the new one.
    cut = differences(answer, task.ended_at(7), refusal)
    assert [one.quantity for one in cut] == (["status.retry"] if name == "retry" else [])


@pytest.mark.parametrize("name", ["first_guess", "effort", "family", "xi"])
def test_what_a_plan_was_made_of_is_compared(
    lemur_plan: Plan, task: PlanningTask, name: str
) -> None:
    answer = answered(lemur_plan)
    (plan,) = answer.plans
    if name == "first_guess":
        answer.inputs.first_guess = [1.0]
    elif name == "effort":
        plan.effort = 9
    elif name == "family":
        plan.family = "another"
    else:
        plan.xi[0] += 1.0
    (found,) = differences(answer, task, lemur_plan)
    assert (found.quantity, found.is_tolerable) == (name, False)


def test_another_number_of_plans_is_told(lemur_plan: Plan, task: PlanningTask) -> None:
    answer = answered(lemur_plan)
    answer.plans = [answer.plans[0]] * 2
    (found,) = differences(answer, task, lemur_plan)
    assert (found.quantity, found.where) == ("plans", "2 plans before and 1 now")
