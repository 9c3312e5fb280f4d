"""A whole capture flown by two free bodies that a weld joins comes out as predicted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from robots import CONFIG

from ff_planner_ros.cli import main
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.task import perform
from ff_planner_ros.problems import captured
from ff_planner_ros.simulation.whole_flight import fly

SETTINGS = load_parameters().planner
# Asked for: at the grasp, and at the end [m], [rad].
AT_GRASP, AT_END = np.array([1e-3, np.deg2rad(0.1)]), np.array([5e-3, np.deg2rad(0.5)])

pytestmark = pytest.mark.ci


@pytest.fixture(scope="module")
def flown() -> tuple[PlanningTask, Plan]:
    task = load_task(CONFIG / "scenarios/whole_capture.yaml", Defaults(SETTINGS))
    return task, perform(task)


def test_the_whole_capture_is_flown_as_planned(flown: tuple[PlanningTask, Plan]) -> None:
    grasped, stopped, stowed = fly(*flown)
    assert (np.array([grasped.grasp, grasped.end_effector]) < AT_GRASP).all()
    for one in (stopped, stowed):
        assert (np.array([one.end_effector, one.chaser]) < AT_END).all()
        # The weld holds: the grasp is where it was.
        np.testing.assert_allclose(one.grasp, grasped.grasp, atol=1e-6)


def test_another_mass_than_planned_with_ends_elsewhere(flown: tuple[PlanningTask, Plan]) -> None:
    task, plan = flown
    body = task.problem.target_body
    assert body is not None
    heavy = replace(body, mass=2.0 * body.mass, inertia=2.0 * body.inertia)
    true = replace(task, problem=replace(task.problem, target_body=heavy))
    *_, stowed = fly(true, plan)
    assert stowed.chaser[0] > 10.0 * AT_END[0]


@pytest.mark.parametrize("number", range(4))
def test_whole_captures_of_the_benchmark_come_true(number: int) -> None:
    task = captured.problem("whole capture", number).task(SETTINGS)
    reached = fly(task, perform(task))
    assert (np.array(reached[0].grasp) < AT_GRASP).all()
    assert (np.array([reached[-1].end_effector, reached[-1].chaser]) < AT_END).all()


def test_what_captures_nothing_is_refused(flown: tuple[PlanningTask, Plan]) -> None:
    task, plan = flown
    still = replace(task.problem, target_body=None, obstacles=(), allowed_collisions=())
    with pytest.raises(InvalidInput, match="captures a body first"):
        fly(replace(task, problem=still, then=()), plan)


def test_the_demonstration_flies_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "whole_capture", "--output", str(tmp_path)]) == 0
    assert "replay of the bag: identical" in capsys.readouterr().out
