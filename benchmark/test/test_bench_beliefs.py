"""What becomes of plans that misjudge the chaser, on a seeded subset of the benchmark."""

import numpy as np
import pytest

from ff_planner_benchmark.bench import executed
from ff_planner_benchmark.bench.executed import BELIEFS, EXECUTIONS
from ff_planner_benchmark.problems.classes import SCENARIOS
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters

SETTINGS = load_parameters().planner


def believed(kind):
    """Return the first scenario of a class under each belief."""
    (one,) = (one for one in SCENARIOS if one.name == kind)
    return {row["belief"]: row for row in executed._believed(one, 0, SETTINGS)}


def test_only_a_plan_for_the_true_momentum_arrives_and_collides_with_nothing():
    done = believed("cluttered")
    right = done.pop("the true momentum")
    assert right["position_miss"] < 1e-5
    assert right["orientation_miss"] < 1e-5
    assert not right["collides"]
    for belief in ("zero momentum", "fixed base"):
        wrong = done[belief]
        assert wrong["status"] == "SOLVED"
        assert wrong["position_miss"] > 0.05
        assert wrong["collides"]


def test_a_fixed_base_plan_misses_by_another_way_where_nothing_drifts():
    done = believed("ordinary")
    drifting, reacting = (done[belief] for belief in ("fixed base", "fixed base, no drift"))
    assert reacting["position_miss"] > 0.01
    assert reacting["position_miss"] != drifting["position_miss"]


def test_the_table_counts_collisions_among_plans_and_tells_the_worst_miss():
    rows = []
    for kind in ("ordinary", "cluttered"):
        for robot in ("lemur", "arm6"):
            for belief in BELIEFS:
                row = {"kind": kind, "belief": belief, "status": "SOLVED"}
                row |= {"position_miss": 0.25 if robot == "lemur" else 0.5}
                row |= {"orientation_miss": np.deg2rad(3.0), "collides": robot == "lemur"}
                if (robot, belief) == ("arm6", "fixed base"):
                    row |= {"status": "SINGULAR", "collides": False}
                    row |= {"position_miss": None, "orientation_miss": None}
                rows.append(row)
    table = {row[:2]: row[2:] for row in EXECUTIONS.table(rows).rows}
    assert len(table) == 2 * len(BELIEFS)
    assert table["ordinary", "fixed base"] == (
        *("2", "1", "100%", "250.0", "250.0", "3.00", "3.00"),
    )
    assert table["cluttered", "zero momentum"] == (
        *("2", "2", "50%", "375.0", "500.0", "3.00", "3.00"),
    )


def test_a_class_without_a_plan_has_no_miss_to_tell(monkeypatch):
    def no_plan(*_):
        raise NoPlanFound(Status.SINGULAR, "the arm is stretched")

    monkeypatch.setattr(executed, "BELIEFS", dict.fromkeys(BELIEFS, no_plan))
    rows = list(EXECUTIONS.rows(1, SETTINGS))
    assert {row["status"] for row in rows} == {"SINGULAR"}
    assert {row["position_miss"] for row in rows} == {None}
    table = EXECUTIONS.table(rows)
    assert [row[2:] for row in table.rows] == 2 * len(BELIEFS) * [("1", "0", *"-----")]


@pytest.mark.parametrize("kind", ["ordinary", "cluttered"])
def test_the_robots_take_turns(kind):
    (one,) = (one for one in SCENARIOS if one.name == kind)
    drawn = [(one.robot(index), index // len(one.robots)) for index in range(4)]
    assert drawn == [("lemur", 0), ("arm6", 0), ("lemur", 1), ("arm6", 1)]
