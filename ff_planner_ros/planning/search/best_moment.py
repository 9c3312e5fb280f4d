"""The plan at the best moment of a range: made as if its duration had been given.

`free_moment` says which moments promise a plan. What the search on few points does not know, the
motion between the points or a torque, may spoil a plan there: then the nearest moment is looked for
at which there is one. Where the duration has a weight, and few points leave a doubt, shorter ones
are tried from the plan's own path until there is none.
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
from ff_planner_ros.planning.search.effort import Effort
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

# Where there is no plan at a moment, those are tried that are later by these parts of the duration.
_SOON, _LATER = (0.0, 0.02, 0.08), (0.3, 1.0, 4.0, math.inf)
# Iterations on all points, where only the duration counts.
_ENOUGH = 20
# A shortest duration is known to this part of it.
_KNOWN = 0.01


@dataclass(frozen=True, eq=False)
class _Asked:
    """What is asked for, and how a plan of a given duration is made."""

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
        """Return what a plan is worth, less is better [rad]."""
        return plan_cost(self.problem.objective, plan)


def plan_at_best_moment(
    problem: PlanningProblem,
    settings: PlannerSettings,
    watch: Watch,
    first_guess: Array | None,
    plan: Planner,
) -> Plan:
    """Return the best plan that is found in a range of durations.

    Args:
        plan: Makes the plan of a duration that is given.

    Raises:
        InvalidInput: The start violates what the plan must keep.
        NoPlanFound: At no moment is there a plan.
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
        is_held(problem, settings, best) or is_detour(best, problem.robot.joint_weights)
    )
    if best and not problem.objective.only_duration and held:
        best, moment = _better_in_another_family(asked, best, moment)
    if best is None:
        best = _any(asked)
    elif problem.objective.duration > 0.0 and not (
        problem.objective.only_duration and moment is not None and moment.is_certain
    ):
        best = _shorten(asked, best)
    return replace(best, solver=effort.report(best.solver))


def _better_in_another_family(
    asked: _Asked, best: Plan, moment: Moment | None
) -> tuple[Plan, Moment | None]:
    """Return the plan that another one leads to in the family that can do more, if it is better.

    Where a limit holds the chaser back, or the joint path is a detour, its paths are much shorter.
    """
    other = moment_in_another_family(asked.problem, asked.settings, asked.watch, best, asked.effort)
    found = None if other is None else _near(asked, other, _SOON[:1])
    if found is None or asked.worth(found) >= asked.worth(best):
        return best, moment
    return found, other


def _best_of(
    asked: _Asked, promising: Sequence[Moment], parts: Sequence[float]
) -> tuple[Plan | None, Moment | None]:
    """Return the best plan near moments that promise one, and its moment; the best come first.

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
    """Return the plan at a moment, or else at the next one that has a plan, if there is any.

    Args:
        parts: How much later than the moment those are that are tried, in parts of its duration.
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
    """Return a plan of a given duration, the shortest first, looked for with all first guesses.

    Raises:
        NoPlanFound: At none of the moments there is one.
    """
    refusals = list[NoPlanFound]()
    for duration in moments_to_begin_at(asked.problem):
        found = asked.at(duration, asked.problem.parametrisation, None, asked.settings.starts)
        if isinstance(found, Plan):
            return found
        refusals.append(found)
    raise _refusal(asked, refusals)


def _refusal(asked: _Asked, refusals: Sequence[NoPlanFound]) -> NoPlanFound:
    """Return the error of a range without a plan: what was searched, and what is hardest to meet.

    Of the refusals that is the one, of all durations, whose requirement the fewest candidates met.
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
    """Return a plan that is better because it is shorter, as long as there are such plans."""
    window = asked.problem.durations
    while duration_of(best) > window.minimum:
        duration = max((1.0 - SOONER) * duration_of(best), window.minimum)
        found = asked.at(duration, Parametrisation(best.family), best.coefficients, 1)
        if not isinstance(found, Plan) or asked.worth(found) >= asked.worth(best):
            break
        best = found
    return best
