"""Fields of a request by the keys of a scenario, as `ask --set` sets them."""

from __future__ import annotations

from collections.abc import Collection
from difflib import get_close_matches
from typing import Any

from ff_planner_msgs.msg import PlanRequest

from ff_planner_ros.common.declared import DeclaredField, declared
from ff_planner_ros.common.declared_messages import places_in, write_value
from ff_planner_ros.common.yaml_file import yaml_document
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.ros.messages.interfaces import entry_of

# Place in the message, and declaration, by key.
REQUEST_KEYS: dict[str, tuple[str, DeclaredField]] = {
    key: (place, declaration)
    for kind in (PlanningProblem, PlanningTask)
    for key, place, declaration in places_in(kind)
}
REQUEST_KEYS["duration.max"] = ("duration_max", REQUEST_KEYS["duration"][1])
REQUEST_KEYS["search.depth"] = ("search.depth", declared(PlannerSettings)["search"])


def split_setting(setting: str, known: Collection[str]) -> tuple[str, str]:
    """Split a `key=value` of the command line.

    Raises:
        InvalidInput: The text has no `=`, or its key is not in `known`.
    """
    key, equals, value = setting.partition("=")
    if not equals:
        allowed = "it must read key=value, such as objective.chaser_attitude=1"
        raise InvalidInput(Status.OUT_OF_RANGE, "--set", setting, allowed)
    if key not in known:
        nearest_first = dict.fromkeys([*get_close_matches(key, known), *known])
        allowed = f"allowed are {', '.join(nearest_first)}"
        raise InvalidInput(Status.OUT_OF_RANGE, f"--set {key}", "an unknown key", allowed)
    return key, value


def yaml_or_text(key: str, value: str) -> Any:
    """Return a value parsed as YAML, or the text itself if it is no YAML."""
    try:
        return yaml_document(value, key, "no YAML")
    except InvalidInput:
        return value


def request_value(key: str, value: Any) -> Any:
    """Return a value converted to the key's type.

    Raises:
        InvalidInput: The value is not of the key's type, or out of its range.
    """
    form = REQUEST_KEYS[key][1].form
    return form.written(form.checked(key, form.read(key, value)))


def set_in_request(request: PlanRequest, key: str, value: Any) -> None:
    """Set a key's field of a request to a value from `request_value`.

    Raises:
        InvalidInput: The value does not fit the field's message type.
    """
    place, declaration = REQUEST_KEYS[key]
    try:
        write_value(request, declaration, value, entry_of, place)
    except (AssertionError, OverflowError):
        allowed = "it does not fit a request"
        raise InvalidInput(Status.OUT_OF_RANGE, key, value, allowed) from None
