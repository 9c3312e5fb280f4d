"""From a plan of least joint path to one that weighs the chaser's attitude, too.

The attitude has many local optima, the joint path few. So the plan of least joint path and other
first guesses run a race, and from the best of them the search hops to better ones. Most of it is
done on few points, where it is cheap. Nothing is answered that is worse than the plan of least
joint path in the objective asked for, as the plans' metrics measure it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import cycle, islice
from typing import Any

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import CHECKING
from ff_planner_ros.planning.optimisation.linearisation import FEASIBILITY_TOLERANCE
from ff_planner_ros.planning.optimisation.objectives import weighted_sum, with_tie_break
from ff_planner_ros.planning.optimisation.program import PathLinearisation, PathProgram
from ff_planner_ros.planning.optimisation.solver import nearest_feasible
from ff_planner_ros.planning.problem.problem import Objective
from ff_planner_ros.planning.requirements.singular_values import SingularValues
from ff_planner_ros.planning.search.search import FoundPath, Grid, PathSolution, Search, corrected

# Returns the plan along a path, or None where it does not pass the check.
Judge = Callable[[FoundPath], Plan | None]

# Rungs of the ladder: weights of the attitude, where the joint path's is one. Each about three
# times the last; below the first the joint path alone decides.
_RUNGS = (6.0, 15.0, 45.0)
# The race on few points: guesses, the first the plan of least joint path, and iterations for each;
# then how many go on and for how many more, and how many go on to an optimum. Most guesses show
# early that they lead nowhere; some that are slow to begin with lead far.
_GUESSES, _FIRST_HEAT, _SECOND_HEAT, _FINALISTS, _LAST_HEAT = 24, 14, (8, 8), 3, 24
# Hops of a round from the best path on few points: at random along each direction, by two standard
# deviations in turn. Where one comes so near to the best it is worth more iterations.
_HOPS, _SPREADS, _NEARLY = 10, (0.1, 0.2), 1.3
# Rounds of hops that leave more than this part of the best path's worth lead nowhere: after so many
# in a row the next round is a race of other guesses.
_GAIN, _IN_VAIN = 0.98, 2
# So many paths of a round at most are refined on more points.
_REFINED = 2
# Iterations on more points: they begin near the optimum.
_FINE_ITERATIONS = 12
# First trust regions, far from an optimum and near one. The path is moved in all of its own ways
# at once: half as bold as along single coefficients.
_FAR, _NEAR = 0.25, 0.1
# Violations that do not stop the solver's steps, on few points and on more; the nearest path that
# keeps all constraints is so few steps away from a smaller one [unit of the constraint].
_TOLERATED, _FINE_TOLERATED = 2e-2, 5e-3
_SMALL_VIOLATION, _MENDING_ITERATIONS = 3e-2, 6
# Singular values stay so many times above their threshold: they may fall between the points.
_AWAY = 1.2
# Of the best plan's objective: a path on few points that is above it is not refined.
_PROMISING = 1.02
# Parts of what the plan of least joint path is worth. Where the attitude is less than the first, no
# other guesses are tried; up to the other they are, only if a look at so many of them, so many
# iterations far, shows one that gains: the optimum nearest to that plan nearly always is the best.
_NEGLIGIBLE, _MINOR, _LOOKED_AT, _LOOK = 2e-4, 0.3, 5, 6
# A joint path or an angle known to this part is known well enough to compare two.
_ROUGH_OPTIMALITY, _ROUGH_PROGRESS, _FINE_PROGRESS = 1e-5, 1e-4, 2e-4

NO_BETTER = "good enough: no better attitude was found than that of the least joint path"


class AttitudeSearch(Search):
    """Looks for a path of least joint path, and from there for a better attitude."""

    def improved(self, asked: Objective, shortest: Plan, judge: Judge) -> Plan:
        """Return the best plan found, at worst the plan of least joint path.

        More rounds never give a worse plan: each begins where the one before it ended. Without any
        the search goes from the plan of least joint path to the nearest optimum, at a tenth of the
        price; so it does where the attitude is but a minor part and nothing better is in sight.

        Raises:
            OutOfTime: By the watch.
        """
        objective = with_tie_break(asked, self._settings)
        best = self.better_at_guess(asked, shortest, judge)
        guesses, found, tried = self._guesses(shortest), list[_Rough](), list[_Rough]()
        in_vain = 0
        rounds = self._rounds(asked, shortest)
        for number, count in enumerate(rounds):
            is_after_nearest = number == 1 and rounds[0] == 1 and best is not shortest
            if is_after_nearest and not self._more_in_sight(asked, shortest, found):
                break
            if found and in_vain < _IN_VAIN:
                reached = min(map(_worth, found))
                self._hop(asked, found, number)
                gains = min(map(_worth, found)) < _GAIN * reached
                in_vain = 0 if gains else in_vain + 1
            else:
                found += self._raced(asked, list(islice(guesses, count)))
                in_vain = 0 if count > 1 else _IN_VAIN
            for rough in sorted(found, key=_worth)[:_REFINED]:
                limit = np.inf if best is shortest else weighted_sum(asked, best.metrics)
                if rough in tried or rough.worth > _PROMISING * limit:
                    continue
                tried.append(rough)
                refined = self._path_near(objective, rough.path.x, rough.path.curvature)
                plans = [judge(path) for path in refined]
                best = _better(asked, best, *plans)
                if not any(plans):  # nor is anything gained near it
                    found.remove(rough)
            if number == 0 and best is shortest:
                best = self._climbed(asked, shortest, judge)
        if best is shortest:
            _, at_best = self._path_at(objective, best.coefficients)
            optimality, reason = at_best.optimality, NO_BETTER
        else:
            optimality, reason = best.solver.optimality, best.solver.stop_reason
        effort = self._found(self._solved[-1]).report
        return replace(best, solver=replace(effort, optimality=optimality, stop_reason=reason))

    def _rounds(self, asked: Objective, shortest: Plan) -> list[int]:
        """Return the number of first guesses of each round's race, if there is one."""
        races = [_GUESSES] * self._settings.attitude_rounds
        attitude = asked.chaser_attitude * shortest.metrics.max_chaser_euler
        worth = weighted_sum(asked, shortest.metrics)
        if not races or attitude <= _NEGLIGIBLE * worth:
            return [1]
        return [1, *races] if attitude <= _MINOR * worth else races

    def _more_in_sight(self, asked: Objective, shortest: Plan, found: Sequence[_Rough]) -> bool:
        """Tell whether a look at other first guesses shows a better one than what is found."""
        if not found:
            return True
        grid = _with(self._rough_grid(asked), iterations=_LOOK)
        enough = _GAIN * min(found, key=_worth).path.at_x.objective
        for other in islice(self._guesses(shortest), 1, 1 + _LOOKED_AT):
            self._starts += 1
            is_far_off, value = _lead(self._solve(grid, other))
            if not is_far_off and value < enough:
                return True
        return False

    def better_at_guess(self, asked: Objective, shortest: Plan, judge: Judge) -> Plan:
        """Return the best plan at the first guess, at worst the plan of least joint path.

        Raises:
            OutOfTime: By the watch.
        """
        paths = self._paths_at_guess(with_tie_break(asked, self._settings))
        return _better(asked, shortest, *(judge(path) for path in paths))

    def _paths_at_guess(self, objective: Objective) -> Iterator[FoundPath]:
        """Yield the path of the first guess, as it is and improved: it may be worth more."""
        if self._first_guess is None:
            return
        as_it_is = self._kept_between_points(*self._path_at(objective, self._first_guess))
        yield from self._checkable(*as_it_is)
        yield from self._path_near(objective, self._first_guess, None)

    def _climbed(self, asked: Objective, shortest: Plan, judge: Judge) -> Plan:
        """Raise the weight of the attitude on all points, as long as the plans pass the check.

        Near the least attitude there may be no plan, because of a singularity or a limit that the
        search does not keep. Below it there often is one.
        """
        best = shortest
        for lower in _lower_rungs(asked):
            judged = [judge(path) for path in self._path_near(lower, best.coefficients, None)]
            better = _better(asked, best, *judged)
            if better is best:
                break
            best = better
        return best

    def _guesses(self, shortest: Plan) -> Iterator[Array]:
        """Yield where the paths of the races begin, without end."""
        yield shortest.coefficients
        level, obstacles = self._grids[0].level, self._program.problem.obstacles
        guesses = self._program.family.first_guesses(obstacles, level.points, level.damping)
        yield from guesses

    def _raced(self, asked: Objective, starts: Sequence[Array]) -> list[_Rough]:
        """Return the paths on few points that come furthest."""
        grid = self._rough_grid(asked)
        self._starts += len(starts)
        paths = [self._solve(_with(grid, iterations=_FIRST_HEAT), start) for start in starts]
        count, iterations = _SECOND_HEAT
        leading = sorted(paths, key=_lead)[:count]
        paths = [self._solve(*_further(grid, path, iterations)) for path in leading]
        found = list[_Rough]()
        for number, path in enumerate(sorted(paths, key=_lead)):
            if number < _FINALISTS or not found:
                found += self._settled(asked, path)
        return found

    def _hop(self, asked: Objective, found: list[_Rough], number: int) -> None:
        """Look around the best path on few points, then around the better one, and so on."""
        grid, random = self._rough_grid(asked), np.random.default_rng(number)
        directions = grid.program.family.directions
        self._starts += _HOPS
        for _, spread in zip(range(_HOPS), cycle(_SPREADS), strict=False):
            best = min(found, key=_worth).path
            aside = directions @ random.normal(scale=spread, size=len(best.x))
            begin = best.x + aside, best.curvature
            path = self._solve(_with(grid, iterations=_FIRST_HEAT), *begin)
            if not _lead(path)[0] and path.at_x.objective < _NEARLY * best.at_x.objective:
                found += self._settled(asked, path)

    def _settled(self, asked: Objective, path: PathSolution) -> list[_Rough]:
        """Return what comes of a path on few points, if there is a path and more do not refute it.

        Between few points a path may be singular or run through an obstacle.
        """
        grid = _with(self._rough_grid(asked), tolerated=_FINE_TOLERATED)
        path = self._solve_feasibly(*_further(grid, path, _LAST_HEAT))
        if not path.feasible:
            return []
        _, more = self._toward(with_tie_break(asked, self._settings))[:2]
        looked = self._solve(_with(more, iterations=0), path.x).at_x
        if not looked.violation < _SMALL_VIOLATION:
            return []
        worth = looked.objective if asked.joint_path_length else float(looked.max_terms.max())
        return [_Rough(path, worth)]

    def _rough_grid(self, asked: Objective) -> Grid:
        """Return few points with the objective asked for."""
        return _with(
            self._toward(with_tie_break(asked, self._settings))[0],
            optimality=_ROUGH_OPTIMALITY,
            progress=_ROUGH_PROGRESS,
            tolerated=_TOLERATED,
            first_radius=_FAR,
        )

    def _path_near(
        self, objective: Objective, x: Array, curvature: Array | None
    ) -> Iterator[FoundPath]:
        """Yield the best path on all points near x, if there is one."""
        grids = self._toward(objective)[1:] or self._toward(objective)
        for grid in grids:
            careful = _with(
                corrected(grid, x) if grid is grids[-1] else grid,
                progress=max(grid.level.progress, _FINE_PROGRESS),
                iterations=_FINE_ITERATIONS,
                tolerated=_FINE_TOLERATED,
                first_radius=_NEAR,
            )
            found = self._solve_feasibly(careful, x, curvature)
            if found.at_x.is_defined:
                x, curvature = found.x, found.curvature
        again = _with(careful, iterations=_MENDING_ITERATIONS)
        yield from self._checkable(*self._kept_between_points(again, found))

    def _checkable(
        self, path: PathSolution, followed: FollowedMotion | None
    ) -> Iterator[FoundPath]:
        """Yield a path with what comes of it, if it is defined."""
        if path.at_x.is_defined:
            self._watch.report(self._progress(CHECKING, path.at_x))
            yield replace(self._found(path), followed=followed)

    def _path_at(self, objective: Objective, x: Array) -> tuple[Grid, PathSolution]:
        """Return the path of x as it is, on all points, with its grid; it may be singular."""
        grid = _with(corrected(self._toward(objective)[-1], x), iterations=0)
        return grid, self._solve(grid, x)

    def _solve_feasibly(self, grid: Grid, x: Array, curvature: Array | None) -> PathSolution:
        """Solve, and return the best feasible path on the way if the solver does not end at one.

        Steps along curved constraints violate them a little until the solver converges; small
        steps undo that.
        """
        program = _Remembering(
            **{item.name: getattr(grid.program, item.name) for item in fields(PathProgram)}
        )
        grid = replace(grid, program=program)
        solution = self._solve(grid, x, curvature)
        if FEASIBILITY_TOLERANCE < solution.at_x.violation < _SMALL_VIOLATION:
            mended = self._mended(grid, solution)
            solution = mended if mended.feasible else solution
        if solution.feasible or not program.feasible:
            return solution
        best = min(program.feasible, key=lambda at_x: at_x.objective)
        at_best = self._solve(_with(grid, iterations=0), best.motion.x)
        reason = "good enough: the best on the way that keeps the constraints"
        return replace(at_best, stop_reason=reason, curvature=solution.curvature)

    def _mended(self, grid: Grid, solution: PathSolution) -> PathSolution:
        """Return the nearest path that keeps the constraints, where a few steps lead there."""
        mended = nearest_feasible(
            self._watched(grid), grid.along(solution.x), solution.at_x, _MENDING_ITERATIONS
        )
        return replace(self._noted(mended), curvature=solution.curvature)

    def _solve_again(self, grid: Grid, start: Array) -> PathSolution:
        """Solve from a path that hardly misses what the grid's program demands."""
        solution = self._solve(grid, start)
        return (
            solution
            if solution.feasible or not solution.at_x.is_defined
            else self._mended(grid, solution)
        )

    def _toward(self, objective: Objective) -> list[Grid]:
        """Return the grids, coarse to fine, with another objective.

        None is damped: what damping leads through a singularity would be refused in the end.
        """
        threshold = self._settings.singular_value_threshold
        found = []
        for grid in self._grids:
            away = _AWAY * threshold
            margins = {**grid.program.margins, SingularValues.name: away}
            program = replace(grid.program, objective=objective, damping=0.0, margins=margins)
            found.append(replace(grid, program=program, directions=program.family.directions))
        return found


