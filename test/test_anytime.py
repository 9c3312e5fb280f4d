"""A search that is ended answers with the best plan until then, and its effort gives that again."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dense_motion import truth
from judging import violations
from recorded_requests import only_request
from robots import LEMUR_SCENARIO

from ff_planner_benchmark.problems import all_features
from ff_planner_ros.analysis.plan_document import plan_document
from ff_planner_ros.analysis.plan_json import plan_dictionary, refusal_dictionary
from ff_planner_ros.cli import main
from ff_planner_ros.errors import EndedBy, InvalidInput, NoPlanFound, OutOfTime, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import CHECKING, Budget, Steps, Watch
from ff_planner_ros.planning.optimisation.objectives import plan_cost
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Objective,
    PlanningProblem,
    lasting,
)
from ff_planner_ros.planning.problem.settings import SearchDepth
from ff_planner_ros.planning.scenario.scenario import Defaults, load_scenario, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.search.planner import _Best
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.scenarios import scenario
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.replay import Verdict, replay
from ff_planner_ros.time_budget import TimeBudget

SETTINGS = load_parameters().planner
LEAST_ATTITUDE = Objective(0.0, 1.0)


class EndingAt(Watch):
    """Ends a search at a step, as a clock would."""

    def __init__(self, step: int) -> None:
        self.left = step
        self.offered: list[Plan] = []

    def require_time(self, *_: str) -> None:
        self.left -= 1
        if self.left <= 0:
            raise OutOfTime("the clock of this test")

    def offer(self, plan: Plan) -> None:
        self.offered.append(plan)


def answered(task: PlanningTask, watch: Watch) -> tuple[Plan | None, NoPlanFound | None]:
    try:
        return perform(task, watch), None
    except NoPlanFound as refused:
        return None, refused


def same(one: Plan, other: Plan) -> bool:
    """Whether two plans are equal to the last bit."""
    return all(
        np.array_equal(getattr(one.trajectory, name), getattr(other.trajectory, name))
        for name in vars(one.trajectory)
    ) and np.array_equal(one.coefficients, other.coefficients)


def problems() -> dict[str, PlanningProblem]:
    """Least attitude, a moment to be chosen, and bodies."""
    capture = load_scenario(LEMUR_SCENARIO)
    tumbling = load_scenario(LEMUR_SCENARIO.with_name("lemur_tumbling.yaml"))
    assert tumbling.target_body is not None
    free = replace(
        tumbling,
        duration=14.0,
        duration_range=DurationRange(6.0, 14.0),
        target=tumbling.target_body.target(14.0),
        objective=Objective(1.0, 1.0, 0.3),
    )
    return {"attitude": replace(capture, objective=LEAST_ATTITUDE), "moment": free}


PROBLEMS = problems()


@pytest.mark.sampled
@pytest.mark.parametrize("name", PROBLEMS)
def test_wherever_a_search_is_ended_its_effort_gives_the_same_answer_again(name: str) -> None:
    """And a later end never gives a worse plan."""
    problem, costs = PROBLEMS[name], list[float]()
    task = PlanningTask(problem, replace(SETTINGS, search=SearchDepth.QUICK))
    for step in (1, 2, 7, 20, 45, 52, 56, 100, 168, 172, 250):
        watch = EndingAt(step)
        found, refused = answered(task, watch)
        told = found or refused
        assert told is not None
        if not told.effort:  # it needs fewer steps
            assert found is not None
            costs.append(plan_cost(problem.objective, found))
            break
        # Steps of a part that is not finished do not count.
        assert told.effort <= step
        again_found, refused_again = answered(task.ended_at(told.effort), Watch())
        if found is None:
            assert not costs, "there was a plan before"
            for one in (refused, refused_again):
                assert one is not None
                assert (one.status, one.effort) == (Status.TIMED_OUT, told.effort)
            assert str(refused).partition(";")[2] == str(refused_again).partition(";")[2]
            continue
        costs.append(plan_cost(problem.objective, found))
        assert found.solver.ended_by == EndedBy.DEADLINE
        assert not violations(lasting(problem, found.duration), found, SETTINGS)
        assert again_found is not None
        assert same(again_found, found)
        assert (again_found.effort, again_found.solver.ended_by) == (found.effort, EndedBy.EFFORT)
        assert len(watch.offered) == len({plan_cost(problem.objective, p) for p in watch.offered})
    assert len(costs) >= 2
    assert costs == sorted(costs, reverse=True)


def test_of_plans_that_are_offered_the_best_is_kept_and_not_the_last(lemur_plan: Plan) -> None:
    paths = (3.0, 1.0, 2.0, 1.0, 0.5, 4.0)
    metrics = [replace(lemur_plan.metrics, joint_path_length=path) for path in paths]
    offered = [replace(lemur_plan, metrics=one) for one in metrics]
    watch = EndingAt(1)
    best = _Best(watch, Objective(1.0, 0.0))
    kept = []
    for plan in offered:
        best.offer(plan)
        assert best.plan is not None
        kept.append(best.plan.metrics.joint_path_length)
    assert kept == [3.0, 1.0, 1.0, 1.0, 0.5, 0.5]
    assert watch.offered == [offered[0], offered[1], offered[4]]


@pytest.mark.nightly
@pytest.mark.law("NODE-11")
def test_whatever_the_clock_decided_the_effort_gives_it_again(
    times: Callable[[int, int], int],
) -> None:
    """Requests of all kinds with random budgets, of the clock of this machine."""
    rng = np.random.default_rng(31)
    ended = 0
    for number in range(times(40, 200)):
        problem = _drawn_problem(rng, number)
        task = PlanningTask(problem, replace(SETTINGS, search=SearchDepth.NORMAL))
        budget = Budget(float(10.0 ** rng.uniform(-2.0, -0.3)))
        found, refused = answered(task, TimeBudget(budget))
        told = found or refused
        assert told is not None
        again, refused_again = answered(task.ended_at(told.effort), Watch())
        ended += told.effort > 0
        if found is not None:
            assert again is not None, number
            assert same(again, found), number
            assert again.effort == found.effort
            continue
        assert refused is not None
        assert refused_again is not None, number
        assert (refused_again.status, refused_again.effort) == (refused.status, refused.effort)
        assert refused_again.failures == refused.failures
    assert ended > 0


def _drawn_problem(rng: np.random.Generator, number: int) -> PlanningProblem:
    """Return one problem of each kind in turn."""
    which = int(rng.integers(8))
    if number % 5 == 0:
        return all_features.problem(which).problem
    if number % 5 == 1:
        return PROBLEMS["moment"]
    kind, robot = ("ordinary", "cluttered")[which % 2], ("lemur", "arm6", "off7")[which % 3]
    objective = (LEAST_ATTITUDE, Objective(1.0, 0.0), Objective(1.0, 1.0))[number % 5 - 2]
    return replace(scenario(kind, robot, which // 2, turned=False).problem, objective=objective)


@pytest.mark.law("NODE-11")
def test_what_is_handed_out_early_keeps_everything_by_the_truth() -> None:
    problem = PROBLEMS["attitude"]
    found = perform(PlanningTask(problem, SETTINGS), EndingAt(60))
    assert found.solver.ended_by == EndedBy.DEADLINE
    true = truth(problem, found.trajectory)
    assert true.clearance >= 0.0
    assert true.position_miss <= SETTINGS.position_tolerance
    assert true.beyond_positions <= 1e-4


def test_a_search_that_comes_to_its_end_has_no_effort_and_says_how_it_ended() -> None:
    shortest = PlanningTask(replace(PROBLEMS["attitude"], objective=Objective(1.0, 0.0)), SETTINGS)
    found = perform(shortest, EndingAt(10**6))
    assert (found.effort, found.solver.ended_by) == (0, EndedBy.CONVERGED)
    assert same(found, perform(shortest))
    # An effort that the search does not need changes nothing but the task.
    assert perform(shortest.ended_at(10**6)).effort == 0
    assert shortest.ended_at(10**6).digest != shortest.digest
    assert shortest.ended_at(0).digest == shortest.digest


def test_a_robust_plan_that_is_not_finished_is_not_handed_out() -> None:
    settings = replace(SETTINGS, robust=replace(SETTINGS.robust, sigmas=3.0))
    task = PlanningTask(replace(PROBLEMS["attitude"], objective=Objective(1.0, 0.0)), settings)
    whole = perform(task)
    assert whole.robust is not None
    assert whole.robust.rounds
    for step in (10, 25, 40, 60):
        found, refused = answered(task, EndingAt(step))
        if found is None:
            assert refused is not None
            assert (refused.status, refused.effort) == (Status.TIMED_OUT, step)
        else:
            assert found.robust is not None
            assert found.robust.least_sigmas >= 3.0 * (1.0 - 1e-3)


def test_steps_are_counted_however_the_search_is_ended() -> None:
    steps = Steps(EndingAt(3))
    steps.require_time()
    steps.require_time(CHECKING)
    assert steps.ended_at == 0
    for _ in range(2):  # from then on every step is the last one
        with pytest.raises(OutOfTime) as end:
            steps.require_time()
        assert steps.ended_at == 3
    assert end.value.ended_by is EndedBy.EFFORT


def test_a_budget_ends_before_a_step_that_would_exceed_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the last steps of the same phase took; and the answer takes another check."""
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    watch = TimeBudget(Budget(1.05))
    watch.require_time(CHECKING)
    now[0] += 0.4
    for _ in range(2):
        watch.require_time()
        now[0] += 0.1
    watch.require_time(CHECKING)  # at 0.6 s: the answer is what is checked
    with pytest.raises(OutOfTime):  # a step of 0.1 s and a check of 0.4 s
        watch.require_time()


