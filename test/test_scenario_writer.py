"""A task is written to a scenario file and read back without loss."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from robots import LEMUR_SCENARIO

from ff_planner_ros.common.arrays import normalising_to, unit_quaternion
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.problem.problem import (
    Limits,
    Objective,
    Obstacle,
    PlanningProblem,
    Target,
)
from ff_planner_ros.planning.scenario.scenario import Defaults, load_scenario, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.controller_rules import Controller
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState

SETTINGS = load_parameters().planner
IDS = (
    "",
    "yes",
    "1e3",
    "a: b",
    "- c",
    "null",
    "Kugel Ä 球 🛰",
    "two\nlines",
    " # d",
    "'\"",
    "\x85\t\x07\ufeff",
)
EXTREME = (5e-324, 1e-310, 1e100, -0.0, 1e-5, 1e16, 0.1, 2.0**-1022)


def number(rng: np.random.Generator) -> float:
    return float(rng.choice(EXTREME) if rng.random() < 0.3 else rng.normal())


def vector(rng: np.random.Generator, size: int = 3) -> np.ndarray:
    return np.array([number(rng) for _ in range(size)])


def quaternion(rng: np.random.Generator) -> np.ndarray:
    drawn = rng.normal(size=4)
    return drawn / np.linalg.norm(drawn) * rng.uniform(0.9995, 1.0005)


def random_task(robot: Robot, seed: int) -> PlanningTask:
    rng = np.random.default_rng(seed)
    joints = robot.joints
    ends = rng.random() < 0.5
    duration = max(abs(number(rng)) or 1.0, 1e-3)
    return PlanningTask(
        problem=PlanningProblem(
            robot=robot,
            start=SystemState(
                vector(rng), quaternion(rng), vector(rng), vector(rng),
                vector(rng, joints), vector(rng, joints),
                vector(rng, joints) if rng.random() < 0.5 else None,
            ),
            target=Target(
                vector(rng), quaternion(rng), vector(rng), vector(rng), vector(rng), vector(rng)
            ),
            duration=duration,
            points=int(rng.integers(5, 5_001 if ends else 10_001)),
            obstacles=tuple(
                Obstacle.sphere(
                    name, vector(rng), abs(number(rng)) or 1.0, rng.choice([0, 1]) * vector(rng)
                )
                for name in rng.choice(IDS, rng.integers(len(IDS)), replace=False).tolist()
            ),
            objective=Objective(1.0, abs(number(rng))),
            limits=Limits(
                bool(rng.random() < 0.5), float(rng.choice([math.inf, 1e-6, 0.2])),
                joint_torques=seed % 2 == 0,
                joint_accelerations=None if seed % 3 else tuple(np.arange(1.0, joints + 1.0)),
            ),
        ),
        settings=replace(SETTINGS, penalty_gain=abs(number(rng)), starts=int(rng.integers(1, 9))),
        ahead=abs(number(rng)),
        running=JointMotion(
            np.cumsum(rng.uniform(0.1, 1.0, 4)) - 1.0,
            *(np.array([vector(rng, joints) for _ in range(4)]) for _ in range(3)),
        )
        if rng.random() < 0.5
        else None,
        end_behaviour=list(EndBehaviour)[rng.integers(3)] if ends else EndBehaviour.NONE,
        tail=float(rng.uniform(1e-3, 0.9)) * duration,  # with so many points as there may be
        controller=Controller(False, bool(rng.random() < 0.5))
        if rng.random() < 0.5
        else None,
        first_guess=vector(rng, 18) if rng.random() < 0.5 else None,
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(40))
def test_a_task_comes_back_to_the_last_bit(
    lemur_capture: PlanningProblem, tmp_path: Path, seed: int
) -> None:
    task = random_task(lemur_capture.robot, seed)
    path = tmp_path / "task.yaml"
    write_scenario(task, path)
    back = load_task(path, Defaults(SETTINGS, Limits(True, 1.0), EndBehaviour.STOP_JOINTS, 9.0))
    assert back.digest == task.digest
    for one, other in (
        (task.problem.start, back.problem.start),
        (task.problem.target, back.problem.target),
    ):
        for item in fields(one):
            written, read = getattr(one, item.name), getattr(other, item.name)
            if isinstance(written, np.ndarray):
                assert written.tobytes() == read.tobytes()
            else:
                assert written == read
    assert back.problem.limits == task.problem.limits
    for there, here in zip(back.problem.obstacles, task.problem.obstacles, strict=True):
        assert there.id == here.id
        np.testing.assert_array_equal(there.motion.velocity, here.motion.velocity)
    assert (back.controller, back.settings) == (task.controller, task.settings)
    assert load_scenario(path).points == task.problem.points


def test_the_file_has_a_line_for_each_vector(
    lemur_capture: PlanningProblem, tmp_path: Path
) -> None:
    path = tmp_path / "capture.yaml"
    write_scenario(PlanningTask(lemur_capture, SETTINGS), path)
    lines = path.read_text().splitlines()
    assert "robot: {urdf: capture.urdf, base_link: chaser, tip_link: end_effector}" in lines
    assert "  linear_velocity: [0.02, 0.0, 0.05]" in lines
    kept = "position: from_urdf, velocity: none, acceleration: none, effort: from_urdf"
    assert f"limits: {{{kept}, chaser_attitude: none}}" in lines


def test_what_a_file_cannot_hold_is_refused(lemur_capture: PlanningProblem, tmp_path: Path) -> None:
    twice = replace(lemur_capture, obstacles=2 * lemur_capture.obstacles[:1])
    with pytest.raises(InvalidInput, match="unique"):
        write_scenario(PlanningTask(twice, SETTINGS), tmp_path / "twice.yaml")


@pytest.mark.parametrize("seed", range(5))
def test_a_unit_quaternion_has_numbers_that_normalise_to_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(200):
        unit = unit_quaternion("q", quaternion(rng))
        assert (unit_quaternion("q", normalising_to(unit)) == unit).all()


def written(tmp_path: Path, more: str) -> Path:
    path = tmp_path / "scenario.yaml"
    text = LEMUR_SCENARIO.read_text().replace(
        "../robots", str(LEMUR_SCENARIO.parents[1] / "robots")
    )
    path.write_text(text.replace("limits: {position: from_urdf}", "limits: {}") + more)
    return path


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("start_after: -1.0", "start_after is -1.0"),
        ("end_behaviour: rest", "end_behaviour is 'rest'"),
        ("end_behaviour: stop_joints", "post_goal_duration is missing: .* stop_joints needs it"),
        ("controller: {effort_interface: false}", "allow_nonzero_velocity_at_trajectory_end"),
        ("controller: {allow_nonzero_velocity_at_trajectory_end: 1, effort_interface: false}",
         "controller.allow_nonzero_velocity_at_trajectory_end is 1"),
        ("planner: {start: 3}", "planner.start is unknown"),
        ("planner: {starts: 0}", "planner.starts is 0"),
        ("first_guess: [1.0, .nan]", "first_guess is"),
        ("running: {time: [0.0]}", "running.positions is missing"),
        ("running: {time: [0.0], positions: [[0.0]], velocities: [], accelerations: []}",
         "running.positions"),
        ("tail: 2.0", "tail is unknown"),
    ],
)  # fmt: skip
def test_a_value_that_makes_no_sense_is_refused_by_name(
    tmp_path: Path, more: str, words: str
) -> None:
    with pytest.raises(InvalidInput, match=words):
        load_task(written(tmp_path, more), Defaults(SETTINGS))


@pytest.mark.parametrize(
    ("time", "grows"),
    [
        ([0.0, 1.0, 1.5], True),
        ([0.0, 2.0, 1.0], False),
        ([0.0, 1.0, 1.0], False),
        ([2.0, 1.0, 0.0], False),
    ],
)
def test_each_time_of_a_running_motion_is_later_than_the_one_before(
    tmp_path: Path, time: list[float], grows: bool
) -> None:
    rows = [[0.0] * 7 for _ in time]
    running = {"time": time} | {item.name: rows for item in fields(JointMotion)[1:]}
    path = written(tmp_path, yaml.safe_dump({"running": running}))
    if grows:
        found = load_task(path, Defaults(SETTINGS)).running
        assert found is not None
        assert found.time.tolist() == time
        return
    with pytest.raises(InvalidInput, match=r"running\.time is .* each later than the one before"):
        load_task(path, Defaults(SETTINGS))


def test_what_a_scenario_does_not_say_is_the_formats_default_or_the_parameters(
    tmp_path: Path,
) -> None:
    path = written(tmp_path, "planner: {starts: 3}")
    alone = load_task(path, Defaults(SETTINGS))
    assert alone.problem.limits == Limits()
    assert (alone.end_behaviour, alone.controller) == (EndBehaviour.NONE, None)
    assert alone.settings == replace(SETTINGS, starts=3)
    file = tmp_path / "planner.yaml"
    file.write_text(
        "/**: {ros__parameters: {end_behaviour: stop_joints, post_goal_duration: 1.25, "
        "planner.starts: 7, planner: {max_iterations: 9}, limits: {chaser_attitude: 0.3}}}"
    )
    parameters: Any = load_parameters(file)
    task = load_task(path, parameters.of_scenarios())
    assert task.problem.limits == Limits(True, 0.3)
    assert (task.end_behaviour, task.tail) == (EndBehaviour.STOP_JOINTS, 1.25)
    assert task.settings == replace(SETTINGS, starts=3, max_iterations=9)
    assert task.controller == Controller(False, False)
