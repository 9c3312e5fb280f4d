"""Local optima on the coarsest grid: by successive halving of guesses, then by basin hopping."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import cycle

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.search.grid import Grid
from ff_planner_ros.planning.search.grid_solver import (
    SMALL_VIOLATION,
    GridSolver,
    PathSolution,
    rank,
)

# Successive halving: iterations for each guess; how many go on and for how many more; how many go
# on to an optimum, and for how many. Most guesses show early that they lead nowhere; some that are
# slow to begin with lead far.
_FIRST, _SECOND, _FINALISTS, _LAST = 14, (8, 8), 3, 24
# Hops of a round from the best path: at random along each direction, by two standard deviations in
# turn. Where one comes so near to the best it is worth more iterations.
_HOPS, _SPREADS, _NEARLY = 10, (0.1, 0.2), 1.3
# First trust region, far from an optimum. The path is moved in all of its own ways at once: half as
# bold as along single coefficients.
_RADIUS = 0.25
# Violations that do not stop the solver's steps, here and near an optimum.
_TOLERATED, TOLERATED_NEAR = 2e-2, 5e-3
# A joint path or an angle known to this part is known well enough to compare two.
_OPTIMALITY, _PROGRESS = 1e-5, 1e-4


@dataclass(frozen=True, eq=False)
class Optimum:
    """A path that is locally optimal on the coarsest grid, and feasible there."""

    path: PathSolution
    cost: float  # on the next finer grid


@dataclass(eq=False)
class BasinHopping:
    """Looks for local optima of an objective that has many."""

    solver: GridSolver
    grids: Callable[[], Sequence[Grid]]  # coarse to fine, with the objective
    attitude_alone: bool  # whether the cost is the attitude, without the tie break
    found: list[Optimum] = field(default_factory=list)

    @property
    def grid(self) -> Grid:
        """The coarsest one."""
        return self.grids()[0].with_stage(
            optimality=_OPTIMALITY, progress=_PROGRESS, tolerated=_TOLERATED, radius=_RADIUS
        )

    def best(self, count: int) -> list[Optimum]:
        """Return the optima of least cost."""
        return sorted(self.found, key=lambda optimum: optimum.cost)[:count]

    def halve(self, guesses: Sequence[Array]) -> None:
        """Find optima by successive halving of initial guesses."""
        grid, solver = self.grid, self.solver
        solver.starts += len(guesses)
        paths = [solver.solve(grid.with_stage(iterations=_FIRST), guess) for guess in guesses]
        count, iterations = _SECOND
        leading = sorted(paths, key=_lead)[:count]
        paths = [solver.solve(*_continuation(grid, path, iterations)) for path in leading]
        found = list[Optimum]()
        for number, path in enumerate(sorted(paths, key=_lead)):
            if number < _FINALISTS or not found:
                found += self._optima(path)
        self.found += found

    def hop(self, seed: int) -> None:
        """Look around the best optimum, then around the better one, and so on."""
        grid, random = self.grid, np.random.default_rng(seed)
        directions = grid.program.family.directions
        self.solver.starts += _HOPS
        for _, spread in zip(range(_HOPS), cycle(_SPREADS), strict=False):
            best = self.best(1)[0].path
            aside = directions @ random.normal(scale=spread, size=len(best.x))
            begin = best.x + aside, best.curvature
            path = self.solver.solve(grid.with_stage(iterations=_FIRST), *begin)
            if not _lead(path)[0] and path.at_x.objective < _NEARLY * best.at_x.objective:
                self.found += self._optima(path)

    def _optima(self, path: PathSolution) -> list[Optimum]:
        """Return the optimum that a path leads to, if finer grids do not refute it.

        Between few points a path may be singular or run through an obstacle.
        """
        grid = self.grid.with_stage(tolerated=TOLERATED_NEAR)
        path = self.solver.solve_feasibly(*_continuation(grid, path, _LAST))
        if not path.feasible:
            return []
        finer = self.solver.solve(self.grids()[1].with_stage(iterations=0), path.x).at_x
        if not finer.violation < SMALL_VIOLATION:
            return []
        cost = float(finer.max_terms.max()) if self.attitude_alone else finer.objective
        return [Optimum(path, cost)]


def _lead(path: PathSolution) -> tuple[bool, float]:
    """Return a key to sort by, the best first; a small violation can be mended later."""
    return rank(path, SMALL_VIOLATION)


def _continuation(
    grid: Grid, path: PathSolution, iterations: int
) -> tuple[Grid, Array, Array | None]:
    """Return what the solver needs to go on with a path."""
    grid = grid.with_stage(iterations=iterations, radius=path.radius)
    return grid, path.x, path.curvature
