"""Where the solver starts, and on how many points: first on few, then on all."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import chain, islice
from typing import TypeAlias

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.motion.plan import SolverReport
from ff_planner_ros.planning.motion.watch import CHECKING, REFINING, SEARCHING, Progress, Watch
from ff_planner_ros.planning.optimisation.linearisation import FEASIBILITY_TOLERANCE
from ff_planner_ros.planning.optimisation.program import PathLinearisation, PathProgram
from ff_planner_ros.planning.optimisation.solver import (
    FIRST_RADIUS,
    Solution,
    minimise,
    nearest_feasible,
)
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.body_clearance import BodyClearance, SelfClearance
from ff_planner_ros.planning.requirements.clearance import Clearance
from ff_planner_ros.planning.requirements.goal import miss
from ff_planner_ros.robot.bodies import Geometry

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
    tolerated: float = 0.0  # violation that does not stop the solver's steps


# Few points find the way around the obstacles at a tenth of the price; the next grid brings the
# path so near its optimum that on all points a few iterations remain.
_COARSE_LEVELS = (_Level(13, 0.001, 1e-2, 2e-3, 40, 0.005), _Level(25, 0.0, 3e-3, 2e-4, 40, 0.0))
# On all points. So small a part of a joint path or of an angle makes no difference to a user.
_LEAST_PROGRESS = 2e-5
# Requirements whose margins are distances.
_OF_CLEARANCE = (Clearance.name, BodyClearance.name, SelfClearance.name)
# More points need not meet an obstacle that few points run into by less [m].
_PROMISING_VIOLATION = 5e-3
# A feasible path that is further from its optimum runs along a singularity.
_PROMISING_OPTIMALITY = 0.1
# Bodies have edges, and where one follows another the multipliers are off for long, however good
# the path is: of 60 problems 9 looked for others first, and 4 of them ended with a longer path.
_PROMISING_OPTIMALITY_OF_BODIES = 1.0
# On few points the solver gives up early: after this many guesses, go on from the best failure.
_RECONSIDER = 5
# Each round leaves a tenth or less of what is missing between the points.
_ROUNDS = 6
# Of what the check allows at the goal, the part that a motion may miss.
_MISS = 0.1

# Near what remains of a plan: it was optimal when it was made, and what it misses by now is small.
# Iterations, the part of the objective that another one must promise, the first trust region, and
# steps to the nearest path that keeps all.
_ITERATIONS_NEAR, _PROGRESS_NEAR, _RADIUS_NEAR, _MENDING_NEAR = 4, 1e-3, 0.1, 8
_NEAREST = "good enough: the nearest to what remains of the running plan that keeps the constraints"


@dataclass(frozen=True, eq=False)
class FoundPath:
    """A path that the solver found, and the effort of the search until then."""

    at_x: PathLinearisation  # its motion may be singular
    report: SolverReport  # counts are those of the whole search so far
    followed: FollowedMotion | None = None  # what comes of it; None: not worked out yet


@dataclass(frozen=True, eq=False)
class Grid:
    """The optimisation problem of one level."""

    level: _Level
    program: PathProgram
    # In which the solver steps, a column each; None: it changes one decision variable each
    directions: Array | None = None

    @property
    def first_radius(self) -> float:
        """First trust region; directions are as long as a bold step by themselves."""
        stride = self.program.family.stride if self.directions is None else 1.0
        return self.level.first_radius * stride

    def along(self, x: Array) -> Array:
        """Return how far a path is along each direction."""
        if self.directions is None:
            return x
        return np.asarray(np.linalg.solve(self.directions, x), np.float64)

    def linearise(self, along: Array) -> PathLinearisation:
        """Return objective and constraints of a path with their derivatives by the directions."""
        if self.directions is None:
            return self.program.linearise(along)
        return self.program.linearise(self.directions @ along).by(self.directions)


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
            found, followed = self._solve_between_points(self._grids[-1], solution.x)
            if found.at_x.is_defined:
                self._watch.report(self._progress(CHECKING, found.at_x))
                yield replace(self._found(found), followed=followed)
                self._on_all_points.append(found)

    def paths_near(self, guess: Array) -> Iterator[FoundPath]:
        """Yield paths on all points to which a guess leads in a few steps and that keep all.

        The first is the nearest that keeps all, the second is better by the objective. A joint
        path is as long however late it is run: an objective that were improved again and again on
        the way would put the motion off to the end.

        Raises:
            OutOfTime: By the watch.
        """
        self._starts += 1
        grid = near(corrected(self._grids[-1], guess), _ITERATIONS_NEAR, _RADIUS_NEAR)
        at_guess = self._looked_at(grid, guess)
        if not at_guess.is_defined:
            return
        eased = grid.program.easing(at_guess, _OF_CLEARANCE)
        if eased is not grid.program:
            grid = replace(grid, program=eased)
            at_guess = self._looked_at(grid, guess)
        for is_nearest in (True, False):
            solution = (
                self._nearest(grid, guess, at_guess)
                if is_nearest
                else self._mended_near(grid, self._solve(grid, guess, here=at_guess))
            )
            found, followed = self._kept_between_points(grid, solution)
            if found.feasible:
                self._watch.report(self._progress(CHECKING, found.at_x))
                if is_nearest:
                    found = replace(found, stop_reason=_NEAREST)
                yield replace(self._found(found), followed=followed)

    def _mended_near(self, grid: Grid, solution: PathSolution) -> PathSolution:
        """Return the nearest path that keeps all, where a few steps lead there."""
        if solution.feasible or not solution.at_x.is_defined:
            return solution
        return self._nearest(grid, solution.x, solution.at_x)

    def _nearest(self, grid: Grid, x: Array, at_x: PathLinearisation) -> PathSolution:
        watched, along = self._watched(grid), grid.along(x)
        return self._noted(nearest_feasible(watched, along, at_x, _MENDING_NEAR))

    def best(self) -> FoundPath | None:
        """Return the best path so far, with what the whole search took; None before the first.

        The motion of the path is singular only where all are.
        """
        attempts = self._on_all_points or self._solved
        return self._found(min(attempts, key=rank)) if attempts else None

    def _grid(self, level: _Level) -> Grid:
        margins = dict(self._program.margins)
        for name in _OF_CLEARANCE:
            margins[name] += level.extra_margin
        program = replace(
            self._program, points=level.points, margins=margins, damping=level.damping
        )
        return Grid(level, program)

    def _found(self, solution: PathSolution) -> FoundPath:
        report = SolverReport(
            starts=self._starts,
            iterations=sum(solved.iterations for solved in self._solved),
            rollouts=self._looks,
            optimality=solution.optimality,
            stop_reason=solution.stop_reason,
        )
        return FoundPath(solution.at_x, report)

    def _progress(self, phase: str, at_x: PathLinearisation) -> Progress:
        return Progress(phase, self._starts, self._looks, at_x.objective, at_x.violation)

    def _rough_paths(self) -> Iterator[PathSolution]:
        """Yield paths on few points that deserve to be solved on more points."""
        level, starts = self._grids[0].level, self._settings.starts
        problem = self._program.problem
        given = [] if self._first_guess is None else [self._first_guess]
        guesses = self._program.family.first_guesses(problem.obstacles, level.points, level.damping)
        postponed: list[PathSolution] = []
        for guess in islice(chain(given, guesses), starts):
            self._starts += 1
            rough = self._solve(self._grids[0], guess)
            if is_promising(rough, problem.robot.geometry):
                yield rough
                continue
            if rough.at_x.is_defined:
                postponed.append(rough)
            if postponed and (self._starts % _RECONSIDER == 0 or self._starts == starts):
                best = min(postponed, key=rank)
                postponed.remove(best)
                yield best

    def _solve_between_points(
        self, grid: Grid, start: Array
    ) -> tuple[PathSolution, FollowedMotion | None]:
        """Solve until the motion that a controller makes of the plan is sound at all times.

        Returns:
            The path, and what comes of it, where that is sound.
        """
        grid = corrected(grid, start)
        return self._kept_between_points(grid, self._solve(grid, start))

    def _kept_between_points(
        self, grid: Grid, solution: PathSolution
    ) -> tuple[PathSolution, FollowedMotion | None]:
        """Solve on from a solution until it is sound at all times; see `_solve_between_points`."""
        program = grid.program
        for _ in range(_ROUNDS):
            if not solution.feasible:
                break
            motion = program.followed(solution.at_x)
            slacks = program.slacks(motion)
            is_sound = min(slacks.values()) >= 0.0
            if is_sound and self._is_at_goal(motion):
                return solution, motion
            # Beside what is missing, half the margin that the search began with.
            margins = {
                name: margin + (self._program.margins[name] / 2 - slacks[name])
                if slacks[name] < 0.0 and name not in program.waiting
                else margin
                for name, margin in program.margins.items()
            }
            broken = frozenset(name for name, slack in slacks.items() if slack < 0.0)
            if broken and broken <= program.waiting:
                # If that turns out to be impossible, this path says best what stands in the way.
                self._on_all_points.append(solution)
            self._keep(broken)
            program = program.corrected(solution.at_x.motion, motion).keeping(broken)
            program = replace(program, margins=margins)
            if is_sound:  # a better aim is all that is missing, and no reason to optimise again
                aimed = program.linearise(solution.x)
                if aimed.violation <= FEASIBILITY_TOLERANCE:
                    solution = replace(solution, at_x=aimed)
                    continue
            solution = self._solve_again(replace(grid, program=program), solution.x)
        return solution, None

    def _keep(self, broken: frozenset[str]) -> None:
        """Keep what a path has broken on all grids from now on."""
        self._program = self._program.keeping(broken)
        self._grids = [replace(grid, program=grid.program.keeping(broken)) for grid in self._grids]

    def _is_at_goal(self, motion: FollowedMotion) -> bool:
        problem, settings = self._program.problem, self._settings
        position, turn = np.linalg.norm(miss(problem.robot, motion.q[-1], problem.target), axis=1)
        return bool(
            position <= _MISS * settings.position_tolerance
            and turn <= _MISS * settings.orientation_tolerance
        )

    def _solve_again(self, grid: Grid, start: Array) -> PathSolution:
        """Mend a path that hardly misses what the grid's program demands."""
        at_start = self._looked_at(grid, start)
        if not at_start.is_defined:
            return self._solve(grid, start, here=at_start)
        return self._nearest(grid, start, at_start)

    def _solve(
        self,
        grid: Grid,
        start: Array,
        curvature: Array | None = None,
        here: PathLinearisation | None = None,
    ) -> PathSolution:
        level = grid.level
        solution = minimise(
            self._watched(grid),
            grid.along(start),
            level.iterations,
            level.optimality,
            level.progress,
            grid.first_radius,
            curvature,
            level.tolerated,
            here,
        )
        return self._noted(solution)

    def _noted(self, solution: PathSolution) -> PathSolution:
        """Return a solution in terms of the decision variables, and keep it."""
        solution = replace(solution, x=solution.at_x.motion.x)
        self._solved.append(solution)
        return solution

    def _looked_at(self, grid: Grid, x: Array) -> PathLinearisation:
        return self._watched(grid)(grid.along(x))

    def _watched(self, grid: Grid) -> Callable[[Array], PathLinearisation]:
        """Return what linearises a path of the grid's program while the watch looks on."""
        phase = REFINING if grid.level is self._grids[-1].level else SEARCHING

        def linearise(along: Array) -> PathLinearisation:
            self._watch.require_time()
            at_x = grid.linearise(along)
            if at_x.is_defined:
                self._looks += 1
                self._watch.report(self._progress(phase, at_x))
            return at_x

        return linearise


