"""Requests as messages: of a scenario, of a task, and by `key=value` as `ask --set` has them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from ff_planner_msgs.msg import PlanRequest

from ff_planner_ros.common.declared import DeclaredField, declared
from ff_planner_ros.common.declared_messages import places_in, write_value
from ff_planner_ros.common.yaml_file import yaml_document
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.whole import captured_bodies
from ff_planner_ros.ros.messages.interfaces import entry_of
from ff_planner_ros.ros.messages.phases import not_in_requests, phase_message
from ff_planner_ros.ros.messages.to_messages import (
    payload_message,
    request_message,
    scene_message,
    state_message,
    target_body_message,
)

# Place in the message, and declaration, by key.
_KEYS: dict[str, tuple[str, DeclaredField]] = {
    key: (place, declaration)
    for kind in (PlanningProblem, PlanningTask)
    for key, place, declaration in places_in(kind)
}
_KEYS["duration.max"] = ("duration_max", _KEYS["duration"][1])
_KEYS["search.depth"] = ("search.depth", declared(PlannerSettings)["search"])


def request_of_scenario(scenario: Path, frame: str, bring: Collection[str]) -> PlanRequest:
    """Return the request for a scenario's goal and phases.

    Args:
        frame: Name of the node's inertial frame.
        bring: Inputs that the request carries from the scenario, instead of those that the node
            has received: any of `state`, `obstacles`, `target_body`.

    Raises:
        InvalidInput: The scenario is invalid, or a goal in it has what no request holds.
    """
    task = load_task(scenario, Defaults(load_parameters().planner))
    problem, names = task.problem, task.problem.robot.joint_names
    request = request_of_task(task, frame)
    # Stamps of zero: as if measured when the node reads it.
    if "state" in bring:
        request.start_state = [state_message(problem.start, names, 0, frame)]
    if "obstacles" in bring:
        request.scene = [scene_message(problem.obstacles, 0, frame)]
    body = next((one for one in captured_bodies(task) if one is not None), None)
    if "target_body" in bring and body is not None:
        request.target_body = [target_body_message(body, 0, frame)]
    return request


def request_of_task(task: PlanningTask, frame: str) -> PlanRequest:
    """Return the request for a task's goal and phases; state and scene are left to the node.

    Raises:
        InvalidInput: A goal has what no request holds.
    """
    for field in not_in_requests(task):
        allowed = "a request to a node cannot ask for it: leave it out"
        raise InvalidInput(Status.UNSUPPORTED, field, "given", allowed)
    robot = task.problem.robot
    request = request_message(task.problem, frame)
    request.then = [phase_message(one, robot.joint_names, frame) for one in task.then]
    if robot.payload is not None:
        request.payload = [payload_message(robot.payload)]
    return request


def request_of_nothing(frame: str) -> PlanRequest:
    """Return a request in which only the frame of the goal is set."""
    request = PlanRequest()
    request.goal.pose.header.frame_id = frame
    return request


def change_request(request: PlanRequest, settings: Sequence[str]) -> None:
    """Set fields of a request by `key=value`, with the keys of a scenario.

    Raises:
        InvalidInput: A key is unknown, or a value is not allowed.
    """
    for setting in settings:
        key, value = _split(setting)
        place, declaration = _KEYS[key]
        form = declaration.form
        checked = form.written(form.checked(key, form.read(key, value)))
        try:
            write_value(request, declaration, checked, entry_of, place)
        except (AssertionError, OverflowError):
            allowed = "it does not fit a request"
            raise InvalidInput(Status.OUT_OF_RANGE, key, checked, allowed) from None


def _split(setting: str) -> tuple[str, Any]:
    """Return key and value of a `key=value`, the value as YAML has it, or as it is written."""
    key, equals, value = setting.partition("=")
    if not equals:
        allowed = "it must read key=value, such as objective.chaser_attitude=1"
        raise InvalidInput(Status.OUT_OF_RANGE, "--set", setting, allowed)
    if key not in _KEYS:
        nearest_first = dict.fromkeys([*get_close_matches(key, _KEYS), *_KEYS])
        allowed = f"allowed are {', '.join(nearest_first)}"
        raise InvalidInput(Status.OUT_OF_RANGE, f"--set {key}", "an unknown key", allowed)
    try:
        return key, yaml_document(value, key, "no YAML")
    except InvalidInput:
        return key, value
