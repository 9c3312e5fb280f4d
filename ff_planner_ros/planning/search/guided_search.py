"""Search from initial guesses that are near a plan.

One of another problem's paths, or the remainder of a running plan; and guesses along a path to
follow, whose corridor leaves few detours: each is optimised on all points, first for a smooth norm
of the Euler angles, then for the largest.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import islice
from typing import cast

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import OutOfTime
from ff_planner_ros.planning.motion.motion import joint_path_length, straight_way
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import CHECKING, SEARCHING, PassingOn, Watch
from ff_planner_ros.planning.optimisation.evaluated_path import PathLinearisation
from ff_planner_ros.planning.optimisation.objectives import weighted_sum
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.optimisation.solver import Stop
from ff_planner_ros.planning.paths.joint_spline import JointSplines
from ff_planner_ros.planning.paths.path_family import PathFamily
from ff_planner_ros.planning.problem.problem import Parametrisation, PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings, SearchDepth
from ff_planner_ros.planning.search.candidate import Effort
from ff_planner_ros.planning.search.grid import CLEARANCES, Grid
from ff_planner_ros.planning.search.grid_solver import GridSolver, PathSolution
from ff_planner_ros.planning.search.multi_start import is_promising

# Near a guess: the fraction of the objective that another step must predict, the first trust
# region, and steps of restoration.
_PROGRESS, _RADIUS, _RESTORATION_ITERATIONS = 1e-3, 0.1, 8
# Iterations on the coarsest grid, where most guesses that lead to an optimum take eight; then on
# all points; and near a remainder, which was optimal when its plan was made.
_COARSE_ITERATIONS, _FINE_ITERATIONS, _ITERATIONS_NEAR_REMAINDER = 15, 2, 4
# A path may be a detour if it is longer than so many times the straight line of its joints, and
# than so many times the family's own first guess.
_DIRECT, _LONG = 1.2, 1.5
_ENOUGH = "good enough: at its optimum on few points, and two steps further on all of them"
_NEAREST = "good enough: the feasible path nearest to the remainder of the running plan"
# A guess that leads to a plan takes 6 to 70 evaluations of a path; three to four times as many if
# the duration is free, too.
_LOOKS, _LOOKS_WITH_DURATION = 120, 480

# Guesses by depth of the search.
_GUESSES = {SearchDepth.QUICK: 1, SearchDepth.NORMAL: 3, SearchDepth.THOROUGH: 8}
# p of the norms of the Euler angles, and the iterations with each.
_NORMS = ((2.0, 25), (8.0, 25), (np.inf, 60))
# Violations [m, rad] that do not stop the solver's steps; its first trust region; its optimality
# and progress.
_TOLERATED, _RADIUS_ALONG, _OPTIMALITY, _PROGRESS_ALONG = 2e-3, 0.25, 1e-5, 1e-4
# Then, on all points: iterations, likewise where constraints are tightened, and trust region.
_LAST, _TIGHTENING, _NEAR = 30, 6, 0.1
# Weight of the joint path where it has none, relative to the attitude's: a chaser that turns by a
# hundredth of a degree counts more than the joints that prevent it.
_TIE_BREAK = 1e-5


class Allowance(PassingOn):
    """A watch that limits the evaluations of a guess, to leave time for other guesses.

    They are counted, not timed: whether a guess is given up must not depend on the clock.
    """

    def __init__(self, watch: Watch, has_range: bool) -> None:
        """Limit a search by counts; other calls go to its watch."""
        super().__init__(watch)
        self._left = _LOOKS_WITH_DURATION if has_range else _LOOKS

    @property
    def used_up(self) -> bool:
        """Whether the count ended the search, rather than the watch."""
        return self._left < 0

    def require_time(self, phase: str = SEARCHING, /) -> None:
        """Count an evaluation; raises OutOfTime after the last."""
        self._watch.require_time(phase)
        self._count(int(phase != CHECKING))

    def passed(self, steps: int, end: OutOfTime | None = None) -> None:
        """Count the evaluations of a part that ran beside others, likewise."""
        self._watch.passed(steps, end)
        self._count(steps)

    def _count(self, evaluations: int) -> None:
        self._left -= evaluations
        if self.used_up:
            raise OutOfTime("the initial guess has used up its evaluations")


def plan_from(solver: GridSolver, guess: Array) -> Plan | None:
    """Return the plan to which a guess leads, if that is an optimum and passes the check.

    On the coarsest grid the path is optimised to the end: one that is only mended around the
    obstacles would stay as long as it is. If it is long, the family's own first guess is optimised,
    too, and the better of both is taken.

    Raises:
        OutOfTime: By the watch.
    """
    coarse = _coarse_optimum(solver, guess)
    if coarse is None:
        return None
    grid = _near(solver.grids[-1].with_correction(coarse.x), _FINE_ITERATIONS)
    solution = solver.restore(grid, solver.solve(grid, coarse.x), _RESTORATION_ITERATIONS)
    found, followed = solver.tighten(grid, solution, solver.solve_and_restore)
    if found.feasible and not found.converged:
        found = replace(found, stop=Stop.ENOUGH, stop_reason=_ENOUGH)
    return next(solver.sound_plans(found, followed), None)


def plans_near(solver: GridSolver, guess: Array) -> Iterator[Plan]:
    """Yield plans that pass the check and to which a guess leads in a few steps.

    The first is the nearest feasible one, the second is better by the objective. Joint path length
    does not depend on timing: optimising it at every replan would postpone the motion to the end.

    Raises:
        OutOfTime: By the watch.
    """
    solver.effort.starts += 1
    grid = _near(solver.grids[-1].with_correction(guess), _ITERATIONS_NEAR_REMAINDER)
    at_guess = solver.evaluate(grid, guess)
    if not at_guess.is_defined:
        return
    eased = grid.program.with_eased_margins(at_guess, CLEARANCES)
    if eased is not grid.program:
        grid = replace(grid, program=eased)
        at_guess = solver.evaluate(grid, guess)
    nearest = solver.nearest(grid, guess, at_guess, _RESTORATION_ITERATIONS)
    found, followed = solver.tighten(grid, nearest, partial(_restoration, solver))
    if found.feasible:
        found = replace(found, stop=Stop.ENOUGH, stop_reason=_NEAREST)
        yield from solver.sound_plans(found, followed)
    solution = solver.solve(grid, guess, at_start=at_guess)
    better = solver.restore(grid, solution, _RESTORATION_ITERATIONS)
    found, followed = solver.tighten(grid, better, partial(_restoration, solver))
    if found.feasible:
        yield from solver.sound_plans(found, followed)


def _restoration(solver: GridSolver, grid: Grid, start: Array) -> PathSolution:
    """Return the nearest path to a start that is feasible for the grid's program."""
    at_start = solver.evaluate(grid, start)
    if not at_start.is_defined:
        return solver.solve(grid, start, at_start=at_start)
    return solver.nearest(grid, start, at_start, _RESTORATION_ITERATIONS)


