"""Where the solver starts, and on how many points: first on few, then on all."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain, islice
from typing import TypeAlias

from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.plan import SolverReport
from ff_planner_ros.planning.program import PathLinearisation, PathProgram
from ff_planner_ros.planning.requirements.clearance import Clearance
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.planning.solver import FIRST_RADIUS, Solution, minimise
from ff_planner_ros.planning.watch import CHECKING, REFINING, SEARCHING, Progress, Watch

PathSolution: TypeAlias = Solution[PathLinearisation]


@dataclass(frozen=True)
class _Level:
    """A time grid to solve on, and how well."""

    points: int
    extra_margin: float  # of clearance [m]: the gaps between fewer points are wider
    optimality: float
    progress: float
    iterations: int
    damping: float  # where a singularity in the way shall not stop the search
    first_radius: float = FIRST_RADIUS  # of the solver's trust region


# Few points find the way around the obstacles at a tenth of the price; the next grid brings the
# path so near its optimum that on all points a few iterations remain.
_COARSE_LEVELS = (_Level(13, 0.001, 1e-2, 2e-3, 40, 0.005), _Level(25, 0.0, 3e-3, 2e-4, 40, 0.0))
# On all points. So small a part of a joint path or of an angle makes no difference to a user.
_LEAST_PROGRESS = 2e-5
# More points need not meet an obstacle that few points run into by less [m].
_PROMISING_VIOLATION = 5e-3
# A feasible path that is further from its optimum runs along a singularity.
_PROMISING_OPTIMALITY = 0.1
# On few points the solver gives up early: after this many guesses, go on from the best failure.
_RECONSIDER = 5
# Each round roughly halves what is missing between the points.
_MARGIN_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class FoundPath:
    """A path that the solver found, and the effort of the search until then."""

    at_x: PathLinearisation  # its motion may be singular
    report: SolverReport  # counts are those of the whole search so far


@dataclass(frozen=True, eq=False)
class _Grid:
    """The optimisation problem of one level."""

    level: _Level
    program: PathProgram


class Search:
    """Looks for paths from one first guess after the other."""

    def __init__(
        self,
        program: PathProgram,
        settings: PlannerSettings,
        watch: Watch,
        first_guess: Array | None,
    ) -> None:
        """Prepare to search from a program on all points; a first guess is tried before others."""
        self._program, self._settings, self._watch = program, settings, watch
        self._first_guess = first_guess
        all_points = _Level(
            program.points,
            0.0,
            settings.optimality_tolerance,
            _LEAST_PROGRESS,
            settings.max_iterations,
            0.0,
        )
        coarse = [level for level in _COARSE_LEVELS if level.points < program.points]
        self._grids = [self._grid(level) for level in (*coarse, all_points)]
        self._starts = self._looks = 0
        self._solved: list[PathSolution] = []
        self._on_all_points: list[PathSolution] = []

    def paths(self) -> Iterator[FoundPath]:
        """Yield paths on all points; some violate a requirement.

        Raises:
            OutOfTime: By the watch.
        """
        for rough in self._rough_paths():
            solution = rough
            for grid in self._grids[1:-1]:
                finer = self._solve(grid, solution.x)
                solution = finer if finer.at_x.is_defined else solution
            found = self._solve_between_points(self._grids[-1], solution.x)
            if found.at_x.is_defined:
                self._watch.report(self._progress(CHECKING, found.at_x))
                yield self._found(found)
                self._on_all_points.append(found)

    def best(self) -> FoundPath | None:
        """Return the best path so far, with what the whole search took; None before the first.

        The motion of the path is singular only where all are.
        """
        attempts = self._on_all_points or self._solved
        return self._found(min(attempts, key=rank)) if attempts else None

    def _grid(self, level: _Level) -> _Grid:
        margins = dict(self._program.margins)
        margins[Clearance.name] += level.extra_margin
        program = replace(
            self._program, points=level.points, margins=margins, damping=level.damping
        )
        return _Grid(level, program)

    def _found(self, solution: PathSolution) -> FoundPath:
        report = SolverReport(
            starts=self._starts,
            iterations=sum(solved.iterations for solved in self._solved),
            rollouts=sum(solved.evaluations for solved in self._solved),
            optimality=solution.optimality,
            stop_reason=solution.stop_reason,
        )
        return FoundPath(solution.at_x, report)

    def _progress(self, phase: str, at_x: PathLinearisation) -> Progress:
        return Progress(phase, self._starts, self._looks, at_x.objective, at_x.violation)

    def _rough_paths(self) -> Iterator[PathSolution]:
        """Yield paths on few points that deserve to be solved on more points."""
        grid, starts = self._grids[0], self._settings.starts
        problem, level = self._program.problem, grid.level
        given = [] if self._first_guess is None else [self._first_guess]
        guesses = self._program.family.first_guesses(problem.obstacles, level.points, level.damping)
        postponed: list[PathSolution] = []
        for guess in islice(chain(given, guesses), starts):
            self._starts += 1
            rough = self._solve(grid, guess)
            if _is_promising(rough):
                yield rough
                continue
            if rough.at_x.is_defined:
                postponed.append(rough)
            if postponed and (self._starts % _RECONSIDER == 0 or self._starts == starts):
                best = min(postponed, key=rank)
                postponed.remove(best)
                yield best

    def _solve_between_points(self, grid: _Grid, start: Array) -> PathSolution:
        """Solve, and raise the margins at the points until the motion between them is sound too."""
        return self._kept_between_points(grid, self._solve(grid, start))

    def _kept_between_points(self, grid: _Grid, solution: PathSolution) -> PathSolution:
        for _ in range(_MARGIN_ROUNDS - 1):
            if not solution.feasible:
                break
            program = grid.program
            slacks = program.slacks_between(solution.at_x.motion)
            if all(slack >= 0.0 for slack in slacks.values()):
                break
            # Beside what is missing, half the margin that the search began with.
            margins = {
                name: margin + (self._program.margins[name] / 2 - slacks[name])
                if slacks[name] < 0.0
                else margin
                for name, margin in program.margins.items()
            }
            grid = replace(grid, program=replace(program, margins=margins))
            solution = self._solve(grid, solution.x)
        return solution

    def _solve(self, grid: _Grid, start: Array, curvature: Array | None = None) -> PathSolution:
        level = grid.level
        phase = REFINING if level is self._grids[-1].level else SEARCHING

        def linearise(x: Array) -> PathLinearisation:
            self._watch.require_time()
            at_x = grid.program.linearise(x)
            if at_x.is_defined:
                self._looks += 1
                self._watch.report(self._progress(phase, at_x))
            return at_x

        solution = minimise(
            linearise,
            start,
            level.iterations,
            level.optimality,
            level.progress,
            level.first_radius,
            curvature,
        )
        self._solved.append(solution)
        return solution


def _is_promising(rough: PathSolution) -> bool:
    """Tell whether more points may make a path of it."""
    if rough.feasible:
        return rough.optimality <= _PROMISING_OPTIMALITY
    return rough.at_x.violation <= _PROMISING_VIOLATION


def rank(solution: PathSolution) -> tuple[bool, float]:
    """Return a key to sort by: feasible before infeasible, then by objective or by violation."""
    at_x = solution.at_x
    return not solution.feasible, at_x.objective if solution.feasible else at_x.violation
