"""What the hull of a mesh adds in volume is known wherever the hull travels: files, ROS, bags."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ff_planner_msgs.msg import ObstacleArray
from ff_planner_msgs.msg import Scene as SceneMessage
from quick_capture import quick_capture
from rclpy.serialization import serialize_message
from recorded_requests import only_request
from ros_processes import Scene, connected_client, private_domain, running_planner
from test_mesh_limits_of_scenarios import IN_THE_WAY, NAME, Write, box, of_obstacles
from test_meshes import stl

from ff_planner_ros.analysis.plan_document import plan_document
from ff_planner_ros.analysis.plan_json import plan_dictionary
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.messages.obstacles import bodies_of
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.scenario.scenario import Defaults, load_scenario, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.ros.client import request_of_scenario
from ff_planner_ros.ros.inputs.scene_input import SceneInput
from ff_planner_ros.ros.messages.from_messages import scene_from_message, target_body_from_message
from ff_planner_ros.ros.messages.to_messages import bodies_message, obstacles_message
from ff_planner_ros.ros.qos import LATCHED_QOS
from ff_planner_ros.runs.export_scenarios import export_scenarios
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.recorded_run import recorded_run
from ff_planner_ros.runs.replay import Verdict, replay

FRAME = "inertial"
SETTINGS = Defaults(load_parameters().planner)
# An L of three cubes: its hull has half a cube more, cut off along a diagonal.
L = np.concatenate([box([0, 0, 0], [2, 1, 1]), box([0, 1, 0], [1, 2, 1])])
SIXTH = pytest.approx(0.5 / 3.0, rel=1e-5)
WORDS = f"; meshes count by their convex hulls, which have more volume: {NAME} by 17 %"


def scenario_of(directory: Path, written: Write = of_obstacles) -> Path:
    (directory / "l.stl").write_bytes(stl(L))
    return written(directory, "l.stl")


def added(obstacles: Sequence[Any]) -> list[float]:
    """Return what the hulls of meshes among obstacles add."""
    return [
        one.shape.hull_added
        for one in obstacles
        if hasattr(one, "shape") and one.shape.kind == "mesh"
    ]


@pytest.fixture(scope="module")
def task(tmp_path_factory: pytest.TempPathFactory) -> PlanningTask:
    return load_task(scenario_of(tmp_path_factory.mktemp("l")), SETTINGS)


@pytest.fixture(scope="module")
def plan(task: PlanningTask) -> Plan:
    found = perform(task)
    assert found.message.endswith(WORDS)
    return found


@IN_THE_WAY
def test_a_scenario_that_is_written_and_written_again_has_it(
    written: Write, tmp_path: Path
) -> None:
    task = load_task(scenario_of(tmp_path, written), SETTINGS)
    for name in ("once.yaml", "twice.yaml"):
        write_scenario(task, tmp_path / name)
        again = load_task(tmp_path / name, SETTINGS)
        assert added(again.problem.obstacles) == added(task.problem.obstacles) == [SIXTH]
        assert again.digest == task.digest
        task = again


@IN_THE_WAY
def test_a_request_of_a_scenario_brings_it(written: Write, tmp_path: Path) -> None:
    bring = ("state", "obstacles", "target_body")
    request = request_of_scenario(scenario_of(tmp_path, written), FRAME, bring)
    found: list[Any] = list(scene_from_message(request.scene[0], FRAME))
    for body in request.target_body:
        found += target_body_from_message(body, FRAME).obstacles
    assert added(found) == [SIXTH]


def test_the_topic_of_bodies_has_it(task: PlanningTask) -> None:
    scenes = SceneInput(FRAME)
    scenes.keep(obstacles_message((), 10**9, FRAME))
    message = bodies_message(task.problem.obstacles, 10**9, FRAME)
    scenes.callbacks()["obstacle_bodies"](serialize_message(message))
    assert added(scenes.scene().obstacles_at(10**9)) == [SIXTH]


def test_what_a_message_says_goes_before_its_triangles(task: PlanningTask) -> None:
    message = bodies_message(task.problem.obstacles, 0, FRAME)
    corners = task.problem.obstacle_bodies[0].solid.corners
    assert len(message.bodies[0].mesh[0].vertices) == len(corners)

    def read() -> list[float]:
        return added(bodies_of(SceneMessage(bodies=message.bodies), "scene"))

    message.bodies[0].hull_added = 0.4
    assert read() == [0.4]
    message.bodies[0].hull_added = 0.0
    assert read() == [0.0]


def test_an_answer_in_a_file_has_it(task: PlanningTask, plan: Plan) -> None:
    found = plan_document(json.loads(json.dumps(plan_dictionary(plan, task, 0.5))))
    assert found.obstacles is not None
    assert added(found.obstacles) == [SIXTH]


def test_a_bag_replays_with_the_note_and_scenarios_out_of_it_have_it(
    task: PlanningTask, plan: Plan, tmp_path: Path
) -> None:
    record_answer(tmp_path / "bag", task, plan, 0.5)
    recorded = only_request(tmp_path / "bag")
    again = replay(recorded)
    assert again.verdict is Verdict.IDENTICAL
    assert again.answer is not None
    assert again.answer.status.message == plan.message
    export_scenarios(tmp_path / "bag", tmp_path / "out")
    (file,) = (tmp_path / "out").glob("*.yaml")
    assert added(load_scenario(file).obstacles) == [SIXTH]


@pytest.mark.ci
def test_a_node_tells_it_of_a_request_and_of_its_topic_and_so_does_its_bag(
    task: PlanningTask, tmp_path: Path
) -> None:
    scene = Scene(task.problem)
    with private_domain(), running_planner(tmp_path) as node:
        with connected_client() as client:
            client.wait_for_planner()
            client.wait_for_an_answer()
            answers = [client.plan(scene.complete_request())]
            topic = client.node.create_publisher(ObstacleArray, "obstacle_bodies", LATCHED_QOS)
            client.publish_obstacles(scene.obstacles())
            topic.publish(bodies_message(task.problem.obstacles, client.now_ns(), FRAME))

            def heard(answer: Any) -> bool:
                client.publish_state(scene.state(client.now_ns()))
                return bool(
                    answer.inputs.obstacle_bodies_stamp.sec and answer.status.code == Status.SOLVED
                )

            request = scene.request()
            request.plan_only = True
            answers.append(client.plan_until(request, heard))
        assert node.stop() == 0
    assert [one.status.code for one in answers] == [Status.SOLVED] * 2, answers
    assert all(one.status.message.endswith(WORDS) for one in answers), answers
    with open_bag(node.bag) as opened:
        replayed = [replay(one) for one in recorded_run(opened).requests]
    solved = [one for one in replayed if one.recorded.status == Status.SOLVED]
    assert [one.verdict for one in solved] == [Verdict.IDENTICAL] * 2
    assert all(one.answer and one.answer.status.message.endswith(WORDS) for one in solved)


@pytest.mark.parametrize(
    ("given", "status", "words"),
    [
        (float("nan"), Status.NOT_FINITE, "it must be finite"),
        (-0.1, Status.OUT_OF_RANGE, "it must not be negative"),
        ("much", Status.OUT_OF_RANGE, "it must be a number"),
    ],
)
def test_a_scenario_with_no_such_number_is_refused_by_its_place(
    given: object, status: Status, words: str, task: PlanningTask, tmp_path: Path
) -> None:
    corners = task.problem.obstacle_bodies[0].solid.corners.tolist()
    shape = {"mesh": {"vertices": corners, "hull_added": given}}
    entry = {"id": NAME, "shape": shape, "position": [30.0, 0.0, 0.0]}
    with pytest.raises(InvalidInput) as refused:
        load_scenario(quick_capture(tmp_path, obstacles=[entry]))
    (fault,) = refused.value.faults
    assert (fault.field, fault.status) == ("obstacles[0].shape.mesh.hull_added", status)
    assert words in str(fault)