def _much_shorter(solver: GridSolver, at_x: PathLinearisation) -> Array | None:
    """Return the family's own first guess, if a path may be a detour beside it; None: it is not."""
    length = at_x.objective / solver.program.objective.joint_path_length
    robot = solver.problem.robot
    if length <= _DIRECT * straight_way(at_x.motion.q[[0, -1], 7:], robot.joint_weights):
        return None
    stage, guess = solver.grids[0].stage, next(solver.initial_guesses())
    own = solver.program.family.motion(guess, stage.points, stage.damping)
    if own.singular_at is not None:
        return None
    step = solver.problem.duration / (stage.points - 1)
    is_long = length > _LONG * joint_path_length(own.v[:, 6:], step, robot.joint_weights)
    return guess if is_long else None


def _coarse_optimum(solver: GridSolver, guess: Array) -> PathSolution | None:
    """Return the optimum of a guess or, if that is long, the better of it and the family's own."""
    solver.effort.starts += 1
    coarse, problem = solver.grids[0], solver.problem
    at_guess = solver.evaluate(coarse, guess)
    grid = _near(coarse, _COARSE_ITERATIONS)
    if at_guess.equalities.size:  # the first step must have room to get to the goal
        grid = grid.with_stage(radius=coarse.stage.radius)
    found = solver.solve(grid, guess, at_start=at_guess)
    if not is_promising(found, problem):
        return None
    own = _much_shorter(solver, found.at_x)
    if own is None:
        return found
    solver.effort.starts += 1
    other = solver.solve(coarse, own)
    is_better = other.at_x.objective < found.at_x.objective
    return other if is_better and is_promising(other, problem) else found


