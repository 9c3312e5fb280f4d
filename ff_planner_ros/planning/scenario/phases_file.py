"""The phases of a scenario: the first is the problem itself, the others follow it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from ff_planner_ros.common.declared import (
    DeclaredField,
    DeclaredFields,
    declared,
    fields_of,
    read_keys,
    written,
)
from ff_planner_ros.common.declared_parts import schema_of
from ff_planner_ros.common.forms import Form, Schema
from ff_planner_ros.errors import Faults, fields_placed, fields_renamed
from ff_planner_ros.planning.problem.limits import Limits
from ff_planner_ros.planning.problem.posture import Posture
from ff_planner_ros.planning.scenario.body_file import TARGET_BODY
from ff_planner_ros.planning.task.phase import MOST_PHASES, Phase

if TYPE_CHECKING:
    from pathlib import Path

    from ff_planner_ros.robot.model import Robot

KEY = "phases"
_KEYS: DeclaredFields = {
    **declared(Phase),
    "target_body": replace(declared(Phase)["target_body"], form=TARGET_BODY),
}
# All of them: a limit that a phase omits is that of the phase before.
_LIMITS = {key: replace(one, brief=False) for key, one in declared(Limits).items()}
_HELD = "payload"  # of the first phase it is the robot's
# Keys that a scenario with phases must give in the phases, not beside them.
_OF_ONE = ("target", "target_body", "duration", "approach", "camera", "allowed_collisions")


def _schema() -> Schema:
    most = 1 + MOST_PHASES
    return {"type": "array", "items": schema_of(_KEYS), "minItems": 1, "maxItems": most}


PHASES = DeclaredField(
    Form(lambda _field, value: value, _schema),
    "instead of target, target_body and duration: a sequence of goals, each phase from the end of "
    "the one before; what a phase omits is as in the phase before, for the first as beside phases",
    optional=True,
    name="then",
)


def split(document: object, faults: Faults) -> tuple[object, list[dict[str, Any]]]:
    """Return a scenario of the first phase alone, and the values of each other phase by key.

    Args:
        faults: Collects what is wrong with the phases.
    """
    if not isinstance(document, dict) or KEY not in document:
        return document, []
    given = document[KEY]
    if not isinstance(given, list) or not 1 <= len(given) <= 1 + MOST_PHASES:
        faults.add(KEY, given, f"it must be a list of 1 to {1 + MOST_PHASES} phases")
        given = []
    alone = {key: value for key, value in document.items() if key != KEY}
    for key in _OF_ONE:
        if key in alone:
            faults.add(key, f"given beside {KEY}", f"say it in a phase: {KEY}[0].{key}")
    first = given[0] if given and isinstance(given[0], dict) else {}
    heads = {key.partition(".")[0] for key in _KEYS}
    for key in first:
        if key == _HELD:
            faults.add(f"{KEY}[0].{key}", "given", "say it in robot.payload")
        elif key not in heads:
            allowed = f"a phase may have {', '.join(sorted(heads))}"
            faults.add(f"{KEY}[0].{key}", "unknown", allowed)
    others = [
        read_keys(_KEYS, f"{KEY}[{index}]", with_duration_of_path(one), faults)
        for index, one in enumerate(given[1:], start=1)
    ]
    return alone | first, others


def with_duration_of_path(document: object) -> object:
    """Return a scenario or phase with the duration of the path to follow, where it omits it."""
    if not isinstance(document, dict) or "duration" in document:
        return document
    target = document.get("target")
    path = target.get("path") if isinstance(target, dict) else None
    last = path[-1] if isinstance(path, list) and path else None
    time = last.get("time") if isinstance(last, dict) else None
    # What is no positive time is a fault of the path, which is told there.
    is_time = isinstance(time, int | float) and not isinstance(time, bool) and time > 0.0
    return document if path is None else document | {"duration": time if is_time else 1.0}


def first_named(document: object) -> AbstractContextManager[None]:
    """Prefix keys in errors with `phases[0]` if the first phase of a scenario gives them."""
    given = document.get(KEY) if isinstance(document, dict) else None
    first = given[0] if isinstance(given, list) and given else None
    heads = first.keys() if isinstance(first, dict) else ()

    def renamed(field: str) -> str:
        head = field.partition(".")[0].partition("[")[0]
        return f"{KEY}[0].{field}" if head in heads else field

    return fields_renamed(renamed)


def built(
    others: Sequence[Mapping[str, Any]], robot: Robot, limits: Limits, directory: Path | None
) -> tuple[Phase, ...]:
    """Return the phases that follow the first.

    Args:
        others: Values from `split`, the meshes of their target bodies read.
        limits: Limits of the first phase, for values that a phase omits.
        directory: Directory that paths are relative to.

    Raises:
        InvalidInput: A value of a phase is not allowed; the error names `phases[k]`.
    """
    phases = list[Phase]()
    for index, read in enumerate(others, start=1):
        with fields_placed(f"{KEY}[{index}]"):
            given = fields_of(Phase, read)
            if "limits" in given:
                limits = given["limits"] = replace(limits, **given["limits"]).of_joints(
                    robot.joints
                )
            if _HELD in given:
                with fields_renamed(lambda field: field.removeprefix("robot.")):
                    given[_HELD] = given[_HELD].loaded(directory)
            if isinstance(posture := given.get("target"), Posture):
                posture.require_fits(robot, limits.joint_velocities)
            phases.append(Phase(**given))
    return tuple(phases)


def with_phases(document: dict[str, Any], then: Sequence[Phase]) -> dict[str, Any]:
    """Return a scenario's document rewritten with the phases after the first; none: unchanged."""
    if not then:
        return document
    first = {key: document.pop(key) for key in _OF_ONE if key in document}
    return document | {KEY: [first, *map(_written, then)]}


def _written(phase: Phase) -> dict[str, Any]:
    document = written(_KEYS, {key: attrgetter(one.name)(phase) for key, one in _KEYS.items()})
    if (limits := phase.limits) is not None:
        values = {key: getattr(limits, one.name, None) for key, one in _LIMITS.items()}
        document["limits"] = written(_LIMITS, values)
    return document
