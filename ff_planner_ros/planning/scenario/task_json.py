"""A planning task as JSON text, as a bag records it: the whole scenario, its robot included."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from ff_planner_ros.common.declared import declared_by_name
from ff_planner_ros.common.declared_parts import changes
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.settings import PlannerSettings, RobustSettings
from ff_planner_ros.planning.scenario.scenario import Defaults, built_task
from ff_planner_ros.planning.scenario.scenario_writer import task_document
from ff_planner_ros.planning.task.planning_task import PlanningTask

_DIGEST = "sha256:"


def task_json(task: PlanningTask, urdf: str = "") -> str:
    """Return a task as JSON text: read back, it has the same digest.

    Args:
        urdf: URDF that readers have already, as `Robot.drawn_urdf`; the text names it by its
            digest. Any other stands in the text.

    Raises:
        InvalidInput: No scenario can hold the task: the target moves with the chosen duration.
    """
    window = task.problem.duration_range
    if window is not None and window.target_velocity.any():
        field, found = "duration_range.target_velocity", window.target_velocity.tolist()
        raise InvalidInput(Status.UNSUPPORTED, field, found, "it must be zero in a scenario")
    drawn = task.problem.robot.drawn_urdf
    return json.dumps(task_document(task, urdf_digest(drawn) if drawn == urdf else drawn))


def urdf_digest(urdf: str) -> str:
    """Return the name of a URDF in the text of a task: its SHA-256."""
    return _DIGEST + hashlib.sha256(urdf.encode()).hexdigest()


def task_from_json(text: str, urdfs: Mapping[str, str]) -> PlanningTask:
    """Read a task.

    Args:
        urdfs: URDFs by their `urdf_digest`.

    Raises:
        InvalidInput: The text is no task, its URDF is not among `urdfs`, or a value is refused.
    """
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InvalidInput(Status.OUT_OF_RANGE, "task", "damaged", f"JSON: {error}") from None
    return task_from_document(document, urdfs)


def task_from_document(document: Any, urdfs: Mapping[str, str]) -> PlanningTask:
    """Read a task from what its JSON text holds; see `task_from_json`."""
    robot = document.get("robot") if isinstance(document, dict) else None
    if not isinstance(robot, dict):
        raise InvalidInput(Status.OUT_OF_RANGE, "task", "damaged", "it must hold a scenario")
    urdf = robot.get("urdf")
    if isinstance(urdf, str) and urdf.startswith(_DIGEST):
        if urdf not in urdfs:
            allowed = "the bag must hold it"
            raise InvalidInput(Status.OUT_OF_RANGE, "robot.urdf", urdf, allowed)
        document = {**document, "robot": {**robot, "urdf": urdfs[urdf]}}
    return built_task(document, None, Defaults(_settings(document.get("planner"))))


def _settings(given: Any) -> PlannerSettings:
    """Return the settings, none of which may be missing."""
    read = changes(PlannerSettings).read("planner", given)
    for group, told, kind in (
        ("planner", read, PlannerSettings),
        ("planner.robust", read.get("robust", {}), RobustSettings),
    ):
        for name, one in declared_by_name(kind).items():
            if name not in told and not one.brief:
                raise InvalidInput(
                    Status.OUT_OF_RANGE, f"{group}.{name}", "missing", "a recorded task has it"
                )
    return PlannerSettings(**{**read, "robust": RobustSettings(**read["robust"])})
