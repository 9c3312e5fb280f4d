"""Answers as rows of a table, with their requests; all rows have the same columns."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.planning.motion.metrics import METRICS
from ff_planner_ros.planning.problem.goal_words import GoalKind

if TYPE_CHECKING:
    from ff_planner_ros.bag.plans import RecordedPlan

Cell: TypeAlias = float | int | str | None  # None: no value

# Fields of a request, by column.
_ASKED = {
    "target_frame": "goal.pose.header.frame_id",
    **{f"target_{axis}_m": f"goal.pose.pose.position.{axis}" for axis in "xyz"},
    **{f"target_q{axis}": f"goal.pose.pose.orientation.{axis}" for axis in "xyzw"},
    **{f"target_velocity_{axis}_m_per_s": f"goal.twist.linear.{axis}" for axis in "xyz"},
    **{f"target_angular_velocity_{a}_rad_per_s": f"goal.twist.angular.{a}" for a in "xyz"},
    "duration_s": "duration",
    "duration_max_s": "duration_max",
    "weight_joint_path_length": "objective.joint_path_length",
    "weight_chaser_attitude": "objective.chaser_attitude",
    "weight_duration_rad_per_s": "objective.duration",
    "asked_points": "search.points",
    "time_budget_s": "search.time_budget",
    "limit_chaser_attitude_rad": "limits.chaser_attitude[0]",
    "limit_chaser_rotation_rad": "limits.chaser_rotation[0]",
    "end_behaviour": "end_behaviour",
    "goal": "goal.kind",
    **{f"approach_direction_{axis}": f"goal.approach[0].direction.{axis}" for axis in "xyz"},
    "approach_distance_m": "goal.approach[0].distance",
    "approach_half_angle_rad": "goal.approach[0].half_angle",
}
# Zero stands for the node's parameter, or for a fixed duration: the request has no value.
_ZERO_IS_NONE = ("asked_points", "time_budget_s", "duration_max_s", "approach_half_angle_rad")
_SOLVER = {
    "solve_time_s": "solve_time",
    "starts": "starts",
    "iterations": "iterations",
    "rollouts": "rollouts",
    "stop_reason": "stop_reason",
}
_GUESS, _LIBRARY = "first_guess", "library"


def asked_in(request: Any) -> dict[str, Cell]:
    """Return the fields of a decoded request, by column."""
    row = {column: _cell(value_at(request, path, None)) for column, path in _ASKED.items()}
    kind = int(value_at(request, "goal.kind", GoalKind.POSE))
    row["goal"] = GoalKind(kind).name.lower() if kind in [*GoalKind] else str(kind)
    return row | {column: row[column] or None for column in _ZERO_IS_NONE}


def solver_in(answer: Any) -> dict[str, Cell]:
    """Return the solver's figures in a decoded answer, by column."""
    row = {
        column: _cell(value_at(answer, f"solver.{name}", None)) for column, name in _SOLVER.items()
    }
    guess = {_GUESS: _LIBRARY if len(answer.inputs.first_guess) else None}
    if row["rollouts"]:
        return row | guess
    # A refusal without an attempt has zeros, which mean nothing.
    return {column: row[column] or None for column in ("solve_time_s", "stop_reason")} | guess


def answer_row(plan: RecordedPlan) -> dict[str, Cell]:
    """Return an answer as a row: the same columns for every answer, None without a value."""
    asked: Mapping[str, Cell] = plan.asked or {}
    row: dict[str, Cell] = {
        "plan_id": plan.plan_id,
        "topic": plan.topic,
        "interface": plan.interface or None,
        "requester": plan.requester or None,
        "asked_ns": plan.asked_ns or None,
        "answered_ns": plan.answered_ns,
        "start_ns": plan.start_ns or None,
        "status": plan.status,
        "message": plan.message,
        **{column: asked.get(column) for column in _ASKED},
        **{column: plan.solver.get(column) for column in (*_SOLVER, _GUESS)},
        "points": None if plan.trajectory is None else len(plan.trajectory.time),
        "planned_duration_s": plan.duration,
    }
    for metric in METRICS:
        value = plan.metrics.get(metric.name)
        words = " ".join(map(repr, value)) if isinstance(value, tuple) else value
        row[f"{metric.name}{_behind(metric.unit)}"] = _cell(words)
    return row


def _behind(unit: str) -> str:
    """Return a unit as the suffix of a column's name."""
    return f"_{unit.replace('/', '_per_').replace(' ', '')}" if unit else ""


def _cell(value: Any) -> Cell:
    if value is None or (isinstance(value, float) and math.isnan(value)) or value == "":
        return None
    return value if isinstance(value, float | int | str) else str(value)