def _near(grid: Grid, iterations: int) -> Grid:
    """Return a grid that is solved in a few steps, from near an optimum."""
    return grid.with_stage(iterations=iterations, progress=_PROGRESS, radius=_RADIUS)


def plan_along(
    problem: PlanningProblem,
    settings: PlannerSettings,
    family: PathFamily,
    watch: Watch,
    first_guess: Array | None,
) -> Plan | None:
    """Return the best plan along a problem's path by an objective that weighs the attitude.

    None: no guess leads to a plan, or there is no path or no such weight. Guesses are optimised on
    half of the family's spans, where a step takes an eighth of the time; the best plan of these,
    and a given guess, on all of them.

    Raises:
        OutOfTime: By the watch.
    """
    asked = problem.objective
    if problem.path is None or asked.chaser_attitude == 0.0:
        return None
    problem = replace(problem, parametrisation=Parametrisation(family.name))
    least = _TIE_BREAK * asked.chaser_attitude
    weights = replace(asked, joint_path_length=max(asked.joint_path_length, least))
    coarse, effort = cast(JointSplines, family).halved, Effort()
    on_half, on_all = (
        GridSolver(
            replace(path_program(problem, each, settings), objective=weights),
            settings,
            watch,
            effort,
        )
        for each in (coarse, family)
    )
    plans = list[Plan]()
    if first_guess is not None and len(first_guess) == family.variables:
        plans += _plans_from(on_all, first_guess)
    for number, guess in enumerate(islice(on_half.initial_guesses(), _GUESSES[settings.search])):
        # Near the first guess, too: soon something to answer with if the time is short.
        for norms in ((), _NORMS)[number > 0 :]:
            for plan in _plans_from(on_half, guess, norms):
                lifted = family.near(coarse.motion(plan.coefficients, family.variables).q)
                plans.append(replace(plan, coefficients=lifted))
    if not plans:
        return None

    def cost(plan: Plan) -> float:
        return weighted_sum(asked, plan.metrics)

    best = min(plans, key=cost)
    best = min([best, *_plans_from(on_all, best.coefficients)], key=cost)
    return replace(best, solver=effort.report(best.solver))


def _plans_from(
    solver: GridSolver, x: Array, norms: tuple[tuple[float, int], ...] = _NORMS
) -> Iterator[Plan]:
    """Yield the plan to which a path leads, if it passes the check."""
    solver.effort.starts += 1
    grid = solver.grids[-1]
    for norm, iterations in norms:
        found = solver.solve(_stage(grid, norm, iterations), x)
        if found.at_x.is_defined:
            x = found.x
    near = grid.with_correction(x).with_stage(
        iterations=_LAST, tolerated=_TOLERATED, radius=_NEAR, progress=_PROGRESS_ALONG
    )
    found = solver.solve_feasibly(near, x, None)
    last = near.with_stage(iterations=_TIGHTENING)
    yield from solver.sound_plans(*solver.tighten(last, found, solver.solve_and_restore))


def _stage(grid: Grid, norm: float, iterations: int) -> Grid:
    """Return a grid with a p-norm in place of the largest Euler angle."""
    smooth = replace(grid, program=replace(grid.program, attitude_norm=norm))
    return smooth.with_stage(
        iterations=iterations,
        tolerated=_TOLERATED,
        radius=_RADIUS_ALONG,
        progress=_PROGRESS_ALONG,
        optimality=_OPTIMALITY,
    )
