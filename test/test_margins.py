"""Margins change with errors as their derivatives say, and the least of them counts."""

from __future__ import annotations

import numpy as np
import pytest

from ff_planner_ros.planning.robust.margins import Margins, _both_ways

BY_ERRORS = np.array([[3.0, 4.0], [-1.0, 0.0]])


def test_the_deviation_of_a_margin_is_the_root_of_the_sum_of_squares() -> None:
    rows = np.zeros(2, np.intp)
    found = Margins("torque", np.array([1.0, 2.0]), BY_ERRORS, rows, np.zeros(2))
    assert found.sigmas.tolist() == [5.0, 1.0]


@pytest.mark.parametrize(
    ("errors", "least"),
    [([0.0, 0.0], 1.0), ([1.0, 0.0], 1.0), ([-1.0, 0.0], -2.0), ([0.5, -1.0], -1.5)],
)
def test_the_least_margin_of_a_run_is_that_of_all_with_its_errors(
    errors: list[float], least: float
) -> None:
    rows = np.zeros(2, np.intp)
    found = Margins("torque", np.array([1.0, 2.0]), BY_ERRORS, rows, np.zeros(2))
    assert found.least(np.array([errors, [9.0, 9.0]]))[0] == pytest.approx(least)


def test_what_is_limited_both_ways_has_a_margin_to_either_side() -> None:
    """A value that grows comes nearer to its upper limit, and leaves the lower one."""
    values, by_errors = np.array([[0.5, -0.8]]), np.array([[[1.0], [2.0]]])
    limits, which, time = np.array([1.0, 2.0]), np.array([4, 6]), np.array([0.7])
    found = _both_ways("torque", values, by_errors, limits, which, time)
    rows = zip(found.which, found.values, found.by_errors[:, 0], found.time, strict=True)
    assert sorted(tuple(map(float, row)) for row in rows) == [
        (4.0, 0.5, -1.0, 0.7),
        (4.0, 1.5, 1.0, 0.7),
        (6.0, 1.2, 2.0, 0.7),
        (6.0, pytest.approx(2.8), -2.0, 0.7),
    ]
