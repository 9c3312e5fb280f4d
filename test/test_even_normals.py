"""Evenly spread normal numbers: quantiles of a scrambled Halton sequence, as scipy has them."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import qmc

from ff_planner_ros.planning.paths.even_normals import even_normals


@pytest.mark.parametrize("components", [1, 6, 18, 28])
def test_they_are_those_of_scipy(components: int) -> None:
    engine = qmc.Halton(components, rng=np.random.default_rng(0))
    truth = qmc.MultivariateNormalQMC(np.zeros(components), engine=engine).random(500)
    found = np.array([*islice(even_normals(components), 500)])
    np.testing.assert_allclose(found, truth, rtol=1e-13, atol=1e-15)


def test_each_component_has_as_many_points_in_every_part_of_equal_probability() -> None:
    points = np.array([*islice(even_normals(3), 2 * 3 * 5)])
    for base, component in zip((2, 3, 5), points.T, strict=True):
        parts = np.floor(base * ndtr(component)).astype(int)
        assert (np.bincount(parts, minlength=base) == len(points) // base).all()


def test_they_are_the_same_every_time() -> None:
    first, again = (np.array([*islice(even_normals(4), 20)]) for _ in range(2))
    assert np.array_equal(first, again)
