"""How distances change with the times at which they are looked at: against differences.

Where the duration is a variable, spheres that move are elsewhere at the same part of the motion.
"""

from __future__ import annotations

import numpy as np
import pytest
from bodied_robots import random_robot, tumbling_spheres
from core_rows import CoreRows, distances_of_core
from dense_motion import centers_of, to_lines
from test_body_distances import configurations
from test_core import chain_robot

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.clearance import arm_points, segments
from ff_planner_ros.planning.problem.problem import Obstacle

STEP, POINTS, FAR = 1e-5, 8, 1e3
TIMES = np.linspace(0.0, 2.5, POINTS) + 0.2
LATER = TIMES / TIMES[-1]  # each, in parts of what the last one is


def spheres_near(place: Array, seed: int) -> tuple[Obstacle, ...]:
    """Three on a body that drifts and tumbles, one that flies, one that rests."""
    rng = np.random.default_rng(seed)
    flying = Obstacle.sphere("flying", place + rng.normal(size=3), 0.1, 0.4 * rng.normal(size=3))
    resting = Obstacle.sphere("resting", place + rng.normal(size=3), 0.1)
    return (flying, *tumbling_spheres(rng, place, 3), resting)


@pytest.mark.parametrize("seed", [1, 2, 3, 40])
def test_distances_of_lines_change_with_their_times_as_their_differences(seed: int) -> None:
    robot = chain_robot("free6")
    q = configurations(robot, POINTS, seed)
    spheres = spheres_near(arm_points(robot, q)[0, 3], seed)

    def rows(times: Array, lasting: bool = False) -> CoreRows:
        return distances_of_core(robot, q, times, spheres, FAR, lasting=lasting)

    found = rows(TIMES, lasting=True)
    ahead, behind = (rows(TIMES + way * LATER) for way in (STEP, -STEP))
    assert (ahead.names == found.names).all()
    expected = (ahead.values - behind.values) / (2 * STEP)
    assert found.jacobian[:, -1] == pytest.approx(expected, abs=1e-6)
    assert np.abs(expected).max() > 0.1
    resting = found.names % len(spheres) == len(spheres) - 1
    assert resting.any()
    assert not found.jacobian[resting, -1].any()


@pytest.mark.parametrize("seed", [1, 2, 3, 40])
def test_spheres_on_a_body_that_has_tumbled_for_long_are_where_they_are(seed: int) -> None:
    """Of a body that nobody has asked before where it is: up to the last of the times."""
    robot, times = chain_robot("free6"), np.linspace(5.0, 90.0, POINTS)
    q = configurations(robot, POINTS, seed)
    spheres = spheres_near(arm_points(robot, q)[0, 3], seed)
    distances, _, names, *_ = distances_of_core(robot, q, times, spheres, FAR)
    assert len(names) == POINTS * len(segments(arm_points(robot, q))) * len(spheres)
    nearest = distances[np.argsort(names)].reshape(POINTS, -1, len(spheres)).min(axis=1)
    for number, sphere in enumerate(spheres):
        expected = to_lines(arm_points(robot, q), centers_of(sphere, times)) - sphere.radius
        assert nearest[:, number] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("seed", [1, 2, 3, 40])
def test_distances_of_bodies_change_with_their_times_as_their_differences(seed: int) -> None:
    robot = random_robot(seed)
    q = configurations(robot, POINTS, seed)
    q[:, :3] = q[0, :3]
    spheres = spheres_near(q[0, :3], seed)

    def rows(times: Array) -> tuple[dict[int, float], dict[int, float]]:
        found = distances_of_core(robot, q, times, spheres, FAR, lasting=True)
        names, later = found.names.tolist(), found.jacobian[:, -1].tolist()
        return dict(zip(names, found.values.tolist(), strict=True)), dict(
            zip(names, later, strict=True)
        )

    _, jacobian = rows(TIMES)
    (ahead, _), (behind, _) = (rows(TIMES + way * LATER) for way in (STEP, -STEP))
    common = sorted(jacobian.keys() & ahead.keys() & behind.keys())
    assert len(common) > 0.9 * POINTS * len(robot.bodies) * len(spheres)
    expected = np.array([(ahead[k] - behind[k]) / (2 * STEP) for k in common])
    found = np.array([jacobian[k] for k in common])
    # Where a nearest point jumps there is no derivative: hardly ever.
    assert np.mean(np.abs(found - expected) > 2e-3) < 0.01
    assert np.median(np.abs(found - expected)) < 1e-7
    assert np.abs(expected).max() > 0.1
