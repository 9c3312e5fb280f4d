"""The console's curves and its picture of plans: numbers of the plan, where they are drawn."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from ff_planner_ros.common.share import share_directory
from ff_planner_ros.console.changes import weighted
from ff_planner_ros.console.curves import (
    ATTITUDE,
    CLEARANCE,
    NAMES,
    TORQUES,
    VELOCITIES,
    _data,
    curves_of,
)
from ff_planner_ros.console.entries import Entry
from ff_planner_ros.console.pareto import picture_of
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


def test_a_picture_has_every_plan_where_it_is_and_the_chosen_one_of_another_shape(
    task: PlanningTask, plan: Plan
) -> None:
    def made(name: str, length: float, attitude: float) -> Entry:
        metrics = replace(plan.metrics, joint_path_length=length, max_chaser_euler=attitude)
        weights = weighted(task, 1.0, 10.0 * attitude)
        return Entry(name, weights, replace(plan, metrics=metrics), status="planned")

    entries = [made("plan 1", 1.0, 0.3), made("<2>", 2.0, 0.2), made("plan 3", 3.0, 0.1)]
    refused = Entry("plan 4", task, status="refused, COLLISION")
    picture = picture_of([*entries, refused], entries[1])
    circles = re.findall(r"<circle cx='([\d.]+)' cy='([\d.]+)'", picture)
    ((x, y),) = re.findall(r"<rect x='([\d.]+)' y='([\d.]+)' width='12'", picture)
    places = np.array([circles[0], (x, y), circles[1]], dtype=float)
    places[1] += 6.0
    assert np.diff(places, axis=0)[0] == pytest.approx(np.diff(places, axis=0)[1], abs=0.2)
    assert (np.diff(places[:, 0]) > 0.0).all()
    assert (np.diff(places[:, 1]) > 0.0).all()  # down the page
    assert "&lt;2&gt;: joint path 2.0000 rad, attitude 11.459 deg, weights 1 and 2" in picture
    assert "<2>" not in picture
    assert "plan 4" not in picture
    assert "Two plans or more" in picture_of(entries[:1], entries[0])
