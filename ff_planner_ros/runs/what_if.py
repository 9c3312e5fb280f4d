"""Replay with changes: answers to recorded tasks with other values."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ff_planner_ros.bag.exchanges import Exchange
from ff_planner_ros.bag.plans import status_name
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.common.text_table import print_table
from ff_planner_ros.common.yaml_file import yaml_document
from ff_planner_ros.errors import FfPlannerError, InvalidInput, Status
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.scenario.changes import SET, Change, changed, require_key
from ff_planner_ros.planning.scenario.library_file import load_library
from ff_planner_ros.planning.scenario.task_json import task_from_document, urdf_digest
from ff_planner_ros.planning.task.library import Library
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.whole import whole
from ff_planner_ros.runs.replay import answer_to, replayable

_LIBRARY = "planner.library"
_NONE = "-"


def parsed(setting: str) -> Change:
    """Read a `key=value` of the command line; the key is one of a scenario, the value YAML.

    Raises:
        InvalidInput: It is no `key=value`.
    """
    key, equals, value = setting.partition("=")
    if not equals:
        allowed = "it must read key=value, such as objective.chaser_attitude=1"
        raise InvalidInput(Status.OUT_OF_RANGE, "--set", setting, allowed)
    require_key("--set", key)
    try:
        return Change(key, SET, yaml_document(value, key, "no YAML"))
    except InvalidInput:
        return Change(key, SET, value)


def changed_task(exchange: Exchange, changes: Sequence[Change]) -> PlanningTask:
    """Return the task of a request with changed values.

    In a sequence, a key of a phase means the first one. A clock that ended the recorded search does
    not end the new one.

    Raises:
        InvalidInput: The bag lacks the task, or a value is invalid.
    """
    exchange.planned_task()  # or else it says what is missing
    document = json.loads(exchange.task)
    document.get("search", {}).pop("effort", None)
    for phase in document.get("phases", ()):
        phase.get("search", {}).pop("effort", None)
    libraries = [one.value for one in changes if one.key == _LIBRARY]
    others = [one for one in changes if one.key != _LIBRARY]
    phases = document.get("phases", ())
    of_first = phases[0] if phases else {}
    placed = [
        replace(one, key=f"phases[0].{one.key}") if _head(one.key) in of_first else one
        for one in others
    ]
    urdfs, named = {urdf_digest(one): one for one in exchange.urdfs}, document["robot"]["urdf"]
    document, urdf, _ = changed(document, urdfs.get(named, named), placed)
    document["robot"]["urdf"] = urdf
    task = task_from_document(document, {})
    for path in libraries:
        library = load_library(Path(str(path)), f"--set {_LIBRARY}") if path else Library(())
        task = replace(task, first_guess=library.first_guess(task))
    return task


def _head(key: str) -> str:
    return key.partition(".")[0].partition("[")[0]


def print_what_if(bag: Path, settings: Sequence[str]) -> None:
    """Plan the tasks of a bag with changes, each a `key=value`, and print both answers.

    Raises:
        BagError: The bag cannot be read, or holds no request.
        InvalidInput: A setting is invalid, or refused with each task.
    """
    changes = [parsed(setting) for setting in settings]
    rows, told, refused = [], list[str](), list[FfPlannerError]()
    with open_bag(bag) as opened:
        for one in replayable(opened):
            if one.answer is None or not one.task:
                told.append(f"{one.plan_id} is left out: the bag holds no task of it")
                continue
            try:
                again = answer_to(changed_task(one, changes))
            except FfPlannerError as error:
                again = error
                told.append(f"{one.plan_id}: {error}")
                refused.append(error)
            both = zip(_recorded_cells(one.answer), _cells(again), strict=True)
            rows.append((one.plan_id, *(f"{before} > {now}" for before, now in both)))
        notes = opened.notes
    if refused and len(refused) == len(rows):
        raise refused[0]  # the change fits no task
    words = ", ".join(f"{change.key}={change.value}" for change in changes)
    header = (
        *("request", "status", "joint path [rad]", "Euler angle [deg]", "rotation [deg]"),
        "clearance [mm]",
    )
    print_table(f"{bag} as recorded > with {words}", header, rows)
    for note in [*told, *notes]:
        print(f"note: {note}")


def _recorded_cells(answer: Any) -> tuple[str, ...]:
    metrics = answer.metrics[0] if len(answer.metrics) else None
    return status_name(int(answer.status.code)), *_figures(metrics)


def _cells(again: Plan | FfPlannerError) -> tuple[str, ...]:
    if isinstance(again, Plan):
        return Status.SOLVED.name, *_figures(whole(again).metrics)
    attempt = getattr(again, "attempt", None)
    return again.status.name, *_figures(attempt.metrics if isinstance(attempt, Plan) else None)


def _figures(metrics: Metrics | None) -> tuple[str, ...]:
    if metrics is None:
        return (_NONE,) * 4
    return (
        f"{metrics.joint_path_length:.4f}",
        f"{math.degrees(metrics.max_chaser_euler):.3f}",
        f"{math.degrees(metrics.max_chaser_rotation):.3f}",
        f"{metrics.min_clearance * 1e3:.2f}",
    )
