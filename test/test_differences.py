"""Two answers side by side: nothing is missed, and rounding is told apart from another plan."""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import fields, replace

import numpy as np
import pytest
from answers import answer_of
from ff_planner_msgs.msg import PlanAnswer
from robots import random_urdf
from scipy.spatial.transform import Rotation

from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.planning.motion.metrics import METRICS, Metrics
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.robot.model import robot_from_urdf_text
from ff_planner_ros.ros.messages.to_messages import answer_of_error
from ff_planner_ros.runs.differences import QUANTITIES, differences


def answered(plan: Plan, solve_time: float = 0.1) -> PlanAnswer:
    return answer_of(plan, solve_time=solve_time)


def test_the_same_plan_does_not_differ_however_long_it_took(lemur_plan: Plan) -> None:
    assert differences(answered(lemur_plan), answered(lemur_plan, 0.2)) == []


@pytest.mark.parametrize("item", fields(Trajectory), ids=lambda item: item.name)
def test_one_bit_of_any_sample_is_told_and_tolerated_and_a_thousandth_is_not(
    lemur_plan: Plan, item: object
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
        (found,) = differences(before, answered(changed))
        assert found.quantity == name
        assert found.is_tolerable == is_tolerable
        assert "point 20" in found.where


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("item", fields(Trajectory), ids=lambda item: item.name)
def test_a_sample_may_differ_by_its_tolerance_to_either_side_and_by_no_more(
    lemur_plan: Plan, item: object, sign: float
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
        (found,) = differences(before, answered(changed))
        # Of times a message counts nanoseconds.
        assert found.amount == pytest.approx(part * tolerance, abs=2e-9)
        assert found.is_tolerable == (part < 1.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_a_metric_may_differ_by_is_its_own_tolerance_to_either_side(
    lemur_plan: Plan, sign: float
) -> None:
    for metric in METRICS:
        value = getattr(lemur_plan.metrics, metric.name)
        if not isinstance(value, float) or not math.isfinite(value):
            continue
        for part in (0.5, 2.0):
            changed = replace(
                lemur_plan.metrics, **{metric.name: value + sign * part * metric.tolerance}
            )
            found = differences(
                answered(lemur_plan), answered(replace(lemur_plan, metrics=changed))
            )
            if metric.tolerance == 0.0 or math.isinf(metric.tolerance):
                continue
            (one,) = found
            assert one.is_tolerable == (part < 1.0), metric.name


def test_attitudes_differ_by_the_angle_of_the_turn_between_them(lemur_plan: Plan) -> None:
    quaternions = np.array(lemur_plan.trajectory.chaser_quaternions_xyzw)
    turn = Rotation.from_rotvec([0.0, 0.3, 0.0])
    quaternions[5] = (turn * Rotation.from_quat(quaternions[5])).as_quat()
    quaternions[9] *= -1.0  # the same attitude
    trajectory = replace(lemur_plan.trajectory, chaser_quaternions_xyzw=quaternions)
    (found,) = differences(
        answered(lemur_plan), answered(replace(lemur_plan, trajectory=trajectory))
    )
    assert found.amount == pytest.approx(0.3, abs=1e-12)
    assert str(found) == "chaser_quaternions_xyzw by 0.3 rad at point 5 (tolerance 1e-05)"


def test_another_number_of_points_cannot_be_compared(lemur_plan: Plan) -> None:
    fewer = answered(lemur_plan)
    (motion,) = fewer.plans
    motion.joint_trajectory.points = motion.joint_trajectory.points[:-1]
    for path in (motion.chaser_path, motion.end_effector_path):
        path.poses = path.poses[:-1]
    motion.chaser_twists = motion.chaser_twists[:-1]
    motion.end_effector_twists = motion.end_effector_twists[:-1]
    found = {one.quantity: one for one in differences(answered(lemur_plan), fewer)}
    assert math.isinf(found["joint_positions"].amount)
    assert found["joint_positions"].where == "shapes 50 x 7 before and 49 x 7 now"
    assert not found["time"].is_tolerable


def test_of_a_refusal_the_best_attempt_is_compared(lemur_plan: Plan) -> None:
    nearer = replace(lemur_plan, metrics=replace(lemur_plan.metrics, min_clearance=-0.25))
    before, now = (
        answer_of_error(NoPlanFound(Status.COLLISION, "too near", attempt), "run.1", 0.1)
        for attempt in (lemur_plan, nearer)
    )
    (found,) = differences(before, now)
    assert found.quantity == "metrics.min_clearance"
    assert found.amount == pytest.approx(lemur_plan.metrics.min_clearance + 0.25)


def test_infinite_in_both_is_the_same_and_in_one_is_not(lemur_plan: Plan) -> None:
    free = replace(lemur_plan, metrics=replace(lemur_plan.metrics, min_clearance=math.inf))
    assert differences(answered(free), answered(deepcopy(free))) == []
    (found,) = differences(answered(free), answered(lemur_plan))
    assert math.isinf(found.amount)
    assert not found.is_tolerable


def test_of_a_prismatic_joint_differences_are_metres_and_newtons(lemur_plan: Plan) -> None:
    robot = robot_from_urdf_text(random_urdf(7, 1, sliding=(2,)), "bus", "tool")
    units = {"positions": "m", "velocities": "m/s", "accelerations": "m/s2", "torques": "N"}
    for name, unit in units.items():
        for joint, told in ((1, unit), (2, QUANTITIES[f"joint_{name}"].unit)):
            samples = np.array(getattr(lemur_plan.trajectory, f"joint_{name}"))
            samples[20, joint] += 0.5
            motion = replace(lemur_plan.trajectory, **{f"joint_{name}": samples})
            changed = answered(replace(lemur_plan, trajectory=motion))
            (found,) = differences(answered(lemur_plan), changed, robot)
            assert f"joint_{name} by 0.5 {told} at point 20, joint {joint + 1} (" in str(found)


def test_how_the_search_came_there_is_told_and_is_no_fault(lemur_plan: Plan) -> None:
    other = replace(lemur_plan, solver=replace(lemur_plan.solver, iterations=99))
    (found,) = differences(answered(lemur_plan), answered(other))
    assert (found.quantity, found.is_tolerable) == ("solver.iterations", True)


def test_every_metric_is_compared() -> None:
    # What a clearance is of, and when it is least, is nothing beside the clearance itself.
    compared = [item.name for item in fields(Metrics) if not item.name.endswith(("_pair", "_time"))]
    assert {f"metrics.{name}" for name in compared} <= QUANTITIES.keys()
