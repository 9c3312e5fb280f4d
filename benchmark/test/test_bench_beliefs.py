"""What becomes of plans that misjudge the chaser, on a seeded subset of the benchmark."""

import numpy as np
import pytest

from ff_planner_benchmark.bench import beliefs
from ff_planner_benchmark.bench.beliefs import BELIEFS, belief_result
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters

SETTINGS = load_parameters().planner


def test_only_a_plan_for_the_true_momentum_arrives_and_collides_with_nothing():
    done = {
        belief: belief_result("cluttered", "lemur", 0, belief, SETTINGS)
        for belief in ("the true momentum", "zero momentum", "fixed base")
    }
    right = done.pop("the true momentum")
    assert right.position_miss < 1e-5
    assert right.orientation_miss < 1e-5
    assert not right.collides
    for wrong in done.values():
        assert wrong.status is Status.SOLVED
        assert wrong.position_miss > 0.05
        assert wrong.collides


def test_a_fixed_base_plan_misses_by_another_way_where_nothing_drifts():
    drifting, reacting = (
        belief_result("ordinary", "lemur", 0, belief, SETTINGS)
        for belief in ("fixed base", "fixed base, no drift")
    )
    assert reacting.position_miss > 0.01
    assert reacting.position_miss != drifting.position_miss


def test_the_table_counts_collisions_among_plans_and_tells_the_worst_miss(monkeypatch):
    def outcome(kind, robot, number, belief, _settings):
        if (robot, belief) == ("arm6", "fixed base"):
            return beliefs.BeliefResult(
                kind, robot, number, belief, Status.SINGULAR, None, None, False
            )
        miss = 0.25 if robot == "lemur" else 0.5
        return beliefs.BeliefResult(
            kind, robot, number, belief, Status.SOLVED, miss, np.deg2rad(3.0), robot == "lemur"
        )

    monkeypatch.setattr(beliefs, "belief_result", outcome)
    found = beliefs.measurement(2, SETTINGS)
    rows = {row[:2]: row[2:] for row in found.tables[0].rows}
    assert len(rows) == 2 * len(BELIEFS)
    assert rows["ordinary", "fixed base"] == (
        *("2", "1", "100%", "250.0", "250.0", "3.00", "3.00"),
    )
    assert rows["cluttered", "zero momentum"] == (
        *("2", "2", "50%", "375.0", "500.0", "3.00", "3.00"),
    )
    assert len(found.results) == 2 * 2 * len(BELIEFS)


def test_a_class_without_a_plan_has_no_miss_to_tell(monkeypatch):
    def no_plan(*_):
        raise NoPlanFound(Status.SINGULAR, "the arm is stretched")

    monkeypatch.setattr(beliefs, "BELIEFS", dict.fromkeys(BELIEFS, no_plan))
    found = beliefs.measurement(1, SETTINGS)
    assert {each.status for each in found.results} == {Status.SINGULAR}
    assert {each.position_miss for each in found.results} == {None}
    assert [row[2:] for row in found.tables[0].rows] == 2 * len(BELIEFS) * [("1", "0", *"-----")]


@pytest.mark.parametrize("kind", ["ordinary", "cluttered"])
def test_the_robots_take_turns(kind, monkeypatch):
    monkeypatch.setattr(beliefs, "belief_result", lambda *arguments: arguments)
    done = list(beliefs.belief_results(kind, 4, SETTINGS))
    assert {arguments[:3] for arguments in done} == {
        (kind, robot, number) for robot in ("lemur", "arm6") for number in (0, 1)
    }
    assert len(done) == 4 * len(BELIEFS)