@dataclass(frozen=True, eq=False)
class _Remembering(PathProgram):
    """A program that remembers the feasible paths that it was asked for."""

    feasible: list[PathLinearisation] = field(default_factory=list)

    def linearise(self, x: Array) -> PathLinearisation:
        """Return objective and constraints of a path with their derivatives."""
        at_x = super().linearise(x)
        if at_x.violation <= FEASIBILITY_TOLERANCE:
            self.feasible.append(at_x)
        return at_x


@dataclass(frozen=True, eq=False)
class _Rough:
    """A path on few points that keeps the constraints there."""

    path: PathSolution
    worth: float  # by the objective asked for, on more points; less is better


def _worth(rough: _Rough) -> float:
    return rough.worth


def _lead(path: PathSolution) -> tuple[bool, float]:
    """Return a key to sort by, the best first; a small violation can be mended later."""
    is_far_off = not path.at_x.violation <= _SMALL_VIOLATION
    return is_far_off, path.at_x.violation if is_far_off else path.at_x.objective


def _further(grid: Grid, path: PathSolution, iterations: int) -> tuple[Grid, Array, Array | None]:
    """Return what the solver needs to go on with a path."""
    return _with(grid, iterations=iterations, first_radius=path.radius), path.x, path.curvature


def _with(grid: Grid, **of_level: Any) -> Grid:
    """Return a grid that is solved in another way."""
    return replace(grid, level=replace(grid.level, **of_level))


def _lower_rungs(objective: Objective) -> Iterator[Objective]:
    """Yield objectives from the lowest rung of the ladder to the last one below an objective."""
    for rung in _RUNGS:
        if rung * objective.joint_path_length >= objective.chaser_attitude:
            return
        yield replace(objective, joint_path_length=objective.chaser_attitude / rung)


def _better(objective: Objective, best: Plan, *others: Plan | None) -> Plan:
    """Return the best of several plans, the first where they are equal."""
    plans = [best, *(other for other in others if other is not None)]
    return min(plans, key=lambda plan: weighted_sum(objective, plan.metrics))
