"""The benchmark's table of plans after equal times counts what was found until then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ff_planner_benchmark.bench.attitude import EqualTime, _checked_attitude, _qualities
from ff_planner_benchmark.bench.attitude import _least_attitude as least_attitude
from ff_planner_benchmark.bench.direct import Stop
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths


def found(method: str, *plans: tuple[float, float]) -> EqualTime:
    times, attitudes = zip(*plans, strict=True) if plans else ((), ())
    return EqualTime("ordinary", "lemur", 0, method, 0.1, times, attitudes)


def test_only_plans_until_a_time_count_and_the_best_of_them() -> None:
    one = found("ours", (0.05, 0.4), (0.3, 0.2), (0.4, 0.3))
    assert one.at(0.01) == (0, None)
    assert one.at(0.1) == (1, 0.4)
    assert one.at(1.0) == (3, 0.2)


def test_the_cells_of_a_time_say_how_many_have_a_plan_and_how_near_to_the_best() -> None:
    results = [
        found("ours", (0.05, 0.4), (0.3, 0.2)),
        found("ours", (0.2, 0.1)),
        found("SLSQP"),
        found("SLSQP", (0.1, 0.15)),
    ]
    assert list(_qualities(results, ["ours", "SLSQP"], 0.1)) == ["1", "0", "4.00", "1", "1.50"]
    assert list(_qualities(results, ["ours", "SLSQP"], 1.0)) == ["2", "1", "1.50", "1", "1.50"]


def test_a_path_of_another_method_counts_only_if_it_passes_the_check() -> None:
    """The straight path of a scenario hits a sphere; without spheres it is a plan."""
    settings = load_parameters().planner
    problem = least_attitude("ordinary", "lemur", 4)
    stop = Stop(np.zeros(18), 1, "straight")
    attitudes = [
        _checked_attitude(path_program(one, end_effector_paths(one), settings), settings, stop)
        for one in (problem, replace(problem, obstacles=()))
    ]
    assert attitudes[0] is None
    assert attitudes[1] is not None
    assert attitudes[1] > 0.0
