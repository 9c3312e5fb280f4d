"""The straight line: the paper's path with xi = 0, which ignores the obstacles."""

from __future__ import annotations

import numpy as np

from ff_planner_ros.planning.check.preconditions import require_plannable
from ff_planner_ros.planning.motion.plan import Plan, SolverReport
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.paths.path_family import singular_refusal
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.search.candidate import Candidate, plan_of_path
from ff_planner_ros.planning.search.families import require_papers_paths


def straight_line(problem: PlanningProblem, settings: PlannerSettings) -> Plan:
    """Return the motion along the path without free terms, Sec. 4.1 of the paper, not yet checked.

    Raises:
        InvalidInput: The start violates a constraint, or there are no such paths for the arm, its
            base or the target.
        NoPlanFound: The goal is out of reach, or the path meets a dynamic singularity.
    """
    require_papers_paths(problem, "method", "straight line", "only the planner itself will do")
    require_plannable(problem, settings)
    family = end_effector_paths(problem)
    report = SolverReport(
        starts=1,
        iterations=0,
        rollouts=1,
        optimality=np.inf,
        stop_reason="straight line: xi = 0, nothing is optimised",
    )
    straight = np.zeros(family.variables)
    at_x = path_program(problem, family, settings).linearise(straight)
    if at_x.motion.singular_at is not None:
        raise singular_refusal(at_x.motion.singular_at, problem.duration)
    return plan_of_path(problem, settings, family, Candidate(at_x, report)).plan
