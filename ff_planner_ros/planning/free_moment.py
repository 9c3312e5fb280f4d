"""When to arrive, where the planner chooses the duration: moments that promise a plan, best first.

Paths are looked for from several moments of the range on few points, with the duration as one more
variable (`free_program`). A plan is then made at the moment that was found, as if its duration had
been given: nothing that is said of such a plan, nor the check, depends on how the moment was found.

Where nothing but the duration counts, one moment is enough to begin with. From then on each first
guess only has to show that there may be a path which arrives a step sooner; hardly any does, and a
few iterations tell.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from ff_planner_ros.arrays import Array
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.planning.families import path_families
from ff_planner_ros.planning.free_program import FreeProgram
from ff_planner_ros.planning.path_family import PathFamily
from ff_planner_ros.planning.plan import SolverReport
from ff_planner_ros.planning.preconditions import require_plannable
from ff_planner_ros.planning.problem import (
    DurationRange,
    Parametrisation,
    PlanningProblem,
    lasting,
)
from ff_planner_ros.planning.program import PathLinearisation, PathProgram, path_program
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.planning.solver import FIRST_RADIUS, minimise, nearest_feasible
from ff_planner_ros.planning.watch import SEARCHING, Progress, Watch

# Moments of the range that the search begins at, as parts of it: the shortest first.
_PARTS = (0.0, 0.25, 0.5, 0.75, 1.0)
# A bold first step changes the duration by this part of the range.
_STRIDE = 0.1
# Points, damping, first-order optimality, part of the objective that a last step may promise, and
# iterations. More points are for the moment that is chosen.
_LEVELS = ((13, 0.005, 1e-2, 2e-3, 40), (25, 0.0, 3e-3, 2e-4, 40))
# A path on few points that violates a requirement by less may lead to a plan nearby.
_PROMISING = 5e-3
# The solver stays a little inside the range: so near to its end it means the end [s].
_AT_END = 1e-4
# One that violates less is where path and duration together are at their best.
_KEPT = 1e-4
# So many moments that are promising are enough to choose from.
_ENOUGH = 3
# A capture that is sooner by less than this part of the duration is the same.
SOONER = 0.02
# Towards a path that arrives sooner: the part of all first guesses to begin at, and what a guess
# may violate after so many iterations; after twice as many it promises a plan. Of 16 guesses that
# led to one, 15 did.
_GLANCED_AT, _GLANCE, _FAR = 0.6, 4, 4e-2
# First guesses of one duration are good for others down to this part of it.
_ANOTHER = 0.9


@dataclass(frozen=True, eq=False)
class Moment:
    """A duration, and a path that nearly arrives then."""

    duration: float  # [s]
    family: Parametrisation
    x: Array  # decision variables of the path
    objective: float  # with the weight of the duration
    violation: float  # of the worst requirement

    @property
    def is_certain(self) -> bool:
        """Whether few points leave no doubt: else more of them may allow a shorter duration."""
        return self.violation <= _KEPT

    def is_like(self, other: Moment, part: float) -> bool:
        """Tell whether there is no need to try it beside another, so near in duration."""
        near = abs(self.duration - other.duration) < part * other.duration
        return near and self.family is other.family and self.is_certain


@dataclass
class Effort:
    """How much was tried until now."""

    starts: int = 0
    iterations: int = 0
    rollouts: int = 0

    def add(self, report: SolverReport) -> None:
        """Count what led to a plan of a given duration."""
        self.starts += report.starts
        self.iterations += report.iterations
        self.rollouts += report.rollouts

    def report(self, of_plan: SolverReport) -> SolverReport:
        """Return the report of the plan that was chosen, with all the effort."""
        return replace(
            of_plan, starts=self.starts, iterations=self.iterations, rollouts=self.rollouts
        )


def moments(
    problem: PlanningProblem,
    settings: PlannerSettings,
    watch: Watch,
    first_guess: Array | None,
    effort: Effort,
) -> list[Moment]:
    """Return moments of the range that promise a plan, the best first.

    Args:
        first_guess: Tried at every moment, in the family that has as many variables.
        effort: Is told what was tried.

    Raises:
        InvalidInput: The start violates what the plan must keep.
        NoPlanFound: At no moment is the goal within reach.
        OutOfTime: By the watch.
    """
    begun = _begun(problem, settings)
    found = list[Moment]()
    only_duration = problem.objective.only_duration
    numbers = range(len(path_families(begun[0], settings)))
    # The later a family comes, the more it can do: begin there, and give the others one chance.
    for number in reversed(numbers) if only_duration else numbers:
        few = replace(settings, starts=1) if found and only_duration else settings
        in_family = _in_family(problem, begun, number, few, watch, first_guess, effort)
        promising = (moment for moment in in_family if moment.violation <= _PROMISING)
        if only_duration:
            found += islice(promising, 1)
        else:
            found += promising
        # Where only the path counts, families come in the order in which they are tried.
        if found and problem.objective.duration == 0.0:
            break
    if found and only_duration:
        found += _sooner(problem, min(found, key=_worth), settings, watch, effort)
    return sorted(found, key=_worth)


def _worth(moment: Moment) -> float:
    return moment.objective


def moments_to_begin_at(problem: PlanningProblem) -> list[float]:
    """Return durations all over the range, the shortest first [s]."""
    window = problem.durations
    wide = window.maximum - window.minimum
    return [window.minimum + part * wide for part in (_PARTS if wide > 0.0 else _PARTS[:1])]


def _begun(problem: PlanningProblem, settings: PlannerSettings) -> list[PlanningProblem]:
    """Return the problem at the moments to begin at, those at which it is not hopeless."""
    begun, refusals = list[PlanningProblem](), list[NoPlanFound]()
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
    """Yield what is found in one family, from first guesses at all moments in turn."""
    ways = [way for fixed in begun for way in _ways(fixed, number, settings)]
    starts = [_guesses(fixed, way, first_guess) for fixed, way in ways]
    promising = 0
    for _ in range(max(1, settings.starts // len(ways))):
        for (fixed, way), guesses in zip(ways, starts, strict=True):
            for guess in islice(guesses, 1):
                effort.starts += 1
                search = _FreeSearch(problem, fixed, way, settings)
                moment = search.improved(guess, watch, effort)
                if moment is not None:
                    yield moment
                    promising += moment.violation <= _PROMISING
        if promising >= _ENOUGH:
            return


def _sooner(
    problem: PlanningProblem,
    known: Moment,
    settings: PlannerSettings,
    watch: Watch,
    effort: Effort,
) -> Iterator[Moment]:
    """Yield moments that are sooner than one that is known, each sooner than the last certain one."""
    bounded = _before(problem, known)
    if bounded is None:
        return
    fixed = lasting(bounded, bounded.duration)
    starts = math.ceil(_GLANCED_AT * settings.starts)
    for ways in reversed(path_families(fixed, settings)):
        for way in ways:
            guesses = islice(_guesses(fixed, way, None), starts)
            guess = known.x if way.name == known.family else next(guesses, None)
            while guess is not None:
                effort.starts += 1
                search = _FreeSearch(bounded, lasting(bounded, bounded.duration), way, settings)
                near = search.glance(guess, watch, effort)
                moment = None if near is None else search.improved(near, watch, effort)
                if moment is not None and moment.violation <= _PROMISING:
                    yield moment
                if moment is None or not moment.is_certain:
                    guess = next(guesses, None)
                    continue
                earlier = _before(problem, moment)
                if earlier is None:
                    return
                if moment.duration < _ANOTHER * fixed.duration:  # first guesses are others then
                    yield from _sooner(problem, moment, settings, watch, effort)
                    return
                bounded, guess = earlier, moment.x


def _before(problem: PlanningProblem, known: Moment) -> PlanningProblem | None:
    """Return a problem whose durations are shorter than a moment's; None: none is."""
    window, longest = problem.durations, (1.0 - SOONER) * known.duration
    if longest <= window.minimum:
        return None
    return replace(
        lasting(problem, longest),
        duration_range=DurationRange(window.minimum, longest, window.target_velocity),
    )


