"""The planner beside other methods, on the paper's capture."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from ff_planner_ros.arrays import Array
from ff_planner_ros.bench.direct import Stop, solve_directly
from ff_planner_ros.bench.exact import solve_by_slsqp
from ff_planner_ros.bench.ipopt import solve_by_ipopt
from ff_planner_ros.bench.paths import clearance_along, roll_out
from ff_planner_ros.planning.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.objectives import chaser_euler, joint_path_length
from ff_planner_ros.planning.plan import Plan
from ff_planner_ros.planning.planner import plan
from ff_planner_ros.planning.problem import Objective, PlanningProblem
from ff_planner_ros.planning.program import PathProgram, path_program
from ff_planner_ros.planning.settings import PlannerSettings

OBJECTIVES = {
    "min(L)": Objective(1.0, 0.0),
    "min(Theta)": Objective(0.0, 1.0),
    "L + Theta": Objective(1.0, 1.0),
}
OURS = "ff_planner"

# A constraint within this of its bound, or a peak within this of the highest, may carry a
# multiplier [m or rad].
_ACTIVE = 3e-3


@dataclass(frozen=True)
class Result:
    """How a method did on one objective."""

    objective: str  # key of `OBJECTIVES`
    method: str
    seconds: float  # median over the runs
    rollouts: int  # motions integrated, with or without derivatives
    value: float  # of the objective, whatever the method minimised [rad]
    optimality: float  # largest entry of the Lagrangian's gradient, with the best multipliers
    clearance: float  # certified between the points too [m]
    message: str  # why it stopped


def method_results(
    problem: PlanningProblem, settings: PlannerSettings, runs: int, max_iterations: int
) -> Iterator[Result]:
    """Yield the results of every method for every objective, ours first.

    Args:
        problem: What is asked; its objective does not matter.
        runs: Of our own planner, after one to warm up; the others, far slower, run once.
    """
    for name, objective in OBJECTIVES.items():
        asked = replace(problem, objective=objective)
        yield _ours(name, asked, settings, runs)
        program = path_program(asked, end_effector_paths(asked), settings)

        def directly(asked: PlanningProblem = asked) -> Stop:
            return solve_directly(asked, settings, max_iterations)

        def by_slsqp(program: PathProgram = program) -> Stop:
            return solve_by_slsqp(program, max_iterations)

        def by_ipopt(program: PathProgram = program) -> Stop | None:
            return solve_by_ipopt(program, max_iterations)

        for method, solve in (
            ("SLSQP, exact gradients", by_slsqp),
            ("IPOPT, exact gradients", by_ipopt),
            ("direct (paper)", directly),
        ):
            result = _other(name, method, asked, program, solve)
            if result is not None:
                yield result


def timed_plan(
    problem: PlanningProblem, settings: PlannerSettings, runs: int
) -> tuple[Plan, float]:
    """Return a plan and the median time that it takes, after one run to warm up.

    Args:
        runs: At least one.

    Raises:
        NoPlanFound: There is no plan.
    """
    answer, seconds = plan(problem, settings), []
    for _ in range(runs):
        begun = time.perf_counter()
        plan(problem, settings)
        seconds.append(time.perf_counter() - begun)
    return answer, statistics.median(seconds)


def _ours(name: str, problem: PlanningProblem, settings: PlannerSettings, runs: int) -> Result:
    answer, seconds = timed_plan(problem, settings, runs)
    metrics = answer.metrics
    return Result(
        objective=name,
        method=OURS,
        seconds=seconds,
        rollouts=answer.solver.rollouts,
        value=_value(problem.objective, metrics.joint_path_length, metrics.max_chaser_euler),
        optimality=answer.solver.optimality,
        clearance=metrics.min_clearance,
        message=answer.solver.stop_reason,
    )


def _other(
    name: str,
    method: str,
    problem: PlanningProblem,
    program: PathProgram,
    solve: Callable[[], Stop | None],
) -> Result | None:
    begun = time.perf_counter()
    answer = solve()
    seconds = time.perf_counter() - begun
    if answer is None:
        return None
    rollout = roll_out(problem, answer.x)
    length = joint_path_length(rollout.v[:, 6:], problem.duration / (problem.points - 1))
    attitude = float(np.abs(chaser_euler(problem.robot, rollout.q)).max())
    return Result(
        objective=name,
        method=method,
        seconds=seconds,
        rollouts=answer.rollouts,
        value=_value(problem.objective, length, attitude),
        optimality=_optimality(program, answer.x),
        clearance=clearance_along(problem, answer.x),
        message=answer.message,
    )


def _value(weights: Objective, length: float, attitude: float) -> float:
    return weights.joint_path_length * length + weights.chaser_attitude * attitude


def _optimality(program: PathProgram, x: Array) -> float:
    """Return what is left of the Lagrangian's gradient with the multipliers that fit best."""
    here = program.linearise(x)
    active = here.constraints < min(0.0, here.constraints.min(initial=0.0)) + _ACTIVE
    columns, wanted = -here.constraints_jacobian[active].T, -here.gradient
    if here.peaks.size:
        # The multipliers of the peaks sum to one: a row that weighs more than all others.
        highest = here.peaks > here.peaks.max() - _ACTIVE
        heavy = 1e3
        columns = np.hstack([columns, here.peaks_jacobian[highest].T])
        sums = np.append(np.zeros(active.sum()), np.full(highest.sum(), heavy))
        columns, wanted = np.vstack([columns, sums]), np.append(wanted, heavy)
    multipliers, _ = nnls(columns, wanted)
    return float(np.abs(columns @ multipliers - wanted)[: len(here.gradient)].max())
