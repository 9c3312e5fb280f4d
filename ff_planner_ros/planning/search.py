"""Where the solver starts, and on how many points: from few to all."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import chain, islice
from typing import TypeAlias

from ff_planner_ros.arrays import Array
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.planning.check import certified_clearance
from ff_planner_ros.planning.detours import first_guesses
from ff_planner_ros.planning.program import PathLinearisation, PathProgram
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.planning.solver import Solution, minimise
from ff_planner_ros.planning.watch import REFINING, SEARCHING, Progress

PathSolution: TypeAlias = Solution[PathLinearisation]


@dataclass(frozen=True)
class _Level:
    """A time grid to solve on, and how well."""

    points: int
    extra_margin: float  # [m] for the gaps between the points, which are wider on fewer points
    optimality: float
    progress: float
    iterations: int
    damping: float  # where a singularity in the way shall not stop the search


# Few points find the way around the obstacles at a tenth of the price; the next grid brings the
# path so near its optimum that on all points a few iterations remain.
_COARSE_LEVELS = (_Level(13, 0.001, 1e-2, 2e-3, 40, 0.005), _Level(25, 0.0, 3e-3, 2e-4, 40, 0.0))
# On all points, nobody tells such a part of a joint path or of an angle.
_LEAST_PROGRESS = 2e-5
# More points need not meet an obstacle that few points run into by less [m].
_PROMISING_VIOLATION = 5e-3
# A feasible path that is further from its optimum runs along a singularity.
_PROMISING_OPTIMALITY = 0.1
# The solver gives up early on few points: after so many guesses, go on from the best that failed.
_RECONSIDER = 5
# Each round roughly halves what is missing between the points.
_MARGIN_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class _Grid:
    """The optimisation problem of one level."""

    level: _Level
    program: PathProgram


class Search:
    """Looks for paths, and keeps count of what it takes.

    Attributes:
        starts: First guesses tried so far.
        solved: What the solver came to, on any number of points.
        refusals: Where the way was singular.
    """

    def __init__(
        self,
        program: Callable[[int, float, float], PathProgram],
        points: int,
        settings: PlannerSettings,
        report: Callable[[Progress], None],
        first_guess: Array | None,
    ) -> None:
        """Prepare to search.

        Args:
            program: Gives the optimisation problem for a number of points, a clearance margin [m]
                and a damping of the velocity map.
            report: Told of every path that is looked at.
            first_guess: Tried before all others; None: there is none.
        """
        self._settings = settings
        self._report = report
        self._looks = 0
        self._first_guess = first_guess
        all_points = _Level(
            points,
            0.0,
            settings.optimality_tolerance,
            _LEAST_PROGRESS,
            settings.max_iterations,
            0.0,
        )
        levels = [*(level for level in _COARSE_LEVELS if level.points < points), all_points]
        margin = settings.clearance_margin
        self._grids = [
            _Grid(level, program(level.points, margin + level.extra_margin, level.damping))
            for level in levels
        ]
        self.starts = 0
        self.solved: list[PathSolution] = []
        self.refusals: list[NoPlanFound] = []

    @property
    def iterations(self) -> int:
        """Quadratic programs solved so far."""
        return sum(solution.iterations for solution in self.solved)

    @property
    def evaluations(self) -> int:
        """Rollouts with derivatives so far."""
        return sum(solution.evaluations for solution in self.solved)

    def progress(self, phase: str, at_x: PathLinearisation) -> Progress:
        """Tell how far the search has come.

        Args:
            at_x: Of the path last looked at.
        """
        return Progress(phase, self.starts, self._looks, at_x.objective, at_x.violation)

    def paths(self) -> Iterator[PathSolution]:
        """Yield paths on all points, from one first guess after the other; not all keep it all.

        Raises:
            OutOfTime: By the programs.
        """
        for rough in self._rough_paths():
            solution = rough
            for grid in self._grids[1:-1]:
                solution = self._solve(grid, solution.x) or solution
            answer = self._solve_between_points(self._grids[-1], solution.x)
            if answer is not None:
                yield answer

    def _rough_paths(self) -> Iterator[PathSolution]:
        """Yield paths on few points that are worth more of them."""
        grid, starts = self._grids[0], self._settings.starts
        postponed: list[PathSolution] = []
        given = [] if self._first_guess is None else [self._first_guess]
        guesses = chain(given, first_guesses(grid.program, starts))
        for guess in islice(guesses, starts):
            self.starts += 1
            rough = self._solve(grid, guess)
            if rough is not None and _is_promising(rough):
                yield rough
                continue
            if rough is not None:
                postponed.append(rough)
            if postponed and (self.starts % _RECONSIDER == 0 or self.starts == starts):
                best = min(postponed, key=rank)
                postponed.remove(best)
                yield best

    def _solve_between_points(self, grid: _Grid, start: Array) -> PathSolution | None:
        """Solve, and raise the margin at the points until the motion between them is clear too."""
        solution = None
        for _ in range(_MARGIN_ROUNDS):
            solution = self._solve(grid, start)
            if solution is None or not solution.feasible:
                break
            program, rollout = grid.program, solution.at_x.rollout
            clearance = certified_clearance(
                program.robot, rollout.q, rollout.v, program.step, program.spheres
            )
            if clearance >= 0.0:
                break
            missing = self._settings.clearance_margin / 2 - clearance
            margin = program.clearance_margin + missing
            grid = replace(grid, program=replace(program, clearance_margin=margin))
            start = solution.x
        return solution

    def _solve(self, grid: _Grid, start: Array) -> PathSolution | None:
        """Solve on a grid; None where the start meets a singularity."""
        level = grid.level
        try:
            solution = minimise(
                self._reporting(grid), start, level.iterations, level.optimality, level.progress
            )
        except NoPlanFound as refusal:
            self.refusals.append(refusal)
            return None
        self.solved.append(solution)
        return solution

    def _reporting(self, grid: _Grid) -> Callable[[Array], PathLinearisation]:
        """Return the linearisation on a grid, each of which is reported."""
        phase = REFINING if grid.level is self._grids[-1].level else SEARCHING

        def linearise(x: Array) -> PathLinearisation:
            at_x = grid.program.linearise(x)
            self._looks += 1
            self._report(self.progress(phase, at_x))
            return at_x

        return linearise


def _is_promising(rough: PathSolution) -> bool:
    """Tell whether more points may make a path of it."""
    if rough.feasible:
        return rough.optimality <= _PROMISING_OPTIMALITY
    return rough.at_x.violation <= _PROMISING_VIOLATION


def rank(solution: PathSolution) -> tuple[bool, float]:
    """Return a key to sort by: feasible before infeasible, then by objective or by violation."""
    at_x = solution.at_x
    return not solution.feasible, at_x.objective if solution.feasible else at_x.violation
