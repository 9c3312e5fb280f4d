"""The success rate, on a seeded subset of what `ff-planner-benchmark bench` measures."""

from dataclasses import replace

import pytest

from ff_planner_benchmark.bench import measurement, success
from ff_planner_benchmark.bench.success import attempt, attempts
from ff_planner_ros.errors import Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.problems.scenarios import scenario

SETTINGS = load_parameters().planner


@pytest.mark.law("PLAN-33")
@pytest.mark.ci
@pytest.mark.parametrize(("kind", "missed_at_night"), [("ordinary", 0), ("cluttered", 1)])
def test_where_there_is_a_plan_it_is_found(kind, missed_at_night, times):
    tried = list(attempts(kind, times(10, 24), SETTINGS))
    misses = [one for one in tried if not one.solved]
    assert len(misses) <= times(0, missed_at_night), misses


def test_half_of_the_scenarios_are_turned_and_each_robot_has_half(monkeypatch):
    monkeypatch.setattr(success, "attempt", lambda *arguments: arguments)
    tried = [arguments[:4] for arguments in attempts("ordinary", 8, SETTINGS)]
    assert len(set(tried)) == 8
    assert sum(turned for *_, turned in tried) == 4
    assert sum(robot == "lemur" for _, robot, *_ in tried) == 4
    assert {number for _, _, number, _ in tried} == {0, 1}


def test_a_plan_that_the_planner_gave_but_the_check_refuses_is_a_miss(monkeypatch):
    """Whatever the planner says of its plan, the obstacles of the scenario decide."""
    drawn = scenario("ordinary", "lemur", 0, turned=False).problem
    free = measurement.plan(replace(drawn, obstacles=()), SETTINGS)
    monkeypatch.setattr(measurement, "plan", lambda *_: free)
    tried = attempt("ordinary", "lemur", 0, False, SETTINGS)
    assert tried.status is Status.COLLISION
    assert not tried.solved
