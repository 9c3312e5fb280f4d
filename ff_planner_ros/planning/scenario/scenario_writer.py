"""A planning task as a scenario file, without loss: read back, it has the same digest."""

from __future__ import annotations

import math
from operator import attrgetter
from pathlib import Path
from typing import Any

import yaml

from ff_planner_ros.common.declared import DeclaredFields, declared, written
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.scenario.phases_file import with_phases
from ff_planner_ros.planning.scenario.robot_file import RobotFile
from ff_planner_ros.planning.scenario.scenario import KEYS, Defaults, load_task
from ff_planner_ros.planning.scenario.wheels_file import wheels_file
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.state import SystemState


def write_scenario(task: PlanningTask, path: Path) -> None:
    """Write a task to a scenario file, and its robot to a URDF file of the same name beside it.

    Existing files are replaced.

    Raises:
        InvalidInput: The file would not hold the task: two obstacles with one id, say.
        OSError: A file cannot be written.
    """
    urdf = path.with_suffix(".urdf")
    urdf.write_text(task.problem.robot.drawn_urdf, encoding="utf-8", newline="")
    # Flow style for what holds no other lists: a line for each vector.
    document = yaml.safe_dump(
        task_document(task, urdf.name),
        default_flow_style=None,
        sort_keys=False,
        allow_unicode=True,
        width=math.inf,
    )
    path.write_text(document, encoding="utf-8", newline="")
    if load_task(path, Defaults(task.settings)).digest != task.digest:
        allowed = "a scenario file holds robots that their URDF describes"
        raise InvalidInput(Status.UNSUPPORTED, "robot", "of another kind", allowed)


def task_document(task: PlanningTask, urdf: str) -> dict[str, Any]:
    """Return the document of a task as a scenario file holds it.

    Args:
        urdf: Path or text of the robot's `drawn_urdf`.
    """
    robot = task.problem.robot
    # What is written of a robot with lines has no <collision>.
    geometry = None if robot.geometry is Geometry.LINES else robot.geometry
    named = RobotFile(
        *(urdf, robot.base_link, robot.tip_link, robot.base, wheels_file(task.problem)),
        geometry=geometry,
        slide_weight=robot.slide_weight if robot.has_slides else None,
    )
    values = {"robot": named} | _said_of(task.problem) | _said_by(task)
    return with_phases(written(KEYS, values), task.then)


def described_problem(problem: PlanningProblem) -> dict[str, Any]:
    """Return the document of a problem as in a scenario file, without the robot."""
    known: DeclaredFields = {**declared(SystemState), **declared(PlanningProblem)}
    return written(known, _said_of(problem))


def _said_of(problem: PlanningProblem) -> dict[str, Any]:
    """Return what a scenario says of a problem, by key; the rest follows from that."""
    values = _said_by(problem.start) | _said_by(problem)
    if problem.duration_range is not None:
        values["duration"] = problem.duration_range
    values["target"] = problem.posture or problem.path or problem.target
    if problem.target_body is not None:
        del values["target"]
        values["obstacles"] = [one for one in problem.obstacles if one.body is None]
    return values


def _said_by(value: Any) -> dict[str, Any]:
    return {key: attrgetter(one.name)(value) for key, one in declared(type(value)).items()}
