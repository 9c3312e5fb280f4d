"""The paper's optimisation as printed, by SciPy's SLSQP with finite differences."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ff_planner_benchmark.bench.direct import solve_directly
from ff_planner_benchmark.entrants.planned import answer_of
from ff_planner_ros.planning.motion.plan import Plan, SolverReport
from ff_planner_ros.planning.motion.system_frame import in_own_frame
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.paths.path_family import singular_refusal
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.search.candidate import Candidate, plan_of_path
from ff_planner_ros.planning.search.families import require_papers_paths

_ITERATIONS = 100


def answer(scenario: Path, _seconds: float) -> dict[str, Any]:
    """Optimise; the time limit is left to the contest."""
    return answer_of(scenario, _direct)


def _direct(problem: PlanningProblem, settings: PlannerSettings) -> Plan:
    require_papers_paths(problem, "method", "direct", "only the planner itself will do")
    problem = in_own_frame(problem)
    family = end_effector_paths(problem)
    program = path_program(problem, family, settings)
    stop = solve_directly(settings, program, _ITERATIONS)
    at_x = program.linearise(stop.x)
    if at_x.motion.singular_at is not None:
        raise singular_refusal(at_x.motion.singular_at, problem.duration)
    report = SolverReport(1, 0, stop.rollouts, float("inf"), stop.message)
    return plan_of_path(problem, settings, family, Candidate(at_x, report))
