"""Scenario files and answers of entrants that are made of our own parts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.scenario.scenario import load_scenario

_OF_ANSWER = ("time", "joint_positions", "joint_velocities", "joint_accelerations")


def answer_of(
    scenario: Path, plan: Callable[[PlanningProblem, PlannerSettings], Plan | Trajectory]
) -> dict[str, Any]:
    """Return the answer of a planning function to a scenario; a refusal is an answer, too."""
    try:
        made = plan(load_scenario(scenario), load_parameters().planner)
    except FfPlannerError as error:
        return {"status": error.status.name.lower(), "message": str(error)}
    motion = made.trajectory if isinstance(made, Plan) else made
    return {"status": "solved"} | {name: getattr(motion, name).tolist() for name in _OF_ANSWER}