def corrected(grid: Grid, x: Array) -> Grid:
    """Return a grid whose program knows what a controller makes of a path, if points are left out.

    Where the plan holds every point of the grid, that hardly differs from the path.
    """
    program = grid.program
    if program.points > program.problem.points:
        at_x = program.linearise(x)
        if at_x.is_defined:
            program = program.corrected(at_x.motion, program.followed(at_x))
    return replace(grid, program=program)


def near(grid: Grid, iterations: int, first_radius: float) -> Grid:
    """Return a grid that is solved in a few steps, from near an optimum."""
    level = replace(
        grid.level, iterations=iterations, progress=_PROGRESS_NEAR, first_radius=first_radius
    )
    return replace(grid, level=level)


def is_promising(rough: PathSolution, geometry: Geometry) -> bool:
    """Tell whether more points may make a path of it."""
    if rough.feasible:
        has_edges = geometry is Geometry.SHAPES
        most = _PROMISING_OPTIMALITY_OF_BODIES if has_edges else _PROMISING_OPTIMALITY
        return rough.optimality <= most
    return rough.at_x.violation <= _PROMISING_VIOLATION


def rank(solution: PathSolution) -> tuple[bool, float]:
    """Return a key to sort by: feasible before infeasible, then by objective or by violation."""
    at_x = solution.at_x
    return not solution.feasible, at_x.objective if solution.feasible else at_x.violation
