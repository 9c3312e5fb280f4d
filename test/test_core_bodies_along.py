"""The configurations of a path at which distances of bodies are evaluated."""

from __future__ import annotations

import numpy as np
import pytest
from bodied_robots import random_robot
from core_rows import rows_along
from near_bodies import sphere_distances
from reference_distance_rows import in_order, with_quarters
from test_body_distances import dense_rows, every_row, require_rows, spheres_around

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import bodies_of, obstacles_of
from ff_planner_ros.planning.distance.bodies import centers_in_base, placed_bodies
from ff_planner_ros.planning.distance.body_distances import obstacle_gradients
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.planning.requirements.body_rows import FEW_POINTS, times_looked_at

GAPS, DURATION = 6, 2.4
STEP = DURATION / GAPS
FAR = 1e3


@pytest.mark.parametrize("seed", [1, 2, 3, 40])
def test_a_quarter_of_the_way_is_that_of_the_parabola(seed: int) -> None:
    """In order of time, and whatever the signs of quaternions, of which two are one attitude."""
    robot, rng = random_robot(seed), np.random.default_rng(seed)
    drawn = rng.normal(size=(3, 7 + robot.joints))

    def parabolas(times: Array) -> Array:
        return times[:, None] ** np.arange(3) @ drawn

    q = parabolas(STEP / 2 * np.arange(2 * GAPS + 1))
    # Near half a turn from the path that is corrected: there the sign changes.
    q[:, 3:7] = [1.0, 0.0, 0.0, 0.0] + 0.05 * rng.normal(size=(len(q), 4))
    q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1)[:, None]
    (centers,), radii = spheres_around(robot, q[:1], 4, rng)
    spheres = [
        Obstacle.sphere(str(k), *one) for k, one in enumerate(zip(centers, radii, strict=True))
    ]
    room, times = np.zeros(4 * len(robot.bodies)), times_looked_at(DURATION, GAPS + 1)
    asked = compiled.bodies_clear(
        bodies_of(robot), obstacles_of(spheres, DURATION), 0.0, room, times, FAR, True, None
    )
    found = rows_along(robot, [asked], q[::2], q[1::2])
    assert len(np.unique(np.sign(found.q[:, 3]))) == 2
    there = in_order(found.q, quarter_way=True)
    np.testing.assert_allclose(there[:, 7:], parabolas(times)[:, 7:], rtol=0.0, atol=1e-12)
    order = np.append(np.arange(GAPS) + 0.5, np.arange(GAPS)).argsort()
    by_x = with_quarters(found.q_by_x[order])
    rows, placed = every_row(len(there), len(robot.bodies), 4), placed_bodies(robot, there[:, 7:])
    seen = centers_in_base(there, np.tile(centers, (len(there), 1, 1)))
    truth = sphere_distances(robot, placed, seen, radii, rows)
    gradients = obstacle_gradients(robot, placed, truth, rows)
    require_rows(found, truth.distance, dense_rows(gradients, by_x, rows[0]), FAR, f"seed {seed}")


@pytest.mark.parametrize("points", [GAPS + 1, FEW_POINTS - 1, FEW_POINTS])
def test_times_are_those_of_points_of_what_is_half_way_and_of_quarters(points: int) -> None:
    step, numbers = DURATION / (points - 1), np.arange(1.0, points)
    expected = [numbers, numbers - 0.5]
    if points < FEW_POINTS:
        expected += [numbers[1:] - 0.75, numbers[1:] - 0.25]
    found = times_looked_at(DURATION, points)
    np.testing.assert_allclose(
        found, step * np.sort(np.concatenate(expected)), rtol=0.0, atol=1e-12
    )
    assert found.max() == DURATION
