"""An error as the fields of an answer's status, in the words of requests."""

from __future__ import annotations

import re
from typing import Any

from ff_planner_ros.common.declared_messages import names_in
from ff_planner_ros.common.shown import shortened, shown
from ff_planner_ros.errors import (
    LONGEST_MESSAGE,
    REMEDIES,
    FfPlannerError,
    InvalidInput,
    NoPlanFound,
)
from ff_planner_ros.messages.target_bodies import NAMED_AS
from ff_planner_ros.planning.problem.problem import PlanningProblem

# Fields of postures and paths to follow in requests, by the keys of a scenario.
GOAL_FIELDS = {
    "target.joints.position": "goal.joints.position",
    "target.joints.velocity": "goal.joints.velocity",
    "target.path": "goal.path.poses",
    "target.position_tolerance": "limits.path_position_tolerance",
    "target.orientation_tolerance": "limits.path_orientation_tolerance",
}
# A field of a path's point, and its places in the point's pose.
_POINT = re.compile(r"(?<![\w.])target\.path\[(\d+)\]\.(\w+)")
_IN_POSES = {
    "time": "header.stamp",
    "position": "pose.position",
    "quaternion_xyzw": "pose.orientation",
}
# Fields of a request by the keys of a scenario, which refusals of the planner name.
_FIELDS = names_in(PlanningProblem) | NAMED_AS | GOAL_FIELDS
_KEYS = re.compile(
    rf"(?<![\w.])({'|'.join(re.escape(key) for key in _FIELDS if '.' in key)})(?![\w.]\w)"
)
# A phase of a scenario, whose first is none of the field `then` of a request.
_PHASE = re.compile(r"(?<![\w.])phases\[([1-9]\d*)\]")


def status_fields(error: FfPlannerError) -> dict[str, Any]:
    """Return the fields of `PlanStatus.msg` for an error, by name.

    Field and retry are those of the code, as docs/reference/status_codes.md has them; a code whose
    field is not told there has the one that the error names, and an error may say itself whether to
    retry.
    """
    retry, field, value, allowed = REMEDIES[error.status]
    message = str(error)
    refused = error.cause if isinstance(error, NoPlanFound) else error
    if isinstance(refused, InvalidInput):
        found, allowed = shown(refused.value), refused.allowed
        if not field:
            field, value = refused.field, found
        else:
            value = f"{value}, {refused.field} is {found}"
            message = f"{field} is {value}: {allowed}" if refused is error else message
    elif isinstance(error, NoPlanFound):
        value = error.failures[0].finding if error.failures else error.constraint
        if error.failures and error.failures[0].advice:
            allowed = "; ".join(error.failures[0].advice)
    told = (message, field, value, allowed)
    message, field, value, allowed = (shortened(_in_request(one), LONGEST_MESSAGE) for one in told)
    return {
        "code": int(error.status),
        "message": message,
        "field": field,
        "value": value,
        "allowed": allowed,
        "retry": int(retry if error.retry is None else error.retry),
    }


def path_named(text: str) -> str:
    """Return a text with the fields of a request's poses for those of a path's points."""
    return _POINT.sub(
        lambda found: f"goal.path.poses[{found[1]}].{_IN_POSES.get(found[2], found[2])}", text
    )


def _in_request(text: str) -> str:
    """Return a text with a request's fields for a scenario's keys."""
    text = _PHASE.sub(lambda phase: f"then[{int(phase[1]) - 1}]", path_named(text))
    return _KEYS.sub(lambda key: _FIELDS[key[0]], text)
