"""The configurations of a path at which distances of bodies are evaluated."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from bodied_robots import random_robot

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import bodies_of, chain_of
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.requirements.body_rows import FEW_POINTS, times_looked_at

GAPS, DURATION = 6, 2.4
STEP = DURATION / GAPS
AT_POINTS = STEP * np.arange(1, GAPS + 1)


class Parabolas(NamedTuple):
    """Entries of configurations, and of their derivatives, that are parabolas of the time."""

    q: Array  # shape (3, 7 + joints); quaternions of any length
    by_x: Array  # shape (3, 6 + joints, variables)

    def at(self, times: Array) -> tuple[Array, Array]:
        powers = times[:, None] ** np.arange(3)
        return powers @ self.q, np.einsum("tp,pjx->tjx", powers, self.by_x)


def drawn(joints: int) -> Parabolas:
    rng = np.random.default_rng(joints)
    q = rng.normal(size=(3, 7 + joints))
    q[:, 3:7] *= 0.05
    q[0, 6] = 1.0
    return Parabolas(q, rng.normal(size=(3, 6 + joints, 4)))


def along(parabolas: Parabolas, signs: Array, quarter_way: bool) -> compiled.BodiesAlong:
    """Return the bodies along parabolas; signs: of the quaternions, at points, then half-way."""
    robot = random_robot(1)
    q, by_x = parabolas.at(np.append(AT_POINTS, AT_POINTS - STEP / 2))
    q[:, 3:7] *= signs[:, None]
    return compiled.BodiesAlong(
        chain_of(robot),
        bodies_of(robot),
        q[:GAPS],
        by_x[:GAPS],
        q[GAPS:],
        by_x[GAPS:],
        quarter_way,
    )


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_quarter_of_the_way_is_that_of_the_parabola(seed: int) -> None:
    """Whatever the signs of quaternions, of which two are one attitude."""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], 2 * GAPS)
    assert len(np.unique(signs)) == 2
    parabolas = drawn(random_robot(1).joints)
    found = along(parabolas, signs, quarter_way=True)
    times = STEP * np.append(0.5, np.arange(4, 4 * GAPS + 1) / 4)
    q, by_x = parabolas.at(times)
    q[:, 3:7] /= signs[GAPS] * np.linalg.norm(q[:, 3:7], axis=1)[:, None]
    np.testing.assert_allclose(found.q, q, rtol=0.0, atol=1e-12)
    assert found.tips == pytest.approx(arm_points(random_robot(1), found.q)[:, -1], abs=1e-12)
    np.testing.assert_allclose(found.q_sensitivity, by_x, rtol=0.0, atol=1e-12)


def test_what_is_given_is_in_order_of_time_and_as_it_is_given() -> None:
    parabolas, signs = drawn(random_robot(1).joints), np.resize([1.0, -1.0, -1.0], 2 * GAPS)
    found = along(parabolas, signs, quarter_way=False)
    times = np.append(AT_POINTS, AT_POINTS - STEP / 2)
    q, by_x = parabolas.at(times)
    q[:, 3:7] *= signs[:, None]
    assert (found.q == q[times.argsort()]).all()
    assert (found.q_sensitivity == by_x[times.argsort()]).all()


@pytest.mark.parametrize("points", [GAPS + 1, FEW_POINTS - 1, FEW_POINTS])
def test_times_are_those_of_points_of_what_is_half_way_and_of_quarters(points: int) -> None:
    step, numbers = DURATION / (points - 1), np.arange(1.0, points)
    expected = [numbers, numbers - 0.5]
    if points < FEW_POINTS:
        expected += [numbers[1:] - 0.75, numbers[1:] - 0.25]
    found = times_looked_at(DURATION, points)
    np.testing.assert_allclose(found, step * np.concatenate(expected), rtol=0.0, atol=1e-12)
    assert found.max() == DURATION


def test_quarters_without_what_is_half_way_are_refused() -> None:
    robot = random_robot(1)
    q, by_x = drawn(robot.joints).at(AT_POINTS)
    with pytest.raises(ValueError, match="q_half_way has none, and quarter_way is asked for"):
        compiled.BodiesAlong(chain_of(robot), bodies_of(robot), q, by_x, quarter_way=True)
