"""Replay with changes: answers to recorded requests with other fields or parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ff_planner_msgs.msg import PlanAnswer

from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.common.forms import NAME
from ff_planner_ros.common.text_table import print_table
from ff_planner_ros.errors import BagError
from ff_planner_ros.parameters import DECLARATIONS
from ff_planner_ros.parameters.values import checked, replaced
from ff_planner_ros.planning.scenario.library_file import load_library
from ff_planner_ros.ros.messages.request_values import (
    REQUEST_KEYS,
    request_value,
    set_in_request,
    split_setting,
    yaml_or_text,
)
from ff_planner_ros.runs.recorded_run import RecordedRequest, recorded_run
from ff_planner_ros.runs.replay import answer_again, one_by_one, status_name

# Keys that may be changed in a request. The goal stays as it is.
_OF_REQUEST = tuple(key for key in REQUEST_KEYS if not key.startswith("target."))
# Parameters that may be changed: those that planning depends on. The others say where messages go,
# or are defaults for fields of a request, which `_OF_REQUEST` changes in every request.
_OF_NODE = (
    *("planner.", "limits.", "controller.", "replanning."),
    *("post_goal_duration", "following_tolerance", "planning_lead_time", "start_horizon"),
    *("state_max_age", "state_future_tolerance", "obstacles_max_age"),
    "locked_joint_tolerance",
)
_LIBRARY = "planner.library"
_NONE = "-"


@dataclass(frozen=True)
class Change:
    """One change of a request or of a parameter."""

    key: str  # one of `allowed_keys`
    value: Any  # read as YAML, of the key's type


def allowed_keys() -> list[str]:
    """Return the keys of requests and the names of parameters that may be changed."""
    return list(
        dict.fromkeys([*_OF_REQUEST, *(name for name in DECLARATIONS if name.startswith(_OF_NODE))])
    )


def parsed(setting: str) -> Change:
    """Read a `key=value` of the command line.

    Raises:
        InvalidInput: The key is unknown, or the value is not of its type or out of its range.
    """
    key, written = split_setting(setting, allowed_keys())
    value = yaml_or_text(key, written)
    if key in _OF_REQUEST:
        return Change(key, request_value(key, value, in_range=False))
    return Change(key, checked(key, written if DECLARATIONS[key].form is NAME else value))


def changed_request(recorded: RecordedRequest, changes: Sequence[Change]) -> RecordedRequest:
    """Return a request with changes of its fields and of the node's parameters.

    Raises:
        BagError: The request cannot be rebuilt.
        InvalidInput: A value is invalid.
    """
    if recorded.request is None or recorded.inputs is None:
        raise BagError(recorded.missing)
    request, parameters = deepcopy(recorded.request), recorded.inputs.parameters
    for change in changes:
        if change.key in _OF_REQUEST:
            set_in_request(request, change.key, change.value)
        else:
            parameters = replaced(parameters, change.key, change.value)
    inputs = replace(recorded.inputs, parameters=parameters)
    if any(change.key == _LIBRARY for change in changes):
        named = parameters.library
        library = load_library(Path(named), f"--set {_LIBRARY}") if named else None
        inputs = replace(inputs, guesses=library)
    return replace(recorded, request=request, inputs=inputs)


def print_what_if(bag: Path, settings: Sequence[str]) -> None:
    """Plan the requests of a bag with changes, each a `key=value`, and print both answers.

    Raises:
        BagError: The bag cannot be read, or holds no request.
        InvalidInput: A setting or the URDF in the bag is invalid.
    """
    changes = [parsed(setting) for setting in settings]
    with open_bag(bag) as opened:
        run = recorded_run(opened)
    rows, left_out = [], list[str]()
    for recorded in one_by_one(run.requests):
        try:
            changed = changed_request(recorded, changes)
        except BagError as error:
            left_out.append(f"{recorded.name} is left out: {error}")
            continue
        answer, _ = answer_again(changed)
        both = zip(_cells(recorded.response), _cells(answer), strict=True)
        rows.append((recorded.name, *(f"{before} > {now}" for before, now in both)))
    words = ", ".join(f"{change.key}={change.value}" for change in changes)
    header = (
        *("request", "status", "joint path [rad]", "Euler angle [deg]", "rotation [deg]"),
        *("clearance [mm]", "time [s]"),
    )
    print_table(f"{bag} as recorded > with {words}", header, rows)
    for note in [*left_out, *run.notes]:
        print(f"note: {note}")


def _cells(answer: PlanAnswer | None) -> tuple[str, ...]:
    if answer is None or not answer.metrics:
        return status_name(answer), _NONE, _NONE, _NONE, _NONE, _NONE
    (metrics,) = answer.metrics
    rotation = metrics.max_chaser_rotation
    return (
        status_name(answer),
        f"{metrics.joint_path_length:.4f}",
        f"{math.degrees(metrics.max_chaser_euler):.3f}",
        # Not known if it was not recorded.
        _NONE if math.isnan(rotation) else f"{math.degrees(rotation):.3f}",
        f"{metrics.min_clearance * 1e3:.2f}",
        f"{answer.solver.solve_time:.2f}",
    )
