"""The console's curves and its picture of plans: numbers of the plan, where they are drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ff_planner_ros.common.share import share_directory
from ff_planner_ros.console.curves import (
    ATTITUDE,
    CLEARANCE,
    NAMES,
    TORQUES,
    VELOCITIES,
    _data,
    curves_of,
)
from ff_planner_ros.console.stages import Stage, stages_of
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.task.task import PlanningTask, perform


@pytest.fixture(scope="module")
def task() -> PlanningTask:
    scenario = share_directory() / "config" / "scenarios" / "lemur_capture_bodies.yaml"
    return load_task(scenario, Defaults(load_parameters().planner))


@pytest.fixture(scope="module")
def plan(task: PlanningTask) -> Plan:
    return perform(task)


@pytest.fixture(scope="module")
def stages(task: PlanningTask, plan: Plan) -> tuple[Stage, ...]:
    return stages_of(task, plan)


def test_the_least_clearance_is_the_certified_one(stages: tuple[Stage, ...], plan: Plan) -> None:
    curves = curves_of(CLEARANCE, stages)
    assert curves is not None
    (distance,) = curves.values.values()
    least = 1e3 * plan.metrics.min_clearance
    # What is certified is at most half a millimetre, or 2 %, less.
    assert least <= np.nanmin(distance) + 1e-6
    assert np.nanmin(distance) <= max(least + 0.5, 1.02 * least) + 0.1
    assert curves.limits == (0.0,)


def test_the_largest_angle_is_the_plans(stages: tuple[Stage, ...], plan: Plan) -> None:
    curves = curves_of(ATTITUDE, stages)
    assert curves is not None
    largest = max(np.abs(one).max() for one in curves.values.values())
    assert largest == pytest.approx(np.rad2deg(plan.metrics.max_chaser_euler), rel=1e-6)
    assert curves.limits == ()
    limits = replace(stages[0].problem.limits, chaser_attitude=0.5)
    limited = replace(stages[0], problem=replace(stages[0].problem, limits=limits))
    kept = curves_of(ATTITUDE, [limited])
    assert kept is not None
    assert kept.limits == pytest.approx((-np.rad2deg(0.5), np.rad2deg(0.5)))


@pytest.mark.parametrize(
    ("name", "field", "limits"),
    [
        (VELOCITIES, "joint_velocities", "velocity_limits"),
        (TORQUES, "joint_torques", "effort_limits"),
    ],
)
def test_each_joint_is_drawn_as_a_part_of_its_own_limit(
    stages: tuple[Stage, ...], plan: Plan, name: str, field: str, limits: str
) -> None:
    robot = stages[0].problem.robot
    most = getattr(robot, limits).copy()
    most[2] = np.inf
    unlimited = replace(robot, **{limits: most})
    stage = replace(stages[0], problem=replace(stages[0].problem, robot=unlimited))
    curves = curves_of(name, [stage])
    assert curves is not None
    assert curves.limits == (-100.0, 100.0)
    assert list(curves.values) == [one for k, one in enumerate(robot.joint_names) if k != 2]
    for joint, drawn in curves.values.items():
        k = robot.joint_names.index(joint)
        true = 100.0 * getattr(plan.trajectory, field)[:, k] / most[k]
        assert drawn == pytest.approx(true, abs=1e-9)


def test_nothing_is_drawn_before_anything_is_planned(task: PlanningTask) -> None:
    assert [curves_of(name, stages_of(task, None)) for name in NAMES] == [None] * 4


def test_phases_are_one_curve() -> None:
    scenario = share_directory() / "config" / "scenarios" / "whole_capture.yaml"
    task = load_task(scenario, Defaults(load_parameters().planner))
    stages = stages_of(task, perform(task))
    for name in (ATTITUDE, VELOCITIES):
        curves = curves_of(name, stages)
        assert curves is not None
        assert curves.times[-1] == pytest.approx(stages[-1].end)
        assert (np.diff(curves.times) > 0.0).all()


@pytest.mark.parametrize("time", [0.0, 3.21, 10.0])
def test_a_line_stands_at_the_time_of_the_slider(stages: tuple[Stage, ...], time: float) -> None:
    curves = curves_of(ATTITUDE, stages)
    assert curves is not None
    times, *others, now = _data(curves, time)
    (at,) = np.nonzero(np.isfinite(now))
    assert times[at].tolist() == [time, time]
    assert now[at[0]] < min(one.min() for one in others)
    assert now[at[1]] > max(one.max() for one in others)
    for drawn, true in zip(others, curves.values.values(), strict=True):
        assert np.delete(drawn, at) == pytest.approx(true)