def test_the_budget_of_a_command_gives_the_best_until_then(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Recorded, it replays identically although the clock decided; as JSON and scenario, too."""
    answer, bag = tmp_path / "answer.json", tmp_path / "bag"
    budget = ["--objective", "attitude", "--time-budget", "0.4"]
    plan = ["plan", str(LEMUR_SCENARIO), *budget, "--json", str(answer), "--bag", str(bag)]
    if main(plan):  # on a machine that needs longer for the first plan
        pytest.skip("no plan in 0.4 s here")
    assert "the time budget of 0.4 s is used up: the best plan so far" in capsys.readouterr().out
    told = json.loads(answer.read_text())
    assert told["effort"] > 0
    assert told["solver"]["ended_by"] == "deadline"
    document = plan_document(told)
    assert document.plan.effort == told["effort"]
    recorded = only_request(bag)
    assert recorded.answer is not None
    assert recorded.answer.plans[0].effort == told["effort"]
    again = replay(recorded)
    assert again.verdict is Verdict.IDENTICAL
    assert recorded.planned_task().digest == recorded.answer.task_digest


def test_a_refusal_for_lack_of_time_is_replayed_to_the_step(tmp_path: Path) -> None:
    task = PlanningTask(PROBLEMS["attitude"], SETTINGS)
    with pytest.raises(NoPlanFound) as refused:
        perform(task, EndingAt(9))
    record_answer(tmp_path / "bag", task, refused.value, 0.1)
    assert refusal_dictionary(refused.value, 0.1)["effort"] == 9
    recorded = only_request(tmp_path / "bag")
    assert replay(recorded).verdict is Verdict.IDENTICAL


def test_a_scenario_holds_the_effort(tmp_path: Path) -> None:
    task = PlanningTask(PROBLEMS["attitude"], SETTINGS).ended_at(60)
    path = tmp_path / "scenario.yaml"
    write_scenario(task, path)
    assert "effort: 60" in path.read_text()
    again = load_task(path, Defaults(SETTINGS))
    assert again.digest == task.digest
    found = perform(again)
    assert found.effort == 60
    assert plan_dictionary(found, again, 0.1)["effort"] == 60


@pytest.mark.parametrize("effort", [-1, 1.5, 2**64, True])
def test_an_impossible_effort_is_refused(effort: Any) -> None:
    with pytest.raises(InvalidInput) as refused:
        PlanningTask(PROBLEMS["attitude"], SETTINGS, effort=effort)
    assert refused.value.field == "search.effort"
