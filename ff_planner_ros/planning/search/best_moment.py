"""The best plan over a range of durations; each plan is made as if its duration had been given.

`free_moment` finds promising moments: durations, each with a path on a coarse grid. What that grid
does not show, the motion between the points or a torque, may rule out a plan there; then the
nearest later moment that has a plan is searched. If the duration has a weight, and the coarse grid
leaves a doubt, shorter durations are tried from the plan's own path until there is no better plan.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import Watch
from ff_planner_ros.planning.optimisation.objectives import duration_of, plan_cost
from ff_planner_ros.planning.problem.problem import Parametrisation, PlanningProblem, lasting
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.search.candidate import Effort
from ff_planner_ros.planning.search.families import is_detour, is_held
from ff_planner_ros.planning.search.free_moment import (
    SOONER,
    moment_in_another_family,
    moments_to_begin_at,
    rounds,
)
from ff_planner_ros.planning.search.free_search import Moment

# Plans a problem whose duration is given.
Planner: TypeAlias = Callable[[PlanningProblem, PlannerSettings, Watch, Array | None], Plan]

# If a moment has no plan, later ones are tried: by these fractions of the duration.
_SOON, _LATER = (0.0, 0.02, 0.08), (0.3, 1.0, 4.0, math.inf)
# Iteration limit on all points if only the duration has a weight.
_ENOUGH = 20
# Initial guesses of a shorter duration where only the duration has a weight.
_GUESSES_ANEW = 3
# Relative accuracy of the shortest duration.
_KNOWN = 0.01


@dataclass(frozen=True, eq=False)
class _Asked:
    """The request, and the planner of one duration."""

    problem: PlanningProblem  # with a range of durations
    settings: PlannerSettings
    watch: Watch
    plan: Planner
    effort: Effort

    def at(
        self, duration: float, family: Parametrisation, guess: Array | None, starts: int
    ) -> Plan | NoPlanFound:
        """Return the plan of one duration [s], or why there is none.

        Raises:
            OutOfTime: By the watch.
        """
        fixed = replace(lasting(self.problem, duration), parametrisation=family)
        settings = replace(self.settings, starts=starts)
        if self.problem.objective.only_duration and guess is not None:
            # Where the shortest duration leaves hardly any path there is nothing to optimise.
            settings = replace(settings, max_iterations=min(_ENOUGH, settings.max_iterations))
        try:
            found = self.plan(fixed, settings, self.watch, guess)
        except NoPlanFound as refused:
            return refused
        self.effort.add(found.solver)
        return found

    def worth(self, plan: Plan) -> float:
        """Return the cost of a plan in the objective of the request [rad]."""
        return plan_cost(self.problem.objective, plan)


def plan_at_best_moment(
    problem: PlanningProblem,
    settings: PlannerSettings,
    watch: Watch,
    first_guess: Array | None,
    plan: Planner,
) -> Plan:
    """Return the best plan found over the problem's range of durations.

    Args:
        first_guess: As in `free_moment.rounds`.
        plan: Plans a problem with a given duration.

    Raises:
        InvalidInput: The start violates a requirement.
        NoPlanFound: No plan was found at any duration.
        OutOfTime: By the watch.
    """
    effort = Effort()
    asked = _Asked(problem, settings, watch, plan, effort)
    best, moment, known = None, None, list[Moment]()
    for promising in rounds(problem, settings, watch, first_guess, effort):
        best, moment = _best_of(asked, promising, _SOON)
        if best is not None:
            break
        known += promising
    if best is None and known:
        best, moment = _best_of(asked, known, _LATER)
    held = best and (
        is_held(problem, settings, best)
        or is_detour(best.trajectory.joint_positions, problem.robot.joint_weights)
    )
    if best and not problem.objective.only_duration and held:
        best, moment = _better_in_another_family(asked, best, moment)
    if best is None:
        best = _any(asked)
    elif problem.objective.duration > 0.0 and not (
        problem.objective.only_duration and moment is not None and moment.is_certain
    ):
        best = _shorten(asked, best)
    if problem.objective.only_duration and problem.posture is None:
        best = _anew(asked, best)
    return replace(best, solver=effort.report(best.solver))


def _better_in_another_family(
    asked: _Asked, best: Plan, moment: Moment | None
) -> tuple[Plan, Moment | None]:
    """Return the plan that `best` leads to in the more general family, if that is better.

    If a limit on the chaser's rotation is active, or the joint path is a detour, it often is.
    """
    other = moment_in_another_family(asked.problem, asked.settings, asked.watch, best, asked.effort)
    found = None if other is None else _near(asked, other, _SOON[:1])
    if found is None or asked.worth(found) >= asked.worth(best):
        return best, moment
    return found, other


def _best_of(
    asked: _Asked, promising: Sequence[Moment], parts: Sequence[float]
) -> tuple[Plan | None, Moment | None]:
    """Return the best plan near promising moments, which are sorted best first, and its moment.

    Args:
        parts: See `_near`.
    """
    best: Plan | None = None
    chosen: Moment | None = None
    tried = list[Moment]()
    for moment in promising:
        if best is not None and moment.objective >= asked.worth(best):
            break
        if any(moment.is_like(other, _KNOWN) for other in tried):
            continue
        tried.append(moment)
        found = _near(asked, moment, parts)
        if found is not None and (best is None or asked.worth(found) < asked.worth(best)):
            best, chosen = found, moment
    return best, chosen


def _near(asked: _Asked, moment: Moment, parts: Sequence[float]) -> Plan | None:
    """Return the plan at a moment, or else at the first later one tried that has a plan.

    Args:
        parts: How much later to try, as fractions of the moment's duration; the first may be zero.
    """
    window = asked.problem.durations
    plan: Plan | None = None
    too_short, duration = 0.0, moment.duration
    if parts[0]:
        too_short = min(moment.duration * (1.0 + _SOON[-1]), window.maximum)
    alone = asked.problem.objective.only_duration and not moment.is_certain
    for part in parts[:1] if alone else parts:
        duration = min(moment.duration * (1.0 + part), window.maximum)
        found = asked.at(duration, moment.family, moment.x, 1)
        if isinstance(found, Plan):
            plan = found
            break
        too_short = duration
        if duration == window.maximum:
            break
    counts = asked.problem.objective.duration > 0.0
    while plan and counts and too_short and duration > (1.0 + _KNOWN) * too_short:
        between = math.sqrt(too_short * duration)
        found = asked.at(between, moment.family, plan.coefficients, 1)
        if isinstance(found, Plan):
            plan, duration = found, between
        else:
            too_short = between
    return plan


def _any(asked: _Asked) -> Plan:
    """Return the plan of the shortest of `moments_to_begin_at` that has one, with all guesses.

    Raises:
        NoPlanFound: None has a plan.
    """
    refusals = list[NoPlanFound]()
    for duration in moments_to_begin_at(asked.problem):
        found = asked.at(duration, asked.problem.parametrisation, None, asked.settings.starts)
        if isinstance(found, Plan):
            return found
        refusals.append(found)
    raise _refusal(asked, refusals)


def _refusal(asked: _Asked, refusals: Sequence[NoPlanFound]) -> NoPlanFound:
    """Return the error of a range without a plan: its durations, and the hardest requirement.

    That is the one of all durations' refusals which the fewest candidates met.
    """
    met = asked.effort.met.copy()
    for one in refusals:
        met.update(one.met)
    durations = moments_to_begin_at(asked.problem)
    known = [pair for pair in zip(durations, refusals, strict=True) if pair[1].requirement]
    duration, hardest = min(
        known or [(durations[-1], refusals[-1])], key=lambda pair: met[pair[1].requirement]
    )
    tried = ", ".join(f"{each:g}" for each in durations)
    why = (
        f"no plan was found that lasts {tried} s, nor from there on with the duration free; the "
        f"hardest to meet, with {duration:g} s: {hardest.constraint}"
    )
    return NoPlanFound(hardest.status, why, hardest.attempt, hardest.failures)


def _shorten(asked: _Asked, best: Plan) -> Plan:
    """Return the last of ever shorter plans, each better than the one before."""
    window = asked.problem.durations
    while duration_of(best) > window.minimum:
        found = asked.at(_sooner(asked, best), Parametrisation(best.family), best.coefficients, 1)
        if not isinstance(found, Plan) or asked.worth(found) >= asked.worth(best):
            break
        best = found
    return best


def _anew(asked: _Asked, best: Plan) -> Plan:
    """Return the last of ever shorter plans, each found without any path that is known.

    The search with a free duration sees coarse grids only, and ends in whatever minimum is near.
    """
    window, starts = asked.problem.durations, min(_GUESSES_ANEW, asked.settings.starts)
    while duration_of(best) > window.minimum:
        found = asked.at(_sooner(asked, best), asked.problem.parametrisation, None, starts)
        if not isinstance(found, Plan):
            break
        best = _shorten(asked, found)
    return best


def _sooner(asked: _Asked, best: Plan) -> float:
    """Return the next duration to try, shorter than a plan's [s]."""
    return max((1.0 - SOONER) * duration_of(best), asked.problem.durations.minimum)
