"""Which moment is the answer, with plans and refusals at moments of our own choice."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ff_planner_ros.errors import NoPlanFound, OutOfTime, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.optimisation.objectives import duration_of
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Objective,
    Parametrisation,
    PlanningProblem,
)
from ff_planner_ros.planning.search import best_moment, free_moment, free_search
from ff_planner_ros.planning.search.best_moment import plan_at_best_moment
from ff_planner_ros.planning.search.free_moment import SOONER, moments_to_begin_at
from ff_planner_ros.planning.search.free_search import Entrant, Moment
from ff_planner_ros.planning.search.multi_start import PROMISING_VIOLATION
from ff_planner_ros.planning.search.planner import NOBODY
from ff_planner_ros.planning.search.side_by_side import SideBySide

SETTINGS = load_parameters().planner
SPLINE = Parametrisation.JOINT_SPLINE
BOTH, SHORTEST = Objective(1.0, 0.0, 0.1), Objective(0.0, 0.0, 1.0)


class Asked:
    """A planner whose paths are as long as a function of the duration says; NaN: it has none."""

    def __init__(self, problem: PlanningProblem, plan: Plan, length: Callable[[float], float]):
        self.problem, self.plan, self.length = problem, plan, length
        self.tried = list[float]()

    def __call__(self, problem: PlanningProblem, *_: Any) -> Plan:
        self.tried.append(problem.duration)
        length = self.length(problem.duration)
        if math.isnan(length):
            raise NoPlanFound(Status.COLLISION, f"no plan of {problem.duration:g} s")
        if math.isinf(length):
            raise OutOfTime("the time is over")
        metrics = replace(self.plan.metrics, joint_path_length=length)
        return replace(self.plan, metrics=metrics, duration=problem.duration, family=SPLINE.value)

    def best(self, monkeypatch: pytest.MonkeyPatch, *promising: Moment) -> Plan:
        monkeypatch.setattr(best_moment, "rounds", lambda *_: iter([list(promising)]))
        return plan_at_best_moment(self.problem, SETTINGS, NOBODY, None, self)


@pytest.fixture
def asked(lemur_capture: PlanningProblem, lemur_plan: Plan) -> Callable[..., Asked]:
    def made(
        length: Callable[[float], float], objective: Objective = BOTH, longest: float = 20.0
    ) -> Asked:
        window = DurationRange(4.0, longest)
        problem = replace(
            lemur_capture, objective=objective, duration=longest, duration_range=window
        )
        return Asked(problem, lemur_plan, length)

    return made


def moment(duration: float, objective: float, violation: float = 0.0) -> Moment:
    return Moment(duration, SPLINE, np.zeros(3), objective, violation)


def steps(duration: float) -> float:
    """Shorter plans have much longer paths."""
    return 30.0 / duration


def test_the_best_of_all_moments_is_the_answer_and_hopeless_ones_are_not_tried(
    asked: Callable[..., Asked], monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 17 s the sum of path and duration is least; few points promised more at 8 s."""
    planner = asked(lambda duration: steps(duration) + abs(duration - 17.0))
    promising = [moment(8.0, 2.0), moment(17.0, 2.5), moment(12.0, 3.0), moment(18.0, 50.0)]
    found = planner.best(monkeypatch, *promising)
    assert duration_of(found) == pytest.approx(17.0)
    assert planner.tried[:3] == [8.0, 17.0, 12.0]
    assert 18.0 not in planner.tried


