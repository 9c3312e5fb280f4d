"""What the certificate of clearance rests on: how far the arm moves, and how it bends."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import tumbling_spheres
from near_bodies import certified_clearance
from robots import random_state
from test_core import chain_robot

from ff_planner_benchmark.problems import tumbling as captures
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.body_certificate import CHECK_GAP
from ff_planner_ros.planning.distance.body_motion import cubics_between
from ff_planner_ros.planning.distance.clearance import arm_points, centers_at, clearances, segments
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot

DENSE = 400


def drawn_motion(robot: Robot, rng: np.random.Generator, size: float) -> tuple[Array, Array, Array]:
    """Configurations that are far from each other, and velocities that have to do with nothing."""
    q, _ = configuration(robot, random_state(robot, rng))
    ways = size * rng.normal(size=(4, robot.model.nv))
    rows = [q]
    for way in ways:
        rows.append(pin.integrate(robot.model, rows[-1], way))
    times = np.cumsum(rng.uniform(0.2, 2.0, 5))
    return np.array(rows), size * rng.normal(size=(5, robot.model.nv)), times


def between(robot: Robot, q: Array, cubics: Array) -> tuple[Array, Array]:
    """Parts of the way, and the configurations along each cubic. (cubics, parts, 7 + joints)."""
    part = np.linspace(0.0, 1.0, DENSE + 1)
    moved = np.einsum("sp,cpj->csj", part[:, None] ** np.array([1, 2, 3]), cubics)
    return part, np.array(
        [[pin.integrate(robot.model, q[c], way) for way in ways] for c, ways in enumerate(moved)]
    )


@pytest.mark.parametrize("seed", range(3))
def test_no_attached_sphere_accelerates_more_than_its_bound(seed: int) -> None:
    drawn = captures.problem("fast tumbling", seed)
    attached = [sphere for sphere in drawn.obstacles if sphere.body is not None]
    times = np.linspace(0.0, 60.0, 60_001)
    places = centers_at(times, attached)
    found = np.linalg.norm(np.diff(places, 2, axis=0), axis=2).max(axis=0) / times[1] ** 2
    bounds = np.array([sphere.motion.highest_acceleration(0.0) for sphere in attached])
    assert (found <= bounds + 1e-6).all()
    assert (found > 0.1 * bounds).any()
    resting = Obstacle.sphere("rock", [1.0, 0.0, 0.0], 0.1, [0.3, 0.0, 0.0])
    assert resting.motion.highest_acceleration(0.0) == 0.0


@pytest.mark.sampled
@pytest.mark.parametrize("name", ["free2", "free7", "planar3", "sliding1", "sliding4", "coupled8"])
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("pace", [1.0, 4.0])
def test_the_certificate_is_below_what_many_moments_show_and_near_to_it(
    name: str, seed: int, pace: float
) -> None:
    """Steps of up to eight seconds, spheres that move, tumble, are grazed, pierced and small."""
    robot, rng = chain_robot(name), np.random.default_rng(seed)
    q, v, times = drawn_motion(robot, rng, 0.3)
    v, times = v / pace, pace * times
    steps = np.diff(times)
    part, along = between(robot, q, cubics_between(robot, q, v, steps))
    moments = (times[:-1, None] + part * steps[:, None]).ravel()
    positions = arm_points(robot, along.reshape(-1, q.shape[1]))
    nearest = positions.reshape(-1, 3)[rng.integers(0, positions.size // 3, 4)]
    spheres = [
        Obstacle.sphere(
            str(k),
            place + away * rng.normal(size=3),
            rng.uniform(0.02, 0.3),
            rng.normal(scale=0.1 * k, size=3),
        )
        for k, (place, away) in enumerate(zip(nearest, (0.01, 0.2, 1.0, 3.0), strict=True))
    ]
    tumbling = list(tumbling_spheres(rng, nearest[0], 3))
    for chosen in (spheres, spheres[1:], spheres[2:], spheres[3:], tumbling, tumbling[:1]):
        found = certified_clearance(robot, q, v, times, chosen)
        distance = clearances(positions, moments, segments(positions), chosen).distance
        true = float(distance.min())
        # Between two moments the distance may be lower by what the arm moves in half of the time.
        room = float(np.abs(np.diff(distance.min(axis=(1, 2)))).max())
        assert true - CHECK_GAP - room <= found <= true + 1e-12