def _ways(
    fixed: PlanningProblem, number: int, settings: PlannerSettings
) -> list[tuple[PlanningProblem, PathFamily]]:
    groups = path_families(fixed, settings)
    return [(fixed, way) for way in groups[number]] if number < len(groups) else []


def _guesses(fixed: PlanningProblem, way: PathFamily, first_guess: Array | None) -> Iterator[Array]:
    if first_guess is not None and len(first_guess) == way.variables:
        yield first_guess
    points, damping, *_ = _LEVELS[0]
    yield from way.first_guesses(fixed.obstacles, points, damping)


@dataclass(frozen=True, eq=False)
class _FreeSearch:
    """The search for path and duration together, from one duration and in one family."""

    problem: PlanningProblem  # with a range of durations
    fixed: PlanningProblem  # of the duration to begin with
    family: PathFamily
    settings: PlannerSettings

    @property
    def _radius(self) -> float:
        return FIRST_RADIUS * self.family.stride

    @property
    def _unit(self) -> float:
        """Unit of the duration, as the solver sees it [s]."""
        window = self.problem.durations
        return _STRIDE * (window.maximum - window.minimum) / self._radius

    def _program(self) -> PathProgram:
        asked = self.problem.objective
        least = self.settings.joint_path_tie_break * max(asked.chaser_attitude, asked.duration)
        path = replace(asked, joint_path_length=asked.joint_path_length or least)
        return path_program(replace(self.fixed, objective=path), self.family, self.settings)

    def _free(self, program: PathProgram, points: int, damping: float) -> FreeProgram:
        on_points = replace(program, points=points, damping=damping)
        return FreeProgram(self.problem, on_points, self.problem.objective.duration, self._unit)

    def glance(self, guess: Array, watch: Watch, effort: Effort) -> Array | None:
        """Return a path on few points that nearly keeps every requirement; None: there is none.

        Only what a few steps lead to is known.
        """
        points, damping, *_ = _LEVELS[0]
        free = self._free(self._program(), points, damping)
        linearise, along = _watched(free, watch, effort), self._along(guess)
        here = linearise(along)
        if not here.is_defined:
            return None
        for allowed in (_FAR, _PROMISING):
            solution = nearest_feasible(linearise, along, here, _GLANCE)
            effort.iterations += solution.iterations
            along, here = solution.x, solution.at_x
            if here.violation > allowed:
                return None
        return along[:-1]

    def improved(self, guess: Array, watch: Watch, effort: Effort) -> Moment | None:
        """Return where path and duration together lead to from a first guess; None: nowhere."""
        along, program, levels = self._along(guess), self._program(), list(_LEVELS)
        while levels:
            points, damping, optimality, progress, iterations = levels[0]
            free = self._free(program, points, damping)
            linearise = _watched(free, watch, effort)
            solution = minimise(linearise, along, iterations, optimality, progress, self._radius)
            effort.iterations += solution.iterations
            if not solution.at_x.is_defined:
                return None
            along = solution.x
            broken = free.at(free.duration(along)).broken(solution.at_x)
            program = program.keeping(broken)
            levels = levels if broken else levels[1:]
        return Moment(
            _chosen(self.problem.durations, free.duration(along)),
            Parametrisation(self.family.name),
            along[:-1],
            solution.at_x.objective,
            solution.at_x.violation,
        )

    def _along(self, guess: Array) -> Array:
        return np.append(guess, self.fixed.duration / self._unit)


def _watched(
    free: FreeProgram, watch: Watch, effort: Effort
) -> Callable[[Array], PathLinearisation]:
    """Return what linearises while the watch looks on."""

    def linearise(along: Array) -> PathLinearisation:
        watch.require_time()
        at_x = free.linearise(along)
        effort.rollouts += 1
        watch.report(
            Progress(SEARCHING, effort.starts, effort.rollouts, at_x.objective, at_x.violation)
        )
        return at_x

    return linearise


def _chosen(window: DurationRange, duration: float) -> float:
    """Return the duration that the solver means [s]."""
    ends = (window.minimum, window.maximum)
    return next((end for end in ends if abs(duration - end) < _AT_END), duration)
