"""An approach, and limits of accelerations and torques, in requests, bags, answers and pictures."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ff_planner_msgs.msg import Goal
from geometry_msgs.msg import Vector3
from recorded_requests import motions_in, only_request
from scipy.spatial.transform import Rotation
from test_any_frame import FRAMES
from test_approach import FORWARD, RESTING, TUMBLING, degrees_off, seen_from_grasp, with_approach
from test_tumbling import seen_from
from visualization_msgs.msg import Marker

from ff_planner_ros.analysis.plan_document import plan_document, planned_scene
from ff_planner_ros.analysis.plan_json import plan_dictionary
from ff_planner_ros.bag.plans import read_plans
from ff_planner_ros.cli import main
from ff_planner_ros.commands.verify import print_verdict
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.distance.allowed_contact import before_contact
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.motion.metrics import METRIC_BY_NAME
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.system_frame import system_frame
from ff_planner_ros.planning.problem.approach import HALF_ANGLE, Approach
from ff_planner_ros.planning.problem.problem import Limits, PlanningProblem
from ff_planner_ros.planning.problem.scene import Scene, scene_of
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.ros.messages.from_messages import problem_from_request
from ff_planner_ros.ros.messages.to_messages import request_message
from ff_planner_ros.ros.outputs.markers import plan_markers
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.replay import Verdict, replay
from ff_planner_ros.simulation.verification import Verification, verify

FRAME = "inertial"
SETTINGS = load_parameters().planner
# Accelerations and torques are limited, too, and far from what the capture needs.
ASKED = replace(
    with_approach(TUMBLING, FORWARD, 0.2, 0.26), limits=Limits(True, 0.5, (2.5,) * 7, False)
)


@pytest.fixture(scope="module")
def task() -> PlanningTask:
    return PlanningTask(ASKED, SETTINGS)


@pytest.fixture(scope="module")
def plan(task: PlanningTask) -> Plan:
    return perform(task)


@pytest.fixture(scope="module")
def bag(task: PlanningTask, plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("approach") / "bag"
    record_answer(path, task, plan, 0.5)
    return path


def problem_of(request: Any, **limits: Any) -> PlanningProblem:
    parameters = load_parameters()
    parameters = replace(parameters, limits=replace(parameters.limits, **limits))
    return problem_from_request(request, RESTING.robot, RESTING.start, (), parameters)


def test_a_corridor_comes_back_out_of_a_request() -> None:
    asked = with_approach(RESTING, np.array([0.3, -0.2, 0.7]), 0.12, 0.3)
    back = problem_of(request_message(asked, FRAME)).approach
    assert back is not None
    assert asked.approach is not None
    assert back.direction.tolist() == asked.approach.direction.tolist()
    assert (back.distance, back.half_angle) == (0.12, 0.3)
    assert problem_of(request_message(RESTING, FRAME)).approach is None
    request = request_message(asked, FRAME)
    request.goal.approach[0].half_angle = 0.0
    back = problem_of(request).approach
    assert back is not None
    assert back.half_angle == HALF_ANGLE


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"direction": Vector3()}, "direction"),
        ({"direction": Vector3(x=float("nan"))}, "direction"),
        ({"distance": 0.0}, "distance"),
        ({"distance": -0.1}, "distance"),
        ({"distance": float("inf")}, "distance"),
        ({"half_angle": -0.1}, "half_angle"),
        ({"half_angle": 1.6}, "half_angle"),
        ({"half_angle": float("nan")}, "half_angle"),
        ({"orientation": Goal.FREE}, "direction"),
    ],
)
def test_a_corridor_that_is_none_is_refused_by_the_name_of_its_field(
    changes: dict[str, Any], field: str
) -> None:
    request = request_message(with_approach(RESTING, FORWARD), FRAME)
    for name, value in changes.items():
        setattr(request.goal if name == "orientation" else request.goal.approach[0], name, value)
    with pytest.raises(InvalidInput) as refused:
        problem_of(request)
    assert refused.value.field == f"goal.approach.{field}"


def test_a_request_asks_for_lower_accelerations_than_the_parameter_and_for_no_higher() -> None:
    request = request_message(RESTING, FRAME)
    assert problem_of(request).limits.joint_accelerations is None
    assert problem_of(request, acceleration=(0.4,)).limits.joint_accelerations == (0.4,) * 7
    assert not problem_of(request, effort="none").limits.joint_torques
    lower = (*[0.3] * 6, 0.2)
    request.limits.accelerations = lower
    assert problem_of(request, acceleration=(0.4,)).limits.joint_accelerations == lower
    assert problem_of(request).limits.joint_accelerations == lower
    with pytest.raises(InvalidInput, match=r"joint_7 must not be given more than 0\.1") as refused:
        problem_of(request, acceleration=(*[0.4] * 6, 0.1))
    assert refused.value.field == "limits.accelerations"
    for wrong, field in (
        ([0.1, 0.2], "limits.accelerations"),
        ([-0.1], "limits.accelerations[0]"),
        ([*[0.1] * 6, float("nan")], "limits.accelerations[6]"),
    ):
        request.limits.accelerations = wrong
        with pytest.raises(InvalidInput) as refused:
            problem_of(request)
        assert refused.value.field == field
    request.limits.accelerations = []
    with pytest.raises(InvalidInput, match=r"^limits\.acceleration is \(0\.1, 0\.2\)"):
        problem_of(request, acceleration=(0.1, 0.2))


def test_a_bag_holds_corridor_and_limits_and_gives_the_plan_again(
    task: PlanningTask, bag: Path, tmp_path: Path
) -> None:
    recorded = only_request(bag)
    assert recorded.planned_task().digest == task.digest
    assert replay(recorded).verdict is Verdict.IDENTICAL
    ((*_, scene, _, _, _),) = motions_in(bag)
    assert scene is not None
    assert scene.approach is not None
    assert scene.approach.distance == 0.2
    (row,) = (one.row() for one in read_plans(bag))
    assert [row[f"approach_direction_{axis}"] for axis in "xyz"] == [0.0, 0.0, 1.0]
    assert (row["approach_distance_m"], row["approach_half_angle_rad"]) == (0.2, 0.26)
    assert main(["export", str(bag), "--scenarios", str(tmp_path / "scenarios")]) == 0
    (file,) = (tmp_path / "scenarios").glob("*.yaml")
    written = file.read_text()
    assert "approach:" in written
    assert "effort: none" in written


def test_a_corridor_that_no_path_keeps_to_is_another_answer(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(bag), "--set", "approach.distance=-1"]) == 2
    assert "approach.distance is -1.0" in capsys.readouterr().err
    sideways = ["--set", "approach.direction=[1, 0, 0]", "--set", "limits.acceleration=2.4"]
    assert main(["replay", str(bag), *sideways, "--set", "approach.distance=0.02"]) == 0
    told = capsys.readouterr().out
    assert "with approach.direction=[1, 0, 0], limits.acceleration=2.4," in told
    assert "SOLVED > SOLVED" in told
    for setting in (
        "approach.direction=[1, 0]",
        "limits.acceleration=all",
        "approach.half_angle=wide",
    ):
        assert main(["replay", str(bag), "--set", setting]) == 2


def test_the_report_says_and_draws_the_corridor(
    task: PlanningTask, plan: Plan, bag: Path, tmp_path: Path
) -> None:
    answer, page = tmp_path / "answer.json", tmp_path / "page.html"
    answer.write_text(json.dumps(plan_dictionary(plan, task, 0.5)))
    for source in (answer, bag):
        assert main(["report", str(source), "--output", str(page)]) == 0
        text = page.read_text()
        assert "the last 200 mm in a cone of 14.9 deg to each side" in text
        assert "approach<extra>" in text or "approach\\u003cextra" in text


def test_an_answer_in_json_tells_the_corridor_and_the_limits(
    task: PlanningTask, plan: Plan
) -> None:
    answer = json.loads(json.dumps(plan_dictionary(plan, task, 0.5)))
    assert answer["limits"]["effort"] == "none"
    assert answer["limits"]["acceleration"] == [2.5] * 7
    for found in (planned_scene(answer), plan_document(answer).scene):
        assert found is not None
        assert found.approach is not None
        assert found.approach.direction.tolist() == [0.0, 0.0, 1.0]
        assert (found.approach.distance, found.approach.half_angle) == (0.2, 0.26)


def test_the_metrics_say_how_near_accelerations_and_torques_come_to_their_limits(
    plan: Plan,
) -> None:
    highest = np.abs(plan.trajectory.joint_accelerations).max()
    margin = plan.metrics.min_acceleration_margin
    assert 2.5 - 1.05 * highest - 1e-3 < margin <= 2.5 - highest + 1e-9
    peaks = np.array(plan.metrics.peak_joint_torques)
    least = (ASKED.robot.effort_limits - peaks).min()
    assert plan.metrics.min_torque_margin == pytest.approx(least)
    assert METRIC_BY_NAME["min_torque_margin"].text(np.inf) == "no limits"
    assert plan.metrics.told("min_acceleration_margin").endswith(" deg/s2")


def executed(
    problem: PlanningProblem, plan: Plan, approach: Approach | None = None
) -> Verification:
    scene = scene_of(problem)
    scene = scene if approach is None else replace(scene, approach=approach)
    # What touches is another test's matter.
    return verify(replace(problem.robot, bodies=(), pairs=()), plan.trajectory, scene)


def test_mujoco_sees_the_end_effector_keep_to_the_corridor_or_leave_it(
    plan: Plan, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ASKED.approach is not None
    _, places = seen_from_grasp(ASKED, plan)
    # The test looks at other moments, and no margin changes by more than the place does.
    step = 3.0 * np.linalg.norm(np.diff(places, axis=0), axis=1).max()
    off = degrees_off(ASKED.approach, places)
    near = np.linalg.norm(places, axis=1) < 0.2
    for cone in (0.26, 0.5, np.deg2rad(off[near].max()) / 3):
        asked = replace(ASKED.approach, half_angle=float(cone))
        found = executed(ASKED, plan, asked).corridor
        assert found is not None
        assert found.margin == pytest.approx(asked.margins(places).values.min(), abs=step)
    scene = scene_of(ASKED)
    assert print_verdict("plan", ASKED.robot, plan.trajectory, False, scene)
    assert "approach: in the corridor's reach for good from " in capsys.readouterr().out
    sideways = replace(scene, approach=Approach(np.array([1.0, 0.0, 0.0]), 0.2))
    assert not print_verdict("plan", ASKED.robot, plan.trajectory, False, sideways)
    assert "failed: the end effector leaves the corridor" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["turned", "in orbit"])
@pytest.mark.parametrize("tumbles", [True, False])
def test_the_corridor_is_the_same_in_every_inertial_frame(
    plan: Plan, name: str, tumbles: bool
) -> None:
    problem = ASKED
    if not tumbles:
        # The same motion, to a pose that goes on as the grasp does at the capture.
        problem = replace(ASKED, target_body=None, obstacles=())
    here = executed(problem, plan).corridor
    assert here is not None
    there = seen_from(problem, FRAMES[name]) if tumbles else FRAMES[name].problem(problem)
    frame, other = (system_frame(one.robot, one.start) for one in (problem, there))
    moved = executed(there, other.plan_seen_by_user(frame.plan(plan))).corridor
    assert moved is not None
    assert moved.margin == pytest.approx(here.margin, abs=1e-6)


def corridors(plan: Plan, scene: Scene) -> list[Marker]:
    markers = plan_markers(ASKED.robot, plan, scene, FRAME).markers
    return [one for one in markers if one.ns == "approach"]


def test_markers_draw_the_corridor_where_the_grasp_is_at_the_goal(plan: Plan) -> None:
    approach, body = ASKED.approach, ASKED.target_body
    assert approach is not None
    assert body is not None
    asked, without = scene_of(ASKED), scene_of(replace(ASKED, approach=None))
    (drawn,) = corridors(plan, asked)
    assert not corridors(plan, without)
    assert len(drawn.points) % 2 == 0
    points = np.array([[one.x, one.y, one.z] for one in drawn.points])
    target = body.target(ASKED.duration)
    places = Rotation.from_quat(target.quaternion_xyzw).inv().apply(points - target.position)
    assert degrees_off(approach, places) == pytest.approx(np.rad2deg(0.26), abs=0.01)
    assert np.linalg.norm(places, axis=1).max() == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_where_contact_is_allowed_is_the_same_in_a_frame_that_moves(speed: float) -> None:
    """The goal rests in space: a frame that passes it by sees it move."""
    moving = np.array([speed, -0.5 * speed, 0.2 * speed])
    problem = replace(RESTING, contact_distance=0.3)
    motion = perform(PlanningTask(problem, SETTINGS)).trajectory
    way = np.outer(motion.time, moving)
    motion = replace(
        motion,
        chaser_positions=motion.chaser_positions - way,
        chaser_linear_velocities=motion.chaser_linear_velocities - moving,
    )
    target = replace(
        problem.target,
        position=problem.target.position - problem.duration * moving,
        linear_velocity=problem.target.linear_velocity - moving,
    )
    there = replace(problem, target=target)
    q, _ = from_trajectory(problem.robot, motion)
    last = before_contact(there, motion.time, arm_points(problem.robot, q)[:, -1])
    away = np.linalg.norm(motion.ee_positions - problem.target.position, axis=1)
    assert last == np.flatnonzero(away > 0.3)[-1]
    # So it is for who looks at the plan afterwards.
    seen = scene_of(problem).seen_from(np.zeros(3), moving).targets(motion.time)
    assert seen is not None
    assert seen + way == pytest.approx(np.tile(problem.target.position, (len(way), 1)), abs=1e-12)
    assert Scene().targets(motion.time) is None
