"""Multi-start: from one initial guess after the other, on the coarse grids, then on all points."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, islice

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import Watch
from ff_planner_ros.planning.optimisation.program import PathProgram
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.search.grid_solver import GridSolver, PathSolution, rank
from ff_planner_ros.robot.collision.geometry import Geometry

# More points need not meet an obstacle that few points run into by less [m].
PROMISING_VIOLATION = 5e-3
# A feasible path that is further from its optimum runs along a singularity.
_PROMISING_OPTIMALITY = 0.1
# Bodies have edges, and where one follows another the multipliers are off for long, however good
# the path is: of 60 problems 9 looked for others first, and 4 of them ended with a longer path.
_PROMISING_OPTIMALITY_OF_BODIES = 1.0
# On few points the solver gives up early: after this many guesses, go on from the best failure.
_RECONSIDER = 5


class Search(GridSolver):
    """Looks for paths from one initial guess after the other."""

    def __init__(
        self,
        program: PathProgram,
        settings: PlannerSettings,
        watch: Watch,
        first_guess: Array | None,
    ) -> None:
        """Prepare to search from a program on all points; a first guess is tried before others."""
        super().__init__(program, settings, watch)
        self._first_guess = first_guess

    def plans(self) -> Iterator[Plan]:
        """Yield plans that pass the check.

        Raises:
            OutOfTime: By the watch.
        """
        for coarse in self._coarse_paths():
            solution = coarse
            for grid in self.grids[1:-1]:
                finer = self.solve(grid, solution.x)
                solution = finer if finer.at_x.is_defined else solution
            grid = self.grids[-1].with_correction(solution.x)
            found, followed = self.tighten(
                grid, self.solve(grid, solution.x), self.solve_and_restore
            )
            yield from self.sound_plans(found, followed)
            if found.at_x.is_defined:
                self._on_all_points.append(found)

    def _coarse_paths(self) -> Iterator[PathSolution]:
        """Yield paths on the coarsest grid that deserve to be solved on finer ones."""
        starts, geometry = self._settings.starts, self._program.problem.robot.geometry
        given = [] if self._first_guess is None else [self._first_guess]
        postponed: list[PathSolution] = []
        for guess in islice(chain(given, self.initial_guesses()), starts):
            self.starts += 1
            coarse = self.solve(self.grids[0], guess)
            if is_promising(coarse, geometry):
                yield coarse
                continue
            if coarse.at_x.is_defined:
                postponed.append(coarse)
            if postponed and (self.starts % _RECONSIDER == 0 or self.starts == starts):
                best = min(postponed, key=rank)
                postponed.remove(best)
                yield best


def is_promising(coarse: PathSolution, geometry: Geometry) -> bool:
    """Tell whether finer grids may make a path of it."""
    if coarse.feasible:
        has_edges = geometry is Geometry.SHAPES
        most = _PROMISING_OPTIMALITY_OF_BODIES if has_edges else _PROMISING_OPTIMALITY
        return coarse.optimality <= most
    return coarse.at_x.violation <= PROMISING_VIOLATION
