"""Multi-start: from initial guesses in turn, on the coarse grids, then on all points."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, islice

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.plan import Plan
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


def plans(solver: GridSolver, first_guess: Array | None) -> Iterator[Plan]:
    """Yield plans that pass the check, one for each initial guess that leads to one.

    Args:
        first_guess: Tried before the family's own guesses.

    Raises:
        OutOfTime: By the watch.
    """
    for coarse in _coarse_paths(solver, first_guess):
        solution = coarse
        for grid in solver.grids[1:-1]:
            finer = solver.solve(grid, solution.x)
            solution = finer if finer.at_x.is_defined else solution
        grid = solver.grids[-1].with_correction(solution.x)
        found, followed = solver.tighten(
            grid, solver.solve(grid, solution.x), solver.solve_and_restore
        )
        yield from solver.sound_plans(found, followed)
        solver.keep_attempt(found)


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
        has_edges = problem.robot.geometry is Geometry.SHAPES or problem.obstacle_bodies
        most = _PROMISING_OPTIMALITY_OF_BODIES if has_edges else _PROMISING_OPTIMALITY
        return coarse.optimality <= most
    return coarse.at_x.violation <= PROMISING_VIOLATION
