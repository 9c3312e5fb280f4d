"""A search from one first guess that is another problem's path."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import OutOfTime
from ff_planner_ros.planning.motion.measures import joint_path_length
from ff_planner_ros.planning.motion.watch import Progress, Watch
from ff_planner_ros.planning.optimisation.program import PathLinearisation
from ff_planner_ros.planning.search.attitude_search import AttitudeSearch
from ff_planner_ros.planning.search.search import (
    FoundPath,
    PathSolution,
    corrected,
    is_promising,
    near,
)

# The first trust region: another problem's path is near this one's.
_RADIUS = 0.1
# On few points, where most that lead anywhere are there after eight; and on all points after them.
_ITERATIONS_FEW, _ITERATIONS_AFTER = 15, 2
# A path may be a long way round that is so many times as long as the straight way of its joints,
# and as the path that the family would begin with.
_DIRECT, _LONG = 1.2, 1.5
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
        grid = near(corrected(self._grids[-1], rough.x), _ITERATIONS_AFTER, _RADIUS)
        solution = self._mended_near(grid, self._solve(grid, rough.x))
        found, followed = self._kept_between_points(grid, solution)
        if found.feasible and not found.converged:
            found = replace(found, stop_reason=_ENOUGH)
        yield from self._checkable(found, followed)

    def _is_long(self, at_x: PathLinearisation) -> bool:
        """Tell whether a path may be a long way round."""
        ends = at_x.motion.q[[0, -1], 7:]
        length = at_x.objective / self._program.objective.joint_path_length
        if length <= _DIRECT * float(np.linalg.norm(ends[1] - ends[0])):
            return False
        level = self._grids[0].level
        own = self._program.family.motion(self._own, level.points, level.damping)
        if own.singular_at is not None:
            return False
        step = self._program.problem.duration / (level.points - 1)
        return length > _LONG * joint_path_length(own.v[:, 6:], step)

    @cached_property
    def _own(self) -> Array:
        """What the family would begin with."""
        level, obstacles = self._grids[0].level, self._program.problem.obstacles
        return next(self._program.family.first_guesses(obstacles, level.points, level.damping))

    def _optimum_on_few_points(self, guess: Array) -> PathSolution | None:
        """Return the better one of the paths that the guess and the family's own lead to."""
        self._starts += 1
        few, geometry = self._grids[0], self._program.problem.robot.geometry
        at_guess = self._looked_at(few, guess)
        # Where the goal is an equation, the first step must have room to get there.
        radius = few.level.first_radius if at_guess.equalities.size else _RADIUS
        rough = self._solve(near(few, _ITERATIONS_FEW, radius), guess, here=at_guess)
        if not is_promising(rough, geometry):
            return None
        if not self._is_long(rough.at_x):
            return rough
        self._starts += 1
        other = self._solve(few, self._own)
        is_better = other.at_x.objective < rough.at_x.objective
        return other if is_better and is_promising(other, geometry) else rough
