"""Translates requests and answers of versions 0.1 and 0.2 to the messages of version 0.3."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.planning.problem.goal_words import GoalKind, Orientation

# Places of fields of version 0.2 in version 0.3. A field that a switch or zero disabled is an array
# of at most one entry now.
REQUEST_FIELDS: Mapping[str, str] = {
    "target_pose": "goal.pose",
    "target_twist": "goal.twist",
    "capture": "goal.kind",
    "orientation": "goal.orientation",
    "free_axis": "goal.free_axis",
    "approach_direction": "goal.approach[0].direction",
    "approach_distance": "goal.approach[0].distance",
    "approach_cone": "goal.approach[0].half_angle",
    "allowed_at_goal": "goal.allowed_collisions[0].pairs",
    "contact_distance": "goal.allowed_collisions[0].distance",
    "weight_joint_path_length": "objective.joint_path_length",
    "weight_chaser_attitude": "objective.chaser_attitude",
    "weight_duration": "objective.duration",
    "duration": "duration",
    "duration_max": "duration_max",
    "start_time": "start_time",
    "limit_chaser_attitude": "limits.chaser_attitude[0]",
    "limit_chaser_rotation": "limits.chaser_rotation[0]",
    "limit_accelerations": "limits.accelerations",
    "use_start_state": "start_state",
    "start_state": "start_state[0]",
    "use_obstacles": "scene",
    "obstacles": "scene[0]",
    "use_target_body": "target_body",
    "target_body": "target_body[0]",
    "parametrisation": "search.parametrisation",
    "points": "search.points",
    "time_budget": "search.time_budget",
    "end_behaviour": "end_behaviour",
    "plan_only": "plan_only",
    "continue_plan": "replan_active",
    "asked_by": "requester",
}
ANSWER_FIELDS: Mapping[str, str] = {
    "status": "status",
    "plan_id": "plan_id",
    "taken_up": "inputs.received_stamp",
    "state_stamp": "inputs.state_stamp",
    "state_source": "inputs.state_source",
    "joint_states_stamp": "inputs.joint_states_stamp",
    "obstacles_stamp": "inputs.obstacles_stamp",
    "obstacles_source": "inputs.obstacles_source",
    "target_body_stamp": "inputs.target_body_stamp",
    "target_body_source": "inputs.target_body_source",
    "following": "inputs.previous_plan_id",
    "delay": "inputs.handover_delay",
    "joined_at": "inputs.splice_time",
    "task_digest": "task_digest",
    "joint_trajectory": "plans[0].joint_trajectory",
    "predicted_chaser_path": "plans[0].chaser_path",
    "predicted_chaser_twists": "plans[0].chaser_twists",
    "end_effector_path": "plans[0].end_effector_path",
    "end_effector_twists": "plans[0].end_effector_twists",
    "predicted_target_path": "plans[0].target_path",
    "predicted_target_twists": "plans[0].target_twists",
    "xi": "plans[0].xi",
    "orientation_reading": "plans[0].orientation_reading",
    "parametrisation": "plans[0].family",
    "geometry": "plans[0].geometry",
    "duration": "plans[0].duration",
    "first_guess": "inputs.first_guess",
    "metrics": "metrics[0]",
    "solver": "solver",
}
_SWITCHES = ("use_start_state", "use_obstacles", "use_target_body")


def _number_of(word: str) -> int:
    """Return the number of an orientation; an unknown word gets a number that is unknown, too."""
    words = [str(one) for one in Orientation]
    return words.index(word or Orientation.FIXED) if word in ("", *words) else len(words)


_TRANSLATED = {
    "capture": lambda captures: int(GoalKind.CAPTURE if captures else GoalKind.POSE),
    "orientation": _number_of,
    "end_behaviour": lambda word: "none" if word == "as_planned" else word,
}


def present_request(request: Any) -> Any:
    """Return a decoded request, of whatever version, as one of version 0.3.

    Raises:
        AttributeError: The object is no request.
    """
    present = value_at(request, "request", None)
    if present is not None:
        return present
    absent = {name.removeprefix("use_") for name in _SWITCHES if not value_at(request, name, False)}
    for name in ("limit_chaser_attitude", "limit_chaser_rotation"):
        if not value_at(request, name, 0.0):
            absent.add(name)
    pairs, distance = (value_at(request, n, ()) for n in ("allowed_at_goal", "contact_distance"))
    if not (len(pairs) or distance):
        absent |= {"allowed_at_goal", "contact_distance"}
    if not _asks_for_approach(request):
        absent |= {"approach_direction", "approach_distance", "approach_cone"}
    moved = _moved(request, REQUEST_FIELDS, _TRANSLATED, {*absent, *_SWITCHES})
    return _message("PlanRequest", moved)


def present_answer(response: Any) -> Any:
    """Return a decoded answer, of whatever version, as one of version 0.3.

    Raises:
        AttributeError: The object is no answer.
    """
    present = value_at(response, "answer", None)
    if present is not None:
        return present
    solved = response.status.code == 0
    absent = {name for name, place in ANSWER_FIELDS.items() if place.startswith("plans[0]")}
    absent = set() if solved else absent
    if not (solved or response.solver.rollouts):
        absent.add("metrics")
    moved = _moved(response, ANSWER_FIELDS, {}, absent)
    guess = value_at(moved, "inputs.first_guess", None)
    if solved and guess is not None:
        moved.plans[0].first_guess = guess
    return _message("PlanAnswer", moved)


def _asks_for_approach(request: Any) -> bool:
    direction = value_at(request, "approach_direction", None)
    numbers = () if direction is None else (direction.x, direction.y, direction.z)
    more = (value_at(request, name, 0.0) for name in ("approach_distance", "approach_cone"))
    return any((*numbers, *more))


def _moved(
    old: Any,
    places: Mapping[str, str],
    translated: Mapping[str, Callable[[Any], Any]],
    absent: set[str],
) -> SimpleNamespace:
    """Return the fields of a message in their present places, without those that it lacks."""
    moved = SimpleNamespace()
    for name, place in places.items():
        value = value_at(old, name, None)
        if name in absent or value is None:
            continue
        value = translated.get(name, lambda same: same)(value)
        holder, (*parts, last) = vars(moved), place.split(".")
        for part in parts:
            array, is_entry, _ = part.partition("[0]")
            if array not in holder:
                made = _message(_PARTS[array], SimpleNamespace())
                holder[array] = [made] if is_entry else made
            holder = vars(holder[array][0] if is_entry else holder[array])
        array, is_entry, _ = last.partition("[0]")
        holder[array] = [value] if is_entry else value
    return moved


# The messages of the parts, by the names of the fields that hold them.
_PARTS = {
    "goal": "Goal",
    "approach": "Approach",
    "allowed_collisions": "AllowedCollisions",
    "objective": "Objective",
    "limits": "Limits",
    "search": "SearchOptions",
    "inputs": "PlanInputs",
    "plans": "Plan",
}


def _message(kind: str, fields: SimpleNamespace) -> SimpleNamespace:
    fields.__msgtype__ = f"ff_planner_msgs/msg/{kind}"
    return fields
