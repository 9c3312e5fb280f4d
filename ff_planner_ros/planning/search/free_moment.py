"""The choice of the duration from a range: promising moments, best first.

Paths are optimised from several durations of the range on coarse grids, with the duration as one
more variable (`free_program`); a moment is the duration that was found, with its path. A plan is
then made for it as if the duration had been given: neither the plan's promises nor the check depend
on how it was found.

If nothing but the duration has a weight, one moment is enough to begin with. From then on each
initial guess only has to show that there may be a path which arrives a step sooner; hardly any
does, and a few iterations show that.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from itertools import islice
from typing import Any, NamedTuple

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.planning.check.preconditions import require_plannable, require_time
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import Watch
from ff_planner_ros.planning.optimisation.objectives import duration_of
from ff_planner_ros.planning.paths.path_family import PathFamily
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Parametrisation,
    PlanningProblem,
    lasting,
)
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.search.candidate import Effort
from ff_planner_ros.planning.search.families import path_families, ways_of_guess
from ff_planner_ros.planning.search.free_search import (
    TO_OPTIMUM,
    Entrant,
    FreeSearch,
    Leg,
    Moment,
    run_leg,
)
from ff_planner_ros.planning.search.multi_start import PROMISING_VIOLATION
from ff_planner_ros.planning.search.side_by_side import SideBySide


class RaceStage(NamedTuple):
    """One stage of successive halving: iterations of each entrant, and how many go on."""

    iterations: int
    go_on: int


# Joint splines take more iterations: they do not meet the goal by construction.
RACES = {
    Parametrisation.END_EFFECTOR_POLYNOMIAL: (RaceStage(6, 4), RaceStage(10, 2)),
    Parametrisation.JOINT_SPLINE: (RaceStage(12, 3), RaceStage(12, 2)),
}
# Durations that the search begins at, as fractions of the range: the shortest first.
_PARTS = (0.0, 0.25, 0.5, 0.75, 1.0)
# So many promising moments are enough to choose from.
_ENOUGH = 3
# Durations that are shorter by less than this fraction count as equal.
SOONER = 0.02
# Fraction of the initial guesses that are tried for a shorter duration.
_GLANCED_AT = 0.6
# Initial guesses of one duration are good for others down to this fraction of it.
_ANOTHER = 0.9


def rounds(
    problem: PlanningProblem,
    settings: PlannerSettings,
    watch: Watch,
    first_guess: Array | None,
    effort: Effort,
) -> Iterator[list[Moment]]:
    """Yield promising moments of the range, round by round, the best of a round first.

    If only the duration has a weight, there is one round.

    Args:
        first_guess: Tried at every duration to begin at, in families with as many variables.
        effort: Counts what is tried.

    Raises:
        InvalidInput: The start violates a requirement, or the first guess fits no family.
        NoPlanFound: The longest duration is too short for the joints, or the goal is out of reach,
            or in an obstacle, at all durations to begin at.
        OutOfTime: By the watch.
    """
    begun = _plannable(problem, settings)
    if first_guess is not None:
        ways_of_guess(begun[0], settings, first_guess)
    families = range(len(path_families(begun[0], settings)))
    if problem.objective.only_duration:
        yield _fastest(problem, begun, settings, watch, first_guess, effort)
        return
    lanes = [_Lane(problem, begun, number, settings, first_guess) for number in families]
    searches = [search for lane in lanes for search in lane.searches]
    legs = SideBySide(partial(run_leg, searches), watch, effort, settings.threads)
    with closing(legs):
        for turn in range(max(lane.turns for lane in lanes)):
            for lane in lanes:
                if turn < lane.turns:
                    effort.starts += len(lane.searches)
                    first = searches.index(lane.searches[0])
                    yield from _race(lane.entrants(first), RACES[lane.family], legs)


def moment_in_another_family(
    problem: PlanningProblem, settings: PlannerSettings, watch: Watch, plan: Plan, effort: Effort
) -> Moment | None:
    """Return the optimum of path and duration near a plan in the most general family.

    None: the optimum does not promise a plan, or the family is the plan's own.
    """
    fixed = lasting(problem, duration_of(plan))
    groups = path_families(fixed, settings)
    family = groups[-1][0]
    if plan.family == family.name:
        return None
    q, _ = from_trajectory(problem.robot, plan.trajectory)
    effort.starts += 1
    search = FreeSearch(problem, fixed, family, settings)
    moment = search.optimum(family.near(q), watch, effort)
    return moment if moment and moment.violation <= PROMISING_VIOLATION else None


class _Lane:
    """Searches of one family from all durations to begin at, with their initial guesses."""

    def __init__(
        self,
        problem: PlanningProblem,
        begun: Sequence[PlanningProblem],
        number: int,
        settings: PlannerSettings,
        first_guess: Array | None,
    ) -> None:
        self.searches = [
            FreeSearch(problem, fixed, way, settings)
            for fixed in begun
            for way in _ways(fixed, number, settings)
        ]
        self._guesses = [_guesses(search, first_guess) for search in self.searches]
        self.turns = max(1, settings.starts // len(self.searches)) if self.searches else 0

    @property
    def family(self) -> Parametrisation:
        """Family of the paths."""
        return Parametrisation(self.searches[0].family.name)

    def entrants(self, first: int) -> list[Entrant]:
        """Return the next initial guess of each search, as an entrant.

        Args:
            first: Number of the first search among those of all lanes.
        """
        pairs = zip(self.searches, self._guesses, strict=True)
        entrants = [search.entrant(guess) for search, some in pairs for guess in islice(some, 1)]
        return [replace(one, number=number) for number, one in enumerate(entrants, start=first)]


def _race(
    entrants: Sequence[Entrant], stages: Sequence[RaceStage], legs: SideBySide[Leg, Any]
) -> Iterator[list[Moment]]:
    """Yield promising moments by successive halving of entrants, the best first.

    Later ones only count if the caller asks for another one.

    Raises:
        OutOfTime: By the watch.
    """
    for stage in stages:
        further = legs.values([(one, stage.iterations) for one in entrants])
        leading = sorted((one for one in further if one is not None), key=lambda one: one.lead)
        entrants = _unlike(leading)[: stage.go_on]
    for moment in legs.values([(one, TO_OPTIMUM) for one in entrants]):
        if moment is not None and moment.violation <= PROMISING_VIOLATION:
            yield [moment]


def _unlike(entrants: Sequence[Entrant]) -> list[Entrant]:
    """Return entrants without those that are like one before them."""
    found = list[Entrant]()
    for one in entrants:
        if not any(one.is_like(other) for other in found):
            found.append(one)
    return found


def _fastest(
    problem: PlanningProblem,
    begun: list[PlanningProblem],
    settings: PlannerSettings,
    watch: Watch,
    first_guess: Array | None,
    effort: Effort,
) -> list[Moment]:
    """Return promising moments, the soonest first."""
    found = list[Moment]()
    # Later families are more general: begin with the last, and give the others one guess.
    for number in reversed(range(len(path_families(begun[0], settings)))):
        few = replace(settings, starts=1) if found else settings
        in_family = _in_family(problem, begun, number, few, watch, first_guess, effort)
        promising = (moment for moment in in_family if moment.violation <= PROMISING_VIOLATION)
        found += islice(promising, 1)
        if any(one.duration == problem.durations.minimum for one in found):
            break  # there is no better one
    if found:
        found += _earlier(problem, min(found, key=_worth), settings, watch, effort)
    return sorted(found, key=_worth)


def _worth(moment: Moment) -> float:
    return moment.objective


def moments_to_begin_at(problem: PlanningProblem) -> list[float]:
    """Return evenly spaced durations of the range, the shortest first [s]."""
    window = problem.durations
    wide = window.maximum - window.minimum
    return [window.minimum + part * wide for part in (_PARTS if wide > 0.0 else _PARTS[:1])]


def _plannable(problem: PlanningProblem, settings: PlannerSettings) -> list[PlanningProblem]:
    """Return the problem at the durations to begin at, without those that are impossible."""
    begun, refusals = list[PlanningProblem](), list[NoPlanFound]()
    # A duration too short for the joints is good to begin at: it leads to the shortest that is not.
    require_time(lasting(problem, problem.durations.maximum))
    for duration in moments_to_begin_at(problem):
        fixed = lasting(problem, duration)
        try:
            require_plannable(fixed, settings)
        except NoPlanFound as refused:
            refusals.append(refused)
        else:
            begun.append(fixed)
    if not begun:
        raise refusals[0]
    return begun


def _in_family(
    problem: PlanningProblem,
    begun: list[PlanningProblem],
    number: int,
    settings: PlannerSettings,
    watch: Watch,
    first_guess: Array | None,
    effort: Effort,
) -> Iterator[Moment]:
    """Yield moments found in one family, from initial guesses at all durations in turn."""
    searches = [
        FreeSearch(problem, fixed, way, settings)
        for fixed in begun
        for way in _ways(fixed, number, settings)
    ]
    starts = [_guesses(search, first_guess) for search in searches]
    promising = 0
    for _ in range(max(1, settings.starts // len(searches))):
        for search, guesses in zip(searches, starts, strict=True):
            for guess in islice(guesses, 1):
                effort.starts += 1
                moment = search.optimum(guess, watch, effort)
                if moment is not None:
                    yield moment
                    promising += moment.violation <= PROMISING_VIOLATION
        if promising >= _ENOUGH:
            return


def _guesses(search: FreeSearch, first_guess: Array | None) -> Iterator[Array]:
    if first_guess is not None and len(first_guess) == search.family.variables:
        yield first_guess
    yield from search.guesses()


def _earlier(
    problem: PlanningProblem,
    known: Moment,
    settings: PlannerSettings,
    watch: Watch,
    effort: Effort,
) -> Iterator[Moment]:
    """Yield moments sooner than a known one, and than each certain one before."""
    bounded = _before(problem, known)
    if bounded is None or not _joints_allow(bounded, known, settings, watch, effort):
        return
    fixed = lasting(bounded, bounded.duration)
    starts = math.ceil(_GLANCED_AT * settings.starts)
    for ways in reversed(path_families(fixed, settings)):
        for way in ways:
            guesses = islice(FreeSearch(bounded, fixed, way, settings).guesses(), starts)
            guess = known.x if way.name == known.family else next(guesses, None)
            while guess is not None:
                effort.starts += 1
                search = FreeSearch(bounded, lasting(bounded, bounded.duration), way, settings)
                near = search.glance(guess, watch, effort)
                moment = None if near is None else search.optimum(near, watch, effort)
                if moment is not None and moment.violation <= PROMISING_VIOLATION:
                    yield moment
                if moment is None or not moment.is_certain:
                    guess = next(guesses, None)
                    continue
                earlier = _before(problem, moment)
                if earlier is None:
                    return
                if moment.duration < _ANOTHER * fixed.duration:  # initial guesses differ then
                    yield from _earlier(problem, moment, settings, watch, effort)
                    return
                bounded, guess = earlier, moment.x


def _joints_allow(
    bounded: PlanningProblem, known: Moment, settings: PlannerSettings, watch: Watch, effort: Effort
) -> bool:
    """Tell whether a path to a posture may arrive sooner, by the joints' limits alone.

    Args:
        bounded: The problem with the shorter durations only.
    """
    if bounded.posture is None:
        return True
    fixed = lasting(bounded, bounded.duration)
    (splines,) = _ways(fixed, 0, settings)
    search = FreeSearch(bounded, fixed, splines, settings)
    return search.glance(known.x, watch, effort, joints_alone=True) is not None


def _before(problem: PlanningProblem, known: Moment) -> PlanningProblem | None:
    """Return the problem with only durations shorter than a moment's; None: there are none."""
    window, longest = problem.durations, (1.0 - SOONER) * known.duration
    if longest <= window.minimum:
        return None
    return replace(
        lasting(problem, longest),
        duration_range=DurationRange(window.minimum, longest, window.target_velocity),
    )


def _ways(fixed: PlanningProblem, number: int, settings: PlannerSettings) -> Sequence[PathFamily]:
    groups = path_families(fixed, settings)
    return groups[number] if number < len(groups) else []
