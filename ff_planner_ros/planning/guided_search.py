"""A search from one first guess that is another problem's path."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from ff_planner_ros.arrays import Array
from ff_planner_ros.errors import OutOfTime
from ff_planner_ros.planning.attitude_search import AttitudeSearch
from ff_planner_ros.planning.search import FoundPath, PathSolution, corrected, is_promising
from ff_planner_ros.planning.watch import Progress, Watch

# Another problem's path is near this one's: the part of the objective that a step must promise, and
# the first trust region.
_PROGRESS, _RADIUS = 1e-3, 0.1
# On few points, where most that lead anywhere are there after eight; and on all points after them.
_ITERATIONS_FEW, _ITERATIONS_AFTER = 15, 2
# A path that is so many times as long as the one that the family would begin with may be a long way
# round.
_LONG = 1.5
_ENOUGH = "good enough: at its optimum on few points, and two steps further on all of them"
# A guess that leads to a plan takes 6 to 70 looks at a path; three to four times as many where the
# duration is free, too.
_LOOKS, _LOOKS_WITH_DURATION = 120, 480


class Allowance(Watch):
    """What a guess may take of a search: so many looks, so that others keep their time.

    They are counted, not timed: whether a guess is given up must not depend on the clock.
    """

    def __init__(self, watch: Watch, has_range: bool) -> None:
        """Hand on to the watch of the search."""
        self._watch = watch
        self._left = _LOOKS_WITH_DURATION if has_range else _LOOKS

    @property
    def used_up(self) -> bool:
        """Whether that ended the search, rather than the watch."""
        return self._left < 0

    def require_time(self) -> None:
        """Count a look; raises OutOfTime after the last."""
        self._watch.require_time()
        self._left -= 1
        if self.used_up:
            raise OutOfTime("the first guess has had all the looks that it may have")

    def report(self, progress: Progress) -> None:
        """Hand it on."""
        self._watch.report(progress)


class GuidedSearch(AttitudeSearch):
    """Looks for the path that a guess leads to."""

    def paths_from(self, guess: Array) -> Iterator[FoundPath]:
        """Yield the path on all points to which a guess leads, where it leads to an optimum.

        On few points the path goes all the way to its optimum: one that is only mended around the
        obstacles would stay as long as it is. Where it is long, what comes of the family's own
        first guess is looked at, too, on few points, and the better one is taken.

        Raises:
            OutOfTime: By the watch.
        """
        rough = self._optimum_on_few_points(guess)
        if rough is None:
            return
        all_points = self._grids[-1]
        level = replace(
            all_points.level, iterations=_ITERATIONS_AFTER, progress=_PROGRESS, first_radius=_RADIUS
        )
        grid = corrected(replace(all_points, level=level), rough.x)
        solution = self._mended_near(grid, self._solve(grid, rough.x))
        found, followed = self._kept_between_points(grid, solution)
        if found.feasible and not found.converged:
            found = replace(found, stop_reason=_ENOUGH)
        yield from self._checkable(found, followed)

    def _optimum_on_few_points(self, guess: Array) -> PathSolution | None:
        """Return the better one of the paths that the guess and the family's own lead to."""
        self._starts += 1
        few, problem = self._grids[0], self._program.problem
        own = next(
            few.program.family.first_guesses(problem.obstacles, few.level.points, few.level.damping)
        )
        at_own = few.program.linearise(own)
        # Where the goal is an equation, the first step must have room to get there.
        radius = few.level.first_radius if at_own.equalities.size else _RADIUS
        level = replace(
            few.level, iterations=_ITERATIONS_FEW, progress=_PROGRESS, first_radius=radius
        )
        rough = self._solve(replace(few, level=level), guess)
        if not is_promising(rough, problem.robot.geometry):
            return None
        if not at_own.is_defined or rough.at_x.objective <= _LONG * at_own.objective:
            return rough
        self._starts += 1
        other = self._solve(few, own)
        is_better = other.at_x.objective < rough.at_x.objective
        return other if is_better and is_promising(other, problem.robot.geometry) else rough
