"""The check of a plan as an error."""

from __future__ import annotations

from ff_planner_ros.planning.check.check import failures, refusal
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings


def require_sound(problem: PlanningProblem, plan: Plan, settings: PlannerSettings) -> None:
    """Raise the refusal of a plan that fails the check."""
    found = list(failures(problem, plan, settings))
    if found:
        raise refusal(plan, found)
