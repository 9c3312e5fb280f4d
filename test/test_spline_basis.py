"""The quintic B-splines of joint splines are those of scipy, and so are all their derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from ff_planner_ros.planning.paths.spline_basis import DEGREE, SplineBasis

DURATION = 3.7  # [s]


@pytest.mark.parametrize("order", range(DEGREE + 1))
@pytest.mark.parametrize("spans", [1, 2, 7, 30])
def test_rows_are_those_of_scipy_at_knots_and_between_them(spans: int, order: int) -> None:
    basis = SplineBasis(DURATION, spans)
    times = np.concatenate([basis.knots, np.random.default_rng(spans).uniform(size=50)])
    splines = BSpline(basis.knots, np.eye(basis.count), DEGREE)
    truth = splines(times, nu=order) / DURATION**order
    found = basis.rows(times, order)
    np.testing.assert_allclose(found, truth, rtol=1e-13, atol=1e-13 * np.abs(truth).max())
