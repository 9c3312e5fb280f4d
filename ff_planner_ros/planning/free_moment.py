"""When to arrive, where the planner chooses the duration: moments that promise a plan, best first.

Paths are looked for from several moments of the range on few points, with the duration as one more
variable (`free_program`). A plan is then made at the moment that was found, as if its duration had
been given: nothing that is said of such a plan, nor the check, depends on how the moment was found.
"""

from __future__ import annotations

from collections.abc import Iterator
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
from ff_planner_ros.planning.program import PathLinearisation, path_program
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.planning.solver import FIRST_RADIUS, minimise
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
# So many moments that are promising are enough to choose from.
_ENOUGH = 3


@dataclass(frozen=True, eq=False)
class Moment:
    """A duration, and a path that nearly arrives then."""

    duration: float  # [s]
    family: Parametrisation
    x: Array  # decision variables of the path
    objective: float  # with the weight of the duration
    violation: float  # of the worst requirement

    def is_like(self, other: Moment, part: float) -> bool:
        """Tell whether it differs from another by less than this part of the duration."""
        near = abs(self.duration - other.duration) < part * other.duration
        return near and self.family is other.family


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
    found, shortest = list[Moment](), problem.durations.minimum
    for number in range(len(path_families(begun[0], settings))):
        in_family = _in_family(problem, begun, number, settings, watch, first_guess, effort)
        for moment in in_family:
            if moment.violation <= _PROMISING:
                found.append(moment)
                if problem.objective.only_duration and moment.duration == shortest:
                    return [moment]  # there is no better one
        # Where only the path counts, families come in the order in which they are tried.
        if found and problem.objective.duration == 0.0:
            break
    return sorted(found, key=lambda moment: moment.objective)


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
                moment = _improved(problem, fixed, way, guess, settings, watch, effort)
                if moment is not None:
                    yield moment
                    promising += moment.violation <= _PROMISING
        if promising >= _ENOUGH:
            return


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


def _improved(
    problem: PlanningProblem,
    fixed: PlanningProblem,
    family: PathFamily,
    guess: Array,
    settings: PlannerSettings,
    watch: Watch,
    effort: Effort,
) -> Moment | None:
    """Return where path and duration together lead to from a first guess; None: nowhere."""
    window, asked = problem.durations, problem.objective
    least = settings.joint_path_tie_break * max(asked.chaser_attitude, asked.duration)
    path = replace(asked, joint_path_length=asked.joint_path_length or least)
    radius = FIRST_RADIUS * family.stride
    unit = _STRIDE * (window.maximum - window.minimum) / radius
    along = np.append(guess, fixed.duration / unit)
    program = path_program(replace(fixed, objective=path), family, settings)
    levels = list(_LEVELS)
    while levels:
        points, damping, optimality, progress, iterations = levels[0]
        free = FreeProgram(
            problem, replace(program, points=points, damping=damping), asked.duration, unit
        )

        def linearise(along: Array, free: FreeProgram = free) -> PathLinearisation:
            watch.require_time()
            at_x = free.linearise(along)
            effort.rollouts += 3  # at the duration, and on both sides of it
            watch.report(
                Progress(SEARCHING, effort.starts, effort.rollouts, at_x.objective, at_x.violation)
            )
            return at_x

        solution = minimise(linearise, along, iterations, optimality, progress, radius)
        effort.iterations += solution.iterations
        if not solution.at_x.is_defined:
            return None
        along = solution.x
        broken = free.at(free.duration(along)).broken(solution.at_x)
        program = program.keeping(broken)
        levels = levels if broken else levels[1:]
    return Moment(
        _chosen(window, free.duration(along)),
        Parametrisation(family.name),
        along[:-1],
        solution.at_x.objective,
        solution.at_x.violation,
    )


def _chosen(window: DurationRange, duration: float) -> float:
    """Return the duration that the solver means [s]."""
    ends = (window.minimum, window.maximum)
    return next((end for end in ends if abs(duration - end) < _AT_END), duration)
