"""A sequence whose first phase comes to rest and whose second captures: what its bag tells."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ff_planner_msgs.msg import PlanAnswer, PlanRequest
from recorded_requests import only_request

from ff_planner_ros.bag.robot_plans import robot_plans
from ff_planner_ros.cli import main
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.posture import Posture
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.planning.task.following import phase_tasks
from ff_planner_ros.planning.task.phase import Phase
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.task import perform
from ff_planner_ros.problems import tumbling
from ff_planner_ros.report.from_bag import report_of_bag
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.runs import offline_bag
from ff_planner_ros.runs.replay import Verdict, replay

REST = Posture(at_rest=True)


def mass_of(robot: Robot) -> float:
    return sum(inertia.mass for inertia in robot.model.inertias)


@pytest.fixture(scope="module")
def body() -> TargetBody:
    found = tumbling.problem("tumbling", 0).target_body
    assert found is not None
    return replace(found, mass=found.mass or 50.0)


@pytest.fixture(scope="module")
def task(body: TargetBody) -> PlanningTask:
    problem = tumbling.problem("tumbling", 0)
    free = tuple(one for one in problem.obstacles if one.body is None)
    first = replace(
        problem, target_body=None, posture=REST, obstacles=free, duration=2.0, points=20
    )
    then = Phase(duration=problem.duration, target_body=body), Phase(duration=20.0, target=REST)
    return PlanningTask(first, load_parameters().planner, then=then)


@pytest.fixture(scope="module")
def plan(task: PlanningTask) -> Plan:
    return perform(task)


@pytest.fixture
def bag(task: PlanningTask, plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The body is on its topic alone."""
    events = offline_bag._events

    def without_body(request: PlanRequest, answer: PlanAnswer, now: int) -> object:
        request.target_body = []
        return events(request, answer, now)

    monkeypatch.setattr(offline_bag, "_events", without_body)
    offline_bag.record_answer(tmp_path / "bag", task, plan, 0.5)
    return tmp_path / "bag"


def test_it_replays_with_the_body_of_the_topic(bag: Path) -> None:
    recorded = only_request(bag)
    replayed = replay(recorded)
    assert replayed.verdict is Verdict.IDENTICAL, replayed.words


def test_each_phase_has_the_scene_and_the_robot_that_it_was_planned_with(
    bag: Path, task: PlanningTask, plan: Plan
) -> None:
    found = robot_plans(bag)
    wanted = [one.problem for one, _ in phase_tasks(task, plan)]
    each = zip(found.scenes.values(), found.robots.values(), wanted, strict=True)
    for scene, robot, problem in each:
        told = scene_of(problem)
        assert [one.id for one in scene.obstacles] == [one.id for one in told.obstacles]
        assert (scene.target_body is None) == (told.target_body is None)
        assert mass_of(robot) == pytest.approx(mass_of(problem.robot))
        assert scene.capture_time == pytest.approx(told.capture_time)
    capture = scene_of(wanted[1]).goal
    assert capture is not None
    for goal in (
        list(found.scenes.values())[1].goal,
        report_of_bag(bag, 1).requests[0].then[0].goal,
    ):
        assert goal is not None
        np.testing.assert_allclose(goal.position, capture.position, atol=1e-6)


def test_its_plans_pass_verification(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", str(bag)]) == 0
    assert capsys.readouterr().out.count("verdict: passed") == 3
