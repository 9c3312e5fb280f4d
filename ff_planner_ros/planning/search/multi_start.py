"""Multi-start: from initial guesses in turn, on the coarse grids, then on all points."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain, islice

from ff_planner_ros.common.arrays import Array, finite_vector
from ff_planner_ros.errors import OutOfTime
from ff_planner_ros.planning.check.check import out_of_time, refusal
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.optimisation.solver import Stop
from ff_planner_ros.planning.paths.path_family import singular_refusal
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.search.grid_solver import GridSolver, PathSolution, rank
from ff_planner_ros.robot.collision.geometry import Geometry

# A path that violates obstacles by less on few points [m] may be feasible on more points.
PROMISING_VIOLATION = 5e-3
# A feasible path with a larger first-order optimality runs along a singularity.
_PROMISING_OPTIMALITY = 0.1
# Where an edge of a body slides along another, multipliers converge slowly however good the path:
# without this, 9 of 60 problems went on to other guesses, and 4 of them ended with a longer path.
_PROMISING_OPTIMALITY_OF_BODIES = 1.0
# On few points the solver gives up early: after this many guesses, go on from the best failure.
_RECONSIDER = 5


def first_plan(
    solver: GridSolver,
    first_guess: Array | None,
    elsewhere: Callable[[PathSolution], Plan | None],
) -> Plan:
    """Return the first plan to which an initial guess leads.

    Args:
        first_guess: Tried before the family's own guesses.
        elsewhere: A plan to return instead of refining a path on the coarsest grid, if any.

    Raises:
        NoPlanFound: No path was feasible, or the check refused it.
        OutOfTime: By the watch; `refusal` says how far the search came.
    """
    if first_guess is not None:
        first_guess = finite_vector("first_guess", first_guess, solver.program.family.variables)
    try:
        for coarse in _coarse_paths(solver, first_guess):
            found = elsewhere(coarse) or _plan_along(solver, coarse)
            if found is not None:
                return found
    except OutOfTime as end:
        attempt, violated, _ = solver.best_attempt()
        end.refusal = out_of_time(end, attempt, [failure for _, failure in violated])
        raise
    attempt, violated, singular_at = solver.best_attempt()
    if attempt is None:
        refused = singular_refusal(singular_at, solver.problem.duration)
    else:
        refused = refusal(attempt, [one for _, one in violated])
        refused.requirement = violated[0][0] if violated else ""
    refused.met = solver.effort.met
    raise refused


def _plan_along(solver: GridSolver, coarse: PathSolution) -> Plan | None:
    """Return the plan to which a path on the coarsest grid leads, if it passes the check."""
    solution = coarse
    for grid in solver.grids[1:-1]:
        finer = solver.solve(grid, solution.x)
        solution = finer if finer.at_x.is_defined else solution
    grid = solver.grids[-1].with_correction(solution.x)
    found, followed = solver.tighten(grid, solver.solve(grid, solution.x), solver.solve_and_restore)
    plan = next(solver.sound_plans(found, followed), None)
    if plan is None:
        solver.keep_attempt(found)
    return plan


def _coarse_paths(solver: GridSolver, first_guess: Array | None) -> Iterator[PathSolution]:
    """Yield paths on the coarsest grid that are worth solving on finer grids."""
    starts = solver.settings.starts
    given = [] if first_guess is None else [first_guess]
    postponed: list[PathSolution] = []
    for number, guess in enumerate(islice(chain(given, solver.initial_guesses()), starts), start=1):
        solver.effort.starts += 1
        coarse = solver.solve_coarsely(guess)
        if is_promising(coarse, solver.problem):
            yield coarse
            continue
        if coarse.at_x.is_defined:
            postponed.append(coarse)
        if postponed and (number % _RECONSIDER == 0 or number == starts):
            best = min(postponed, key=rank)
            postponed.remove(best)
            yield best


def is_promising(coarse: PathSolution, problem: PlanningProblem) -> bool:
    """Tell whether a solution on the coarsest grid is worth solving on finer grids."""
    if coarse.feasible:
        has_edges = problem.robot.geometry is Geometry.SHAPES or not all(
            one.is_sphere for one in problem.obstacles
        )
        most = _PROMISING_OPTIMALITY_OF_BODIES if has_edges else _PROMISING_OPTIMALITY
        return coarse.stop is Stop.CREEPING or coarse.optimality <= most
    return coarse.at_x.violation <= PROMISING_VIOLATION
