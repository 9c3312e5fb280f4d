"""The check of a plan as an error, and of a plan as the user sees it."""

from __future__ import annotations

from ff_planner_ros.errors import Failure
from ff_planner_ros.planning.check.check import failures, refusal
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.system_frame import system_frame
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings


def require_sound(problem: PlanningProblem, plan: Plan, settings: PlannerSettings) -> None:
    """Raise the refusal of a plan that fails the check."""
    found = failures(problem, plan, settings)
    if found:
        raise refusal(plan, found)


def violations(
    problem: PlanningProblem, plan: Plan, settings: PlannerSettings
) -> tuple[Failure, ...]:
    """What the check finds of a plan of the user's frame, in the frame that plans are made in."""
    frame = system_frame(problem.robot, problem.start)
    return failures(frame.problem(problem), frame.plan(plan), settings)
