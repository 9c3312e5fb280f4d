"""The benchmark's table of plans after equal times counts what was found until then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ff_planner_benchmark.bench.direct import Stop
from ff_planner_benchmark.bench.experiment import Row
from ff_planner_benchmark.bench.least_attitude import (
    EQUAL_TIME,
    STEADINESS,
    Found,
    _checked_attitude,
    best_until,
    least_attitude,
)
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.system_frame import in_own_frame
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths

PLANS: Found = [(0.05, 0.4), (0.3, 0.2), (0.4, 0.3)]


def found(method: str, at: float, *plans: tuple[float, float]) -> Row:
    return {"method": method} | best_until(list(plans), at, 0.1)


def test_only_plans_until_a_time_count_and_the_best_of_them() -> None:
    for at, count, attitude in ((0.01, 0, None), (0.1, 1, 0.4), (1.0, 3, 0.2)):
        row = best_until(PLANS, at, 0.1)
        assert (row["plans"], row["steadiest"]) == (count, attitude)


def test_the_cells_of_a_time_say_how_many_have_a_plan_and_how_near_to_the_best() -> None:
    after, _ = EQUAL_TIME
    rows = [
        row
        for at in (0.1, 1.0)
        for row in (
            found("ours", at, (0.05, 0.4), (0.3, 0.2)),
            found("ours", at, (0.2, 0.1)),
            found("SLSQP", at),
            found("SLSQP", at, (0.1, 0.15)),
        )
    ]
    assert after.table(rows).rows == [
        ("0.1", "2", "1", "0", "4.00", "1", "1.50", "0", "-"),
        ("1", "2", "2", "1", "1.50", "1", "1.50", "0", "-"),
    ]


def test_a_group_without_a_plan_has_no_ratios() -> None:
    missed = {"depth": "quick", "seconds": 2.0, "shortest": None, "steadiest": None}
    (row,) = STEADINESS.table([missed | {"of_best": None}]).rows
    assert row == ("quick", "1", "0", "0", "0", "-", "-", "2.00", "2.00")


def test_a_path_of_another_method_counts_only_if_it_passes_the_check() -> None:
    """The straight path of a scenario hits a sphere; without spheres it is a plan."""
    settings = load_parameters().planner
    problem = in_own_frame(least_attitude("ordinary", "lemur", 4))
    stop = Stop(np.zeros(18), 1, "straight")
    attitudes = [
        _checked_attitude(path_program(one, end_effector_paths(one), settings), settings, stop)
        for one in (problem, replace(problem, obstacles=()))
    ]
    assert attitudes[0] is None
    assert attitudes[1] is not None
    assert attitudes[1] > 0.0