def test_the_attitude_and_the_duration_count_with_their_weights(
    asked: Callable[..., Asked], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Paths alike, the sooner one is better."""
    found = asked(lambda _: 1.0).best(monkeypatch, moment(12.0, 0.0), moment(8.0, 0.1))
    assert duration_of(found) == pytest.approx(4.0), "and shorter ones are tried from there"
    no_weight = asked(lambda _: 1.0, Objective(1.0, 0.0))
    assert duration_of(no_weight.best(monkeypatch, moment(12.0, 0.0))) == 12.0


@pytest.mark.law("PLAN-31")
def test_a_plan_gets_shorter_as_long_as_that_is_better_and_not_beyond_the_range(
    asked: Callable[..., Asked], monkeypatch: pytest.MonkeyPatch
) -> None:
    planner = asked(lambda duration: 0.0 if duration >= 9.5 else 10.0)
    found = planner.best(monkeypatch, moment(12.0, 0.0))
    assert 9.5 <= duration_of(found) <= 9.5 / (1.0 - SOONER)
    refusing = asked(lambda duration: 0.0 if duration >= 9.5 else math.nan)
    assert duration_of(refusing.best(monkeypatch, moment(12.0, 0.0))) == duration_of(found)
    assert all(4.0 <= tried <= 20.0 for tried in planner.tried + refusing.tried)


@pytest.mark.parametrize("possible_from", [8.2, 13.0, 19.99])
def test_where_a_moment_has_no_plan_the_next_one_that_has_is_found_within_a_hundredth(
    asked: Callable[..., Asked], monkeypatch: pytest.MonkeyPatch, possible_from: float
) -> None:
    """Later ones in larger and larger steps, none beyond the longest, then what lies between."""
    planner = asked(lambda duration: 1.0 if duration >= possible_from else math.nan)
    found = planner.best(monkeypatch, moment(8.0, 0.0))
    assert possible_from <= duration_of(found) <= 1.0101 * possible_from
    assert max(planner.tried) <= 20.0


def test_where_no_moment_promises_a_plan_the_range_is_tried_the_shortest_first(
    asked: Callable[..., Asked], monkeypatch: pytest.MonkeyPatch
) -> None:
    planner = asked(lambda duration: 1.0 if duration >= 11.0 else math.nan, Objective(1.0, 0.0))
    assert duration_of(planner.best(monkeypatch)) == 12.0
    assert planner.tried == [4.0, 8.0, 12.0]
    hopeless = asked(lambda _: math.nan)
    with pytest.raises(NoPlanFound, match="lasts 4, 8, 12, 16, 20 s, nor") as refused:
        hopeless.best(monkeypatch)
    assert hopeless.tried == [4.0, 8.0, 12.0, 16.0, 20.0]
    assert "no plan of 20 s" in refused.value.constraint


def test_the_refusal_of_a_range_begins_with_what_the_fewest_candidates_met(
    asked: Callable[..., Asked], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A limit that one candidate in all met is harder than obstacles that eleven met."""
    planner = asked(steps)

    def refuse(problem: PlanningProblem, *_: Any) -> Plan:
        is_short = problem.duration < 6.0
        status = Status.COLLISION if is_short else Status.LIMIT_VIOLATED
        refused = NoPlanFound(status, "what it lacks")
        refused.requirement = "clearance" if is_short else "chaser_attitude"
        refused.met = {"clearance": 10 if is_short else 1, "chaser_attitude": int(is_short)}
        raise refused

    monkeypatch.setattr(best_moment, "rounds", lambda *_: iter([]))
    with pytest.raises(NoPlanFound, match=r"hardest to meet, with 8 s: what it lacks") as refused:
        plan_at_best_moment(planner.problem, SETTINGS, NOBODY, None, refuse)
    assert refused.value.status is Status.LIMIT_VIOLATED


def test_a_search_that_is_ended_says_so(
    asked: Callable[..., Asked], monkeypatch: pytest.MonkeyPatch
) -> None:
    first = asked(lambda _: math.inf)
    with pytest.raises(OutOfTime, match="the time is over"):
        first.best(monkeypatch, moment(8.0, 0.0))


def test_a_search_begins_all_over_the_range(asked: Callable[..., Asked]) -> None:
    assert moments_to_begin_at(asked(steps).problem) == [4.0, 8.0, 12.0, 16.0, 20.0]
    assert moments_to_begin_at(asked(steps, longest=4.0).problem) == [4.0]


class Racing:
    """A search whose paths are worth, and violate, what its only number says after each stage."""

    def __init__(self, *stages: tuple[float, float], duration: float = 10.0) -> None:
        self.stages, self.begun_at, self.looked_at = list(stages), duration, 0

    def entrant(self, number: int) -> Entrant:
        return Entrant(np.zeros(1), self.begun_at, 1.0, number=number)

    def further(self, entrant: Entrant, *_: Any) -> Entrant | None:
        objective, violation = self.stages[min(self.looked_at, len(self.stages) - 1)]
        self.looked_at += 1
        if math.isinf(objective):
            return None
        return replace(entrant, objective=objective, violation=violation)

    def optimum_ahead_of(self, *_: Any) -> Moment:
        self.looked_at += 100
        objective, violation = self.stages[-1]
        return moment(self.begun_at, objective, violation)


def race(*searches: Racing) -> Iterator[list[Moment]]:
    entrants = [search.entrant(number) for number, search in enumerate(searches)]
    run: Any = partial(free_search.run_leg, searches)  # type: ignore[arg-type]
    legs = SideBySide(run, NOBODY, best_moment.Effort(), threads=1)
    return free_moment._race(entrants, free_moment.RACES[SPLINE], legs)


def test_of_a_race_only_those_that_lead_are_brought_to_an_end_the_best_first() -> None:
    far = Racing((0.1, 1.0))
    worst, best, second = Racing((3.0, 0.0)), Racing((1.0, 0.0)), Racing((2.0, 0.0))
    singular = Racing((math.inf, 0.0))
    rounds = race(far, worst, best, singular, second)
    assert [[one.objective for one in few] for few in rounds] == [[1.0], [2.0]]
    assert far.looked_at == singular.looked_at == 1
    assert worst.looked_at == 2


def test_of_a_race_no_other_is_brought_to_an_end_before_it_is_asked_for() -> None:
    best, second = Racing((1.0, 0.0)), Racing((2.0, 0.0))
    rounds = race(second, best)
    assert next(rounds)[0].objective == 1.0
    assert (best.looked_at, second.looked_at) == (102, 2)


def test_of_a_race_paths_on_one_way_are_run_once_and_broken_ones_promise_nothing() -> None:
    same, again = Racing((1.0, 0.0)), Racing((1.001, 0.0), duration=10.05)
    later = Racing((1.001, 0.0), duration=12.0)
    assert [few[0].duration for few in race(same, again, later)] == [10.0, 12.0]
    assert not list(race(Racing((1.0, 2.0 * PROMISING_VIOLATION))))
    assert len(list(race(Racing((1.0, PROMISING_VIOLATION))))) == 1


def test_where_only_the_duration_counts_what_nearly_keeps_everything_is_promising(
    asked: Callable[..., Asked], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = [moment(6.0, 1.0, 2.0 * PROMISING_VIOLATION), moment(12.0, 2.0, PROMISING_VIOLATION)]
    monkeypatch.setattr(free_moment, "_in_family", lambda *_: iter(found))
    monkeypatch.setattr(free_moment, "_earlier", lambda *_: [moment(11.0, 1.5)])
    monkeypatch.setattr(free_moment, "require_plannable", lambda *_: None)
    problem, effort = asked(steps, SHORTEST).problem, best_moment.Effort()
    (chosen,) = free_moment.rounds(problem, SETTINGS, NOBODY, None, effort)
    assert [one.duration for one in chosen] == [11.0, 12.0, 12.0]


def test_what_is_sooner_keeps_the_range_and_the_velocity_of_its_target(
    asked: Callable[..., Asked],
) -> None:
    """A target of the user's frame moves in the system's: it is elsewhere when it is met sooner."""
    problem = asked(steps, SHORTEST).problem
    velocity = np.array([0.1, -0.2, 0.3])
    problem = replace(problem, duration_range=DurationRange(4.0, 20.0, velocity))
    sooner = free_moment._before(problem, moment(10.0, 10.0))
    assert sooner is not None
    assert sooner.durations.minimum == 4.0
    assert sooner.durations.maximum == sooner.duration == pytest.approx(9.8)
    assert sooner.durations.target_velocity.tolist() == velocity.tolist()
    way = sooner.target.position - problem.target.position
    np.testing.assert_allclose(way, (9.8 - 20.0) * velocity, atol=1e-12)
    assert free_moment._before(problem, moment(4.05, 4.05)) is None


def test_the_first_guess_goes_before_all_others_in_the_family_that_it_fits() -> None:
    own, given = [np.array([1.0, 2.0]), np.array([3.0, 4.0])], np.array([7.0, 8.0])
    search: Any = SimpleNamespace(family=SimpleNamespace(variables=2), guesses=lambda: iter(own))
    assert next(free_moment._guesses(search, given)).tolist() == [7.0, 8.0]
    for other in (None, np.array([7.0])):
        assert len(list(free_moment._guesses(search, other))) == 2
