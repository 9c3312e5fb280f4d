"""A task that is recorded as JSON text comes back whole, whatever is in it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from robots import CONFIG, LEMUR_SCENARIO, random_state, random_urdf
from shaped_problems import among_bodies, capture_among_bodies
from test_meshes import BOX, stl, urdf_with
from test_pairs import disabling
from test_scenario_writer import random_task

from ff_planner_benchmark.problems.classes import ALL_FEATURES, CLASSES
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.joint_motion import JointMotion, joint_motion
from ff_planner_ros.planning.problem.camera import Camera
from ff_planner_ros.planning.problem.posture import Posture
from ff_planner_ros.planning.problem.problem import (
    Approach,
    DurationRange,
    Limits,
    Objective,
    Orientation,
    Parametrisation,
    PlanningProblem,
    Target,
)
from ff_planner_ros.planning.problem.settings import PlannerSettings, RobustSettings, SearchDepth
from ff_planner_ros.planning.problem.user_requirements import requirements_read
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.scenario.task_json import task_from_json, task_json, urdf_digest
from ff_planner_ros.planning.task.controller_rules import Controller
from ff_planner_ros.planning.task.phase import Phase
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import perform
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Base, Robot, load_robot, robot_from_urdf_text
from ff_planner_ros.robot.urdf.payload import Payload, with_payload
from ff_planner_ros.robot.wheels import Wheels

SETTINGS = load_parameters().planner
ENDS = ("bus", "tool")
SCENARIOS = sorted((CONFIG / "scenarios").glob("*.yaml"))
# The robots of the others have limits that no URDF says, and the frame moves.
DRAWN = [kind for kind in CLASSES if kind is not ALL_FEATURES]


def scenario(name: str, settings: PlannerSettings = SETTINGS) -> PlanningTask:
    return load_task(CONFIG / "scenarios" / f"{name}.yaml", Defaults(settings))


def refused(word: str) -> float:
    raise ValueError(f"{word} is no JSON")


def require_comes_back(task: PlanningTask) -> PlanningTask:
    """Write a task and read it, with its URDF in the text and by name; return what was read."""
    drawn = task.problem.robot.drawn_urdf
    whole, named = task_json(task), task_json(task, drawn)
    for text, known in ((whole, {}), (named, {urdf_digest(drawn): drawn})):
        json.loads(text, parse_constant=refused)
        back = task_from_json(text, known)
        assert back.digest == task.digest
        assert back.settings == task.settings
        assert (back.effort, back.controller) == (task.effort, task.controller)
        assert [one.effort for one in back.then] == [one.effort for one in task.then]
    assert task_json(back) == whole
    assert drawn not in json.loads(named)["robot"].values()
    return back


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_every_scenario_comes_back(path: Path) -> None:
    require_comes_back(load_task(path, Defaults(SETTINGS)))


@pytest.mark.sampled
@pytest.mark.parametrize("number", range(2))
@pytest.mark.parametrize("kind", DRAWN, ids=lambda kind: kind.name)
def test_every_problem_that_is_drawn_comes_back(kind: Any, number: int) -> None:
    require_comes_back(kind.task(number, SETTINGS))


@pytest.mark.parametrize("seed", range(20))
def test_a_task_of_any_numbers_comes_back(lemur: Robot, seed: int) -> None:
    require_comes_back(random_task(lemur, seed))


def any_robot(urdf: str, **how: Any) -> Robot:
    return robot_from_urdf_text(urdf, *ENDS, **how)


def of_mesh(directory: Path, srdf: str | None = None, **how: Any) -> Robot:
    (directory / "box.stl").write_bytes(stl(BOX))
    file, pairs = directory / "arm.urdf", directory / "arm.srdf"
    file.write_text(urdf_with('<mesh filename="box.stl" scale="0.3 1.1 0.7"/>'), "utf-8")
    if srdf is not None:
        pairs.write_text(srdf, "utf-8")
    return load_robot(file, *ENDS, srdf=None if srdf is None else pairs, **how)


WHEELS = Wheels(np.vstack([np.eye(3), np.ones(3)]), (1.0, 2.0, 3.0, 4.0), (0.5,))
HELD = Payload("link_3", 4.0, np.diag([0.1, 0.2, 0.15]), np.array([0.0, 0.1, 0.0]))
ROBOTS: dict[str, Callable[[Path], Robot]] = {
    "meshes": of_mesh,
    "meshes, lines kept clear": lambda place: of_mesh(place, geometry=Geometry.LINES),
    "an SRDF": lambda place: of_mesh(place, disabling(("link_1", "link_4"))),
    "an SRDF that names nobody": lambda place: of_mesh(place, disabling()),
    "a locked joint": lambda _: any_robot(random_urdf(5, 3), held_at={"joint_2": 0.3}),
    "slides": lambda _: any_robot(random_urdf(5, 3, (1, 4)), slide_weight=7.5),
    "slides locked": lambda _: any_robot(random_urdf(5, 3, (1, 4)), slide_weight=0.0),
    "wheels": lambda _: any_robot(random_urdf(6, 3), base=Base.ATTITUDE_HELD, wheels=WHEELS),
    "an attitude that is held": lambda _: any_robot(random_urdf(6, 3), base=Base.ATTITUDE_HELD),
    "a payload": lambda _: with_payload(any_robot(random_urdf(5, 3)), HELD),
    "a payload and an SRDF": lambda place: with_payload(
        of_mesh(place, disabling(("link_1", "link_4"))), HELD, touching=("link_4",)
    ),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_comes_back_without_its_files(name: str, tmp_path: Path) -> None:
    robot = ROBOTS[name](tmp_path)
    start = random_state(robot, np.random.default_rng(5))
    if robot.wheels is not None:
        # Wheels hold the chaser: it does not turn.
        still = np.zeros(3)
        start = replace(start, angular_velocity_chaser_in_inertial=still)
        start = replace(start, wheel_momenta=np.arange(float(robot.wheels.count)) / 7.0)
    unturned = start.quaternion_chaser_to_inertial_xyzw
    goal = Target(start.position_chaser_in_inertial, unturned, orientation=Orientation.FREE)
    problem = PlanningProblem(robot, start, goal, 5.0, 20, (), Objective(1.0, 0.0))
    for file in tmp_path.iterdir():
        file.unlink()
    back = require_comes_back(PlanningTask(problem, SETTINGS)).problem.robot
    assert (back.pairs, back.may_touch) == (robot.pairs, robot.may_touch)
    np.testing.assert_array_equal(back.effort_limits, robot.effort_limits)
    np.testing.assert_array_equal(back.velocity_limits, robot.velocity_limits)


@pytest.fixture(scope="module")
def capture() -> PlanningTask:
    return load_task(LEMUR_SCENARIO, Defaults(SETTINGS))


def other(value: Any) -> Any:
    """Return another value that a setting may have."""
    match value:
        case RobustSettings():
            return RobustSettings(1.5, 0.1, 0.2, 0.3, 1e-3, 1e-300)
        case SearchDepth():
            return SearchDepth.THOROUGH
        case int():
            return value + 1
        case _:
            return (value or 1e-7) / 3.0


@pytest.mark.parametrize("name", [item.name for item in fields(PlannerSettings)])
def test_every_setting_comes_back(capture: PlanningTask, name: str) -> None:
    settings = replace(SETTINGS, **{name: other(getattr(SETTINGS, name))})
    assert settings != SETTINGS
    require_comes_back(replace(capture, settings=settings))


EVERY_LIMIT = Limits(True, 0.3, tuple(np.arange(1.0, 8.0) / 3.0), True, 0.7, 40.0, 9.0, 1.5)
LIMITS = {
    "none": Limits(joint_torques=False),
    "some": replace(EVERY_LIMIT, chaser_attitude=math.inf, grasp_torque=math.inf),
    "all": EVERY_LIMIT,
}


@pytest.mark.parametrize("name", LIMITS)
def test_limits_come_back_and_infinite_ones_are_none(capture: PlanningTask, name: str) -> None:
    limits = LIMITS[name]
    back = require_comes_back(replace(capture, problem=replace(capture.problem, limits=limits)))
    assert back.problem.limits == limits


def running(capture: PlanningTask) -> JointMotion:
    return joint_motion(perform(capture).trajectory)


@pytest.mark.parametrize(
    "changed",
    [
        {"controller": None},
        {"controller": Controller(False, True, 0.01), "end_behaviour": EndBehaviour.STOP_JOINTS,
         "tail": 2.0},
        {"controller": Controller(True, False), "end_behaviour": EndBehaviour.HOLD_END_EFFECTOR,
         "tail": 1.0 / 3.0},
        {"first_guess": np.array([1e-300, -0.0, 1.0 / 3.0])},
        {"ahead": 0.1 + 0.2, "effort": 2**53},
    ],
)  # fmt: skip
def test_what_is_around_the_problem_comes_back(
    capture: PlanningTask, changed: dict[str, Any]
) -> None:
    require_comes_back(replace(capture, **changed))


def test_a_motion_that_is_taken_over_comes_back_to_the_last_bit(capture: PlanningTask) -> None:
    motion = running(capture)
    for goal in (None, float(motion.time[-1])):
        back = require_comes_back(replace(capture, ahead=3.0, running=motion, running_goal=goal))
        assert back.running is not None
        for item in fields(JointMotion):
            ours: Array = getattr(motion, item.name)
            assert getattr(back.running, item.name).tobytes() == ours.tobytes()


def test_a_problem_with_everything_beside_the_goal_comes_back(capture: PlanningTask) -> None:
    problem = replace(
        capture.problem,
        approach=Approach(np.array([0.0, 0.0, 1.0]), 0.2, 0.3),
        camera=Camera("end_effector", np.zeros(3), np.array([0.0, 0.0, 1.0]), 1.0, 0.1),
        duration_range=DurationRange(9.0, 11.0),
        parametrisation=Parametrisation.JOINT_SPLINE,
    )
    require_comes_back(replace(capture, problem=replace(problem, duration=11.0)))


def test_a_captured_body_and_phases_come_back() -> None:
    alone = scenario("lemur_tumbling")
    # Obstacles of every shape, some fixed to the body.
    require_comes_back(
        replace(alone, problem=capture_among_bodies(scenario("whole_capture").problem))
    )
    bodies = scenario("lemur_capture_bodies")
    require_comes_back(replace(bodies, problem=among_bodies(bodies.problem)))
    joints = np.zeros(7)
    phases = (
        Phase(4.0, Posture(joints), effort=7, limits=EVERY_LIMIT, points=9),
        Phase(
            DurationRange(2.0, 3.0), Posture(joints + 0.1, joints), objective=Objective(0.0, 1.0)
        ),
        # Without the limits of the one before.
        Phase(2.0, Posture(joints), limits=Limits(joint_torques=False)),
        Phase(1.0, Posture(at_rest=True), payload=replace(HELD, link="end_effector")),
    )
    back = require_comes_back(replace(bodies, then=phases))
    assert [one.limits for one in back.then[:3]] == [EVERY_LIMIT, EVERY_LIMIT, phases[2].limits]


def test_a_body_of_any_attitude_comes_back_to_the_last_bit() -> None:
    tumbling = scenario("lemur_tumbling")
    units = np.random.default_rng(0).normal(size=(3000, 4))
    for _ in range(3):
        before, units = units, np.array([one / np.linalg.norm(one) for one in units])
    for unit in units[(units != before).any(axis=1)][:3]:  # which change each time
        body = replace(tumbling.problem.target_body, quaternion_xyzw=unit)
        require_comes_back(replace(tumbling, problem=replace(tumbling.problem, target_body=body)))


def test_a_requirement_of_a_plug_in_comes_back(
    capture: PlanningTask, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from test_plug_ins import GIVEN, write_distribution

    monkeypatch.syspath_prepend(write_distribution(tmp_path / "site"))
    problem = replace(capture.problem, requirements=requirements_read("requirements", GIVEN))
    (back,) = require_comes_back(replace(capture, problem=problem)).problem.requirements
    assert back.name == "keep_out_plane"


QUICK = replace(SETTINGS, starts=2, max_iterations=30)
PERFORMED: dict[str, Callable[[], PlanningTask]] = {
    "a capture": lambda: scenario("lemur_capture", QUICK),
    "wheels": lambda: scenario("lemur_wheels", QUICK),
    "a body that tumbles": lambda: scenario("lemur_tumbling", QUICK),
    "on a table": lambda: scenario("planar_capture", QUICK),
    "robust": lambda: scenario(
        "lemur_capture", replace(QUICK, robust=replace(QUICK.robust, sigmas=1.0))
    ),
    "any orientation": lambda: _of_free_orientation(),
}


def _of_free_orientation() -> PlanningTask:
    task = scenario("lemur_capture", QUICK)
    goal = replace(task.problem.target, orientation=Orientation.FREE)
    return replace(task, problem=replace(task.problem, target=goal))


@pytest.mark.parametrize("name", PERFORMED)
def test_what_comes_back_has_the_same_plan_to_the_last_bit(name: str) -> None:
    task = PERFORMED[name]()
    ours, theirs = perform(task), perform(require_comes_back(task))
    assert ours.xi.tobytes() == theirs.xi.tobytes()
    for item in fields(ours.trajectory):
        rows: Array = getattr(ours.trajectory, item.name)
        assert rows.tobytes() == getattr(theirs.trajectory, item.name).tobytes()
    assert ours.metrics == theirs.metrics


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "task is damaged: JSON: "),
        ("[" * 100_000, "task is damaged: JSON: "),
        ("[]", "task is damaged: it must hold a scenario"),
        ('{"robot": "lemur"}', "task is damaged: it must hold a scenario"),
        ('{"robot": {"urdf": "sha256:0"}}', "robot.urdf is .*sha256:0.*: the bag must hold it"),
    ],
)
def test_what_is_no_task_is_refused(text: str, words: str) -> None:
    with pytest.raises(InvalidInput, match=words):
        task_from_json(text, {})


def test_a_task_of_a_newer_format_or_without_a_setting_is_refused(capture: PlanningTask) -> None:
    document = json.loads(task_json(capture))
    with pytest.raises(InvalidInput, match="format is 2: this version reads format 1") as newer:
        task_from_json(json.dumps(document | {"format": 2}), {})
    assert newer.value.status is Status.UNSUPPORTED
    for item in ("starts", "robust"):
        less = {name: value for name, value in document["planner"].items() if name != item}
        with pytest.raises(InvalidInput, match=f"planner.{item}.* is missing"):
            task_from_json(json.dumps(document | {"planner": less}), {})


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("robot.urdf", "robot.urdf"),
        ("robot.srdf", "package://ff_planner_ros/config/lemur.srdf"),
        ("obstacles", [{"id": "o", "shape": {"mesh": {"file": "o.stl"}}, "position": [9, 0, 0]}]),
        ("target_body.urdf", "/etc/passwd"),
    ],
)
def test_a_recorded_task_reads_no_file_of_this_machine(key: str, value: object) -> None:
    document = json.loads(task_json(scenario("lemur_tumbling")))
    block = document
    *groups, last = key.split(".")
    for group in groups:
        block = block[group]
    block[last] = value
    with pytest.raises(InvalidInput, match="file"):
        task_from_json(json.dumps(document), {})
