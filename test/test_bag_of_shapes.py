"""Plans among bodies of every shape: in bags and files, and the same again."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from recorded_requests import only_request
from shaped_problems import SOLIDS, capture_among_bodies
from test_tumbling import body_of

from ff_planner_benchmark.problems import shapes, tumbling
from ff_planner_ros.analysis.plan_document import plan_document
from ff_planner_ros.analysis.plan_json import plan_dictionary
from ff_planner_ros.bag.recover import recover
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.digest import digest_of
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.collision.solids import KINDS
from ff_planner_ros.ros.messages.from_messages import scene_from_message, target_body_from_message
from ff_planner_ros.ros.messages.requests import request_of_scenario
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.replay import Verdict, replay

FRAME = "inertial"
SETTINGS = load_parameters().planner


@pytest.fixture(scope="module")
def problem() -> PlanningProblem:
    return capture_among_bodies(tumbling.problem("tumbling", 0))


@pytest.fixture(scope="module")
def task(problem: PlanningProblem) -> PlanningTask:
    return PlanningTask(problem, SETTINGS)


@pytest.fixture(scope="module")
def plan(task: PlanningTask) -> Plan:
    return perform(task)


@pytest.fixture(scope="module")
def bag(task: PlanningTask, plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    bag = tmp_path_factory.mktemp("shapes") / "bag"
    record_answer(bag, task, plan, 0.5)
    return bag


@pytest.mark.parametrize("recovered", [False, True])
def test_a_bag_has_the_bodies_and_replays_to_the_last_bit(
    task: PlanningTask, bag: Path, recovered: bool, tmp_path: Path
) -> None:
    if recovered:
        recover(bag, tmp_path / "again")
        bag = tmp_path / "again"
    recorded = only_request(bag)
    assert [one.id for one in recorded.request.scene[0].bodies] == list(SOLIDS)
    assert recorded.planned_task().digest == task.digest
    assert replay(recorded).verdict is Verdict.IDENTICAL


# At rest, moving, fixed to a target, and beside a robot of lines: shapes of every kind among them.
NEAR = (0, 1, 5, 6)


@pytest.mark.sampled
@pytest.mark.law("BAG-02")
@pytest.mark.parametrize("number", NEAR)
@pytest.mark.parametrize("sigmas", [0.0, 3.0])
def test_plans_around_each_kind_of_shape_replay_to_the_last_bit(
    number: int, sigmas: float, tmp_path: Path
) -> None:
    """Bodies that the plan goes round, with and without deviations that are kept back."""
    problem = shapes.problem(number).problem
    settings = replace(SETTINGS, robust=replace(SETTINGS.robust, sigmas=sigmas))
    task = PlanningTask(problem, settings)
    plan = perform(task)
    free = perform(PlanningTask(replace(problem, obstacles=(), target_body=None), settings))
    assert (plan.trajectory.joint_positions != free.trajectory.joint_positions).any()
    record_answer(tmp_path / "bag", task, plan, 0.5)
    recorded = only_request(tmp_path / "bag")
    assert recorded.planned_task().digest == task.digest
    assert replay(recorded).verdict is Verdict.IDENTICAL


def test_shapes_of_each_kind_are_among_these() -> None:
    kinds = {
        body.solid.kind
        for number in NEAR
        for body in shapes.problem(number).problem.obstacles
        if not body.is_sphere
    }
    assert kinds == set(KINDS) - {"sphere"}


def test_an_answer_in_a_file_has_the_bodies_of_its_task(
    problem: PlanningProblem, task: PlanningTask, plan: Plan
) -> None:
    found = plan_document(json.loads(json.dumps(plan_dictionary(plan, task, 0.5))))
    assert found.obstacles is not None
    names = [one.id for one in found.obstacles]
    assert sorted(names) == sorted(one.id for one in problem.obstacles)
    assert {digest_of(one) for one in found.obstacles} == {
        digest_of(one) for one in problem.obstacles
    }
    assert found.scene.target_body is not None
    assert digest_of(found.scene.target_body) == digest_of(body_of(problem))


def test_a_scenario_keeps_bodies_and_a_digest_tells_them_apart(
    task: PlanningTask, problem: PlanningProblem, tmp_path: Path
) -> None:
    write_scenario(task, tmp_path / "again.yaml")
    again = load_task(tmp_path / "again.yaml", Defaults(SETTINGS))
    assert again.digest == task.digest
    assert digest_of(scene_of(again.problem)) == digest_of(scene_of(problem))
    digests = {digest_of(one) for one in problem.obstacles}
    assert len(digests) == len(problem.obstacles)


def test_a_scenarios_bodies_are_brought_as_they_are(tmp_path: Path) -> None:
    problem = capture_among_bodies(tumbling.problem("tumbling", 0))
    write_scenario(PlanningTask(problem, SETTINGS), tmp_path / "capture.yaml")
    bring = ("state", "obstacles", "target_body")
    request = request_of_scenario(tmp_path / "capture.yaml", FRAME, bring)
    found = scene_from_message(request.scene[0], "scene", FRAME)
    free = [one for one in problem.obstacles if one.body is None]
    assert [digest_of(one) for one in found] == [digest_of(one) for one in free]
    body = target_body_from_message(request.target_body[0], FRAME)
    assert digest_of(body) == digest_of(problem.target_body)
