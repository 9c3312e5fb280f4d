"""The planner beside other methods, on the paper's capture."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.optimize import nnls

from ff_planner_benchmark.bench import columns
from ff_planner_benchmark.bench.direct import Stop, solve_directly, weighted_objective
from ff_planner_benchmark.bench.exact import solve_by_slsqp
from ff_planner_benchmark.bench.experiment import OBJECTIVES, Experiment, Row, timed_plans
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.planning.motion.system_frame import in_own_frame
from ff_planner_ros.planning.optimisation.program import PathProgram, path_program
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.problems.paths import clearance_along, roll_out

# A constraint within this of its bound, or a peak within this of the highest, may carry a
# multiplier [m or rad].
_ACTIVE = 3e-3


def _methods(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Solve the capture for every objective by every method, ours first.

    Ours runs once to warm up and so many times for its median; the others, far slower, once. A run
    of one stops them early.
    """
    problem = load_scenario(share_directory() / "config" / "scenarios" / "lemur_capture.yaml")
    iterations = 2 if count == 1 else 200
    for name, objective in OBJECTIVES.items():
        asked = replace(problem, objective=objective)
        ours = _ours(asked, settings, count)
        yield {"objective": name, "method": "ff_planner", "times_ours": 1.0} | ours
        asked = in_own_frame(asked)  # the others in the frame that ours plans in
        program = path_program(asked, end_effector_paths(asked), settings)
        for method, solve in (
            ("SLSQP, exact gradients", solve_by_slsqp),
            ("direct (paper)", partial(solve_directly, settings)),
        ):
            begun = time.process_time()
            stop = solve(program, iterations)
            seconds = time.process_time() - begun
            row = {"objective": name, "method": method, "seconds": seconds}
            yield row | _of_stop(program, stop) | {"times_ours": seconds / ours["seconds"]}


def _ours(problem: PlanningProblem, settings: PlannerSettings, runs: int) -> Row:
    (plan, *_), seconds = timed_plans([problem] * (1 + runs), settings, warm_up=1)
    metrics, weights = plan.metrics, problem.objective
    length = weights.joint_path_length * metrics.joint_path_length
    return {
        "seconds": seconds,
        "rollouts": plan.solver.rollouts,
        "value": length + weights.chaser_attitude * metrics.max_chaser_euler,
        "optimality": plan.solver.optimality,
        "clearance": metrics.min_clearance,
        "message": plan.solver.stop_reason,
    }


def _of_stop(program: PathProgram, stop: Stop) -> Row:
    """Return what a method did; no value, optimality and clearance where it met a singularity."""
    problem = program.problem
    row: Row = {"rollouts": stop.rollouts, "message": stop.message}
    try:
        motion = roll_out(problem, stop.x)
    except NoPlanFound:
        return row | dict.fromkeys(("value", "optimality", "clearance"))
    return row | {
        "value": weighted_objective(problem, motion),
        "optimality": _optimality(program, stop.x),
        "clearance": clearance_along(problem, stop.x),
    }


METHODS = Experiment(
    "methods",
    "The paper's capture, 50 points",
    _methods,
    {"objective": "objective", "method": "method"},
    {
        "time / ours": columns.text("times_ours", ".1f"),
        "time [s]": columns.text("seconds", ".3f"),
        "rollouts": columns.text("rollouts"),
        "value [rad]": columns.text("value", ".4f", unknown="singular"),
        "optimality": columns.text("optimality", ".1e"),
        "clearance [mm]": columns.value("clearance", max, ".1f", 1e3),
        "why it stopped": columns.text("message"),
    },
    most=7,
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
