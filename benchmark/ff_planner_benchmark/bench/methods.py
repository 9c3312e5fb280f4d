"""The planner beside other methods, on the paper's capture."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.optimize import nnls

from ff_planner_benchmark.bench.direct import solve_directly
from ff_planner_benchmark.bench.exact import solve_by_slsqp
from ff_planner_benchmark.bench.measurement import OBJECTIVES, Measurement, timed_plans
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.text_table import Table
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.planning.motion.system_frame import in_own_frame
from ff_planner_ros.planning.optimisation.program import PathProgram, path_program
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.problems.paths import clearance_along, roll_out, weighted_objective

OURS = "ff_planner"
_HEADER = (
    *("objective", "method", "time / ours", "time [s]", "rollouts", "value [rad]"),
    *("optimality", "clearance [mm]", "why it stopped"),
)

# A constraint within this of its bound, or a peak within this of the highest, may carry a
# multiplier [m or rad].
_ACTIVE = 3e-3


@dataclass(frozen=True)
class Result:
    """The result of a method for one objective."""

    objective: str  # key of `OBJECTIVES`
    method: str
    seconds: float  # median over the runs
    rollouts: int  # motions integrated, with or without derivatives
    # The next three are None where the method ended at a path that meets a singularity
    value: float | None  # of the objective, computed the same way for every method [rad]
    optimality: float | None  # largest entry of the Lagrangian's gradient, with best multipliers
    clearance: float | None  # certified between the points too [m]
    message: str  # why it stopped


def measurement(problem: PlanningProblem, settings: PlannerSettings, *, quick: bool) -> Measurement:
    """Compare the methods on a problem; if quick, stop the others early."""
    runs, iterations = (1, 2) if quick else (7, 200)
    results = list(method_results(problem, settings, runs, iterations))
    ours = {each.objective: each.seconds for each in results if each.method == OURS}
    rows = [
        (
            *(each.objective, each.method, f"{each.seconds / ours[each.objective]:.1f}"),
            *(f"{each.seconds:.3f}", f"{each.rollouts}", *_path_cells(each), each.message),
        )
        for each in results
    ]
    table = Table("The paper's capture, 50 points", _HEADER, rows)
    return Measurement(results, [table])


def _path_cells(result: Result) -> Iterator[str]:
    """Yield value, optimality and clearance [mm] of where a method ended."""
    if result.value is None or result.optimality is None or result.clearance is None:
        yield from ("singular", "-", "-")
        return
    yield f"{result.value:.4f}"
    yield f"{result.optimality:.1e}"
    yield f"{result.clearance * 1e3:.1f}"


def method_results(
    problem: PlanningProblem, settings: PlannerSettings, runs: int, max_iterations: int
) -> Iterator[Result]:
    """Yield the results of every method for every objective, ours first.

    Args:
        problem: Its own objective is replaced.
        runs: Number of our planner's runs, after one to warm up; the others, far slower, run once.
        max_iterations: Of the other methods.
    """
    for name, objective in OBJECTIVES.items():
        asked = replace(problem, objective=objective)
        yield _ours(name, asked, settings, runs)
        asked = in_own_frame(asked)  # the others in the frame that ours plans in
        program = path_program(asked, end_effector_paths(asked), settings)
        for method, solve in (
            ("SLSQP, exact gradients", solve_by_slsqp),
            ("direct (paper)", partial(solve_directly, settings)),
        ):
            begun = time.process_time()
            stop = solve(program, max_iterations)
            seconds = time.process_time() - begun
            value, optimality, clearance = _measured(asked, program, stop.x)
            yield Result(
                objective=name,
                method=method,
                seconds=seconds,
                rollouts=stop.rollouts,
                value=value,
                optimality=optimality,
                clearance=clearance,
                message=stop.message,
            )


def _measured(
    problem: PlanningProblem, program: PathProgram, x: Array
) -> tuple[float | None, float | None, float | None]:
    """Return objective, optimality and clearance of a path; None: it meets a singularity."""
    try:
        motion = roll_out(problem, x)
    except NoPlanFound:
        return None, None, None
    optimality = _optimality(program, x)
    return weighted_objective(problem, motion), optimality, clearance_along(problem, x)


def _ours(name: str, problem: PlanningProblem, settings: PlannerSettings, runs: int) -> Result:
    (plan, *_), seconds = timed_plans([problem] * (1 + runs), settings, warm_up=1)
    metrics, weights = plan.metrics, problem.objective
    return Result(
        objective=name,
        method=OURS,
        seconds=seconds,
        rollouts=plan.solver.rollouts,
        value=weights.joint_path_length * metrics.joint_path_length
        + weights.chaser_attitude * metrics.max_chaser_euler,
        optimality=plan.solver.optimality,
        clearance=metrics.min_clearance,
        message=plan.solver.stop_reason,
    )


def _optimality(program: PathProgram, x: Array) -> float:
    """Return the largest entry of the Lagrangian's gradient, with least-squares multipliers."""
    here = program.linearise(x)
    active = here.constraints < min(0.0, here.constraints.min(initial=0.0)) + _ACTIVE
    columns, wanted = -here.constraints_jacobian[active].T, -here.gradient
    if here.max_terms.size:
        # The multipliers of the max terms sum to one: a row that weighs more than all others.
        highest = here.max_terms > here.max_terms.max() - _ACTIVE
        heavy = 1e3
        columns = np.hstack([columns, here.max_terms_jacobian[highest].T])
        sums = np.append(np.zeros(active.sum()), np.full(highest.sum(), heavy))
        columns, wanted = np.vstack([columns, sums]), np.append(wanted, heavy)
    multipliers, _ = nnls(columns, wanted)
    return float(np.abs(columns @ multipliers - wanted)[: len(here.gradient)].max())
