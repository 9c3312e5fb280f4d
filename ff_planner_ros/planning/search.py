"""Where the solver starts, and which of its answers is kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

from ff_planner_ros.arrays import Array
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.planning.check import certified_clearance
from ff_planner_ros.planning.detours import first_guesses
from ff_planner_ros.planning.program import PathLinearisation, PathProgram
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.planning.solver import Solution, minimise

PathSolution: TypeAlias = Solution[PathLinearisation]


@dataclass(frozen=True)
class _Level:
    """A time grid to solve on, and how well."""

    points: int
    extra_margin: float  # [m] for the gaps between the points, which are wider on fewer points
    optimality: float
    iterations: int
    damping: float  # where a singularity in the way shall not stop the search


# Few points find the way around the obstacles at a tenth of the price; the next grid brings the
# path so near its optimum that on all points a few iterations remain.
_COARSE_LEVELS = (_Level(13, 0.001, 1e-2, 40, 0.005), _Level(25, 0.0, 1e-3, 40, 0.0))
# More points need not meet an obstacle that few points run into by less [m].
_PROMISING_VIOLATION = 5e-3
# A feasible path that is further from its optimum runs along a singularity.
_PROMISING_OPTIMALITY = 0.1
# The solver gives up early on few points: after so many guesses, go on from the best that failed.
_RECONSIDER = 5
# Each round roughly halves what is missing between the points.
_MARGIN_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class Search:
    """The best path found and what it took.

    Attributes:
        best: On all points.
        starts: First guesses tried.
        iterations: Quadratic programs solved, over all of them.
        evaluations: Rollouts with derivatives, over all of them.
    """

    best: PathSolution
    starts: int
    iterations: int
    evaluations: int


def search(
    program: Callable[[int, float, float], PathProgram], points: int, settings: PlannerSettings
) -> Search:
    """Solve from one first guess after the other, from few points to all, until a path is found.

    Args:
        program: Gives the optimisation problem for a number of points, a clearance margin [m] and
            a damping of the velocity map.
        points: Of the plan.
        settings: The planner's tunables.

    Raises:
        NoPlanFound: Every guess meets a dynamic singularity.
    """
    all_points = _Level(points, 0.0, settings.optimality_tolerance, settings.max_iterations, 0.0)
    levels = [*(level for level in _COARSE_LEVELS if level.points < points), all_points]
    grids = [
        _Grid(
            level,
            program(level.points, settings.clearance_margin + level.extra_margin, level.damping),
        )
        for level in levels
    ]
    work = _Work([], [])
    answers: list[PathSolution] = []
    postponed: list[PathSolution] = []
    tried = 0
    for guess in first_guesses(grids[0].program, settings.starts):
        tried += 1
        rough = work.solve(grids[0], guess)
        if rough is not None and not _is_promising(rough):
            postponed.append(rough)
            rough = None
        if rough is None and postponed and tried % _RECONSIDER == 0:
            rough = min(postponed, key=_rank)
            postponed.remove(rough)
        if rough is not None:
            answers += _refine(work, grids, rough, settings)
        if answers and answers[-1].feasible:
            break
    if not answers and postponed:
        answers += _refine(work, grids, min(postponed, key=_rank), settings)
    if not answers:
        raise work.refusals[0]
    return Search(
        best=min(answers, key=_rank),
        starts=tried,
        iterations=sum(solution.iterations for solution in work.solved),
        evaluations=sum(solution.evaluations for solution in work.solved),
    )


@dataclass(frozen=True, eq=False)
class _Grid:
    """The optimisation problem of one level."""

    level: _Level
    program: PathProgram


@dataclass(frozen=True, eq=False)
class _Work:
    """What has been solved, and where the way was singular."""

    solved: list[PathSolution]
    refusals: list[NoPlanFound]

    def solve(self, grid: _Grid, start: Array) -> PathSolution | None:
        """Solve on a grid; None where the start meets a singularity."""
        level = grid.level
        try:
            solution = minimise(grid.program.linearise, start, level.iterations, level.optimality)
        except NoPlanFound as refusal:
            self.refusals.append(refusal)
            return None
        self.solved.append(solution)
        return solution


def _is_promising(rough: PathSolution) -> bool:
    """Tell whether more points may make a path of it."""
    if rough.feasible:
        return rough.optimality <= _PROMISING_OPTIMALITY
    return rough.at_x.violation <= _PROMISING_VIOLATION


def _rank(solution: PathSolution) -> tuple[bool, float]:
    """Feasible before infeasible, then by objective or by violation."""
    at_x = solution.at_x
    return not solution.feasible, at_x.objective if solution.feasible else at_x.violation


def _refine(
    work: _Work, grids: list[_Grid], rough: PathSolution, settings: PlannerSettings
) -> list[PathSolution]:
    """Go on from the first grid to the last; return the answer there, or nothing."""
    solution = rough
    for grid in grids[1:-1]:
        solution = work.solve(grid, solution.x) or solution
    answer = _solve_between_points(work, grids[-1], solution.x, settings)
    return [] if answer is None else [answer]


def _solve_between_points(
    work: _Work, grid: _Grid, start: Array, settings: PlannerSettings
) -> PathSolution | None:
    """Solve, and raise the margin at the points until the motion between them is clear too."""
    solution = None
    for _ in range(_MARGIN_ROUNDS):
        solution = work.solve(grid, start)
        if solution is None or not solution.feasible:
            break
        program = grid.program
        rollout = solution.at_x.rollout
        clearance = certified_clearance(
            program.robot, rollout.q, rollout.v, program.step, program.spheres
        )
        if clearance >= 0.0:
            break
        missing = settings.clearance_margin / 2 - clearance
        margin = program.clearance_margin + missing
        grid = replace(grid, program=replace(program, clearance_margin=margin))
        start = solution.x
    return solution
