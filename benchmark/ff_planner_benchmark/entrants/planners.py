"""Methods that are made of our parts: the planner, with wrong beliefs too, and the paper's way."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from ff_planner_benchmark.bench.direct import solve_directly
from ff_planner_ros.baselines.beliefs import fixed_base, zero_momentum
from ff_planner_ros.errors import FfPlannerError
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan, SolverReport, Trajectory
from ff_planner_ros.planning.motion.system_frame import in_own_frame
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.paths.path_family import singular_refusal
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.search.candidate import Candidate, plan_of_path
from ff_planner_ros.planning.search.families import require_papers_paths
from ff_planner_ros.planning.task.task import PlanningTask, perform

_OF_ANSWER = ("time", "joint_positions", "joint_velocities", "joint_accelerations")
_ITERATIONS = 100  # of the paper's way


def answer(method: str, scenario: Path, _seconds: float) -> dict[str, Any]:
    """Return the answer of one of `PLANNERS` to a scenario; a refusal is an answer, too.

    They stop by their iteration limits; the time limit is left to the contest.
    """
    try:
        made = PLANNERS[method](load_scenario(scenario), load_parameters().planner)
    except FfPlannerError as error:
        return {"status": error.status.name.lower(), "message": str(error)}
    motion = made.trajectory if isinstance(made, Plan) else made
    return {"status": "solved"} | {name: getattr(motion, name).tolist() for name in _OF_ANSWER}


def _ours(problem: PlanningProblem, settings: PlannerSettings) -> Plan:
    return perform(PlanningTask(problem, settings))


def _direct(problem: PlanningProblem, settings: PlannerSettings) -> Plan:
    """Plan by the paper's optimisation as printed."""
    require_papers_paths(problem, "method", "direct", "only the planner itself will do")
    problem = in_own_frame(problem)
    family = end_effector_paths(problem)
    program = path_program(problem, family, settings)
    stop = solve_directly(settings, program, _ITERATIONS)
    at_x = program.linearise(stop.x)
    if at_x.motion.singular_at is not None:
        raise singular_refusal(at_x.motion.singular_at, problem.duration)
    report = SolverReport(1, 0, stop.rollouts, float("inf"), stop.message)
    return plan_of_path(problem, settings, family, Candidate(at_x, report)).plan


# The last two assume an immovable chaser, and zero total momentum: the true system executes them.
PLANNERS: dict[str, Callable[[PlanningProblem, PlannerSettings], Plan | Trajectory]] = {
    "ours": _ours,
    "direct": _direct,
    "fixed_base": fixed_base,
    "zero_momentum": zero_momentum,
}
