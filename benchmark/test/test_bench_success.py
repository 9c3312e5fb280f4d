"""The success rate, on a seeded subset of what `ff-planner-benchmark bench` measures."""

from dataclasses import replace

import pytest

from ff_planner_benchmark.bench import experiment, plans
from ff_planner_benchmark.bench.plans import SCENARIO_PLANS
from ff_planner_benchmark.problems.classes import SCENARIOS
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.problems.scenarios import scenario

SETTINGS = load_parameters().planner


@pytest.mark.law("PLAN-33")
@pytest.mark.ci
@pytest.mark.parametrize(("one", "missed_at_night"), [*zip(SCENARIOS, (0, 1), strict=True)])
def test_where_there_is_a_plan_it_is_found(one, missed_at_night, times):
    tried = list(experiment.each([one], plans._scenario)(times(10, 24), SETTINGS))
    misses = [row for row in tried if not experiment.is_solved(row)]
    assert len(misses) <= times(0, missed_at_night), misses


def test_half_of_the_scenarios_are_turned_and_each_robot_has_half(monkeypatch):
    monkeypatch.setattr(plans, "attempt", lambda *_, **labels: labels)
    rows = list(SCENARIO_PLANS.rows(8, SETTINGS))
    tried = {tuple(row.values()) for row in rows}
    assert len(tried) == len(rows) == 8 * 2
    assert sum(turned for *_, turned in tried) == 4 * 2
    assert sum(robot == "lemur" for _, robot, *_ in tried) == 4 * 2
    assert {number for _, _, number, _ in tried} == {0, 1}


def test_a_plan_that_the_planner_gave_but_the_check_refuses_is_a_miss(monkeypatch):
    """Whatever the planner says of its plan, the obstacles of the scenario decide."""
    drawn = scenario("ordinary", "lemur", 0, turned=False).problem
    free = experiment.plan(replace(drawn, obstacles=()), SETTINGS)
    monkeypatch.setattr(experiment, "plan", lambda *_: free)
    tried = next(iter(SCENARIO_PLANS.rows(1, SETTINGS)))
    assert tried["status"] == "COLLISION"
    assert not experiment.is_solved(tried)
