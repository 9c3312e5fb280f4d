"""The check's certificates and those of the search: they share no bound, and say the same."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import moving_pairs, random_obstacles, random_robot, tumbling_spheres
from robots import random_state
from straight_arms import told
from test_core import FREE, PLANAR, SLIDING, chain_robot

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.distance.body_certificate import (
    least_obstacle_distance,
    least_pair_distance,
)
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.distance.search_certificate import (
    search_distance,
    search_pair_distance,
)
from ff_planner_ros.planning.distance.surroundings import surroundings
from ff_planner_ros.planning.motion.certified_least import Least
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.problem.obstacles import Obstacle, RigidMotion
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot

# Of check and search [m]: the search bounds no accelerations, and so needs more pieces.
GAP, SEARCH_GAP = 1e-4, 5e-4
# What touches is not certified so closely [m].
APART = 1e-3
# They differ by less than the gap of either [m]: both are below the truth.
CLOSE = max(GAP, SEARCH_GAP)
LINES = ["free3", "free7", "planar3", "sliding4", "sliding7"]
assert {*LINES} <= {*FREE, *PLANAR, *SLIDING}
# From 20 on two joints of these slide.
SHAPES = [*[0, 1, 2, 3, 20, 21, 22], 40]
# Steps of the robot from point to point [rad, m]: where it rests, obstacles alone move.
SIZES = [0.0, 0.1, 0.4]


def drawn_motion(robot: Robot, rng: np.random.Generator, size: float) -> FollowedMotion:
    """Few points that are far from each other, with velocities that have to do with nothing."""
    q, _ = configuration(robot, random_state(robot, rng))
    held = np.ones(robot.model.nv)
    held[:6] = np.isin(np.arange(6), robot.base.rows)
    rows = [q]
    for _ in range(3):
        rows.append(pin.integrate(robot.model, rows[-1], size * held * rng.normal(size=len(held))))
    every, v = np.array(rows), size * held * rng.normal(size=(4, len(held)))
    times = np.cumsum([0.0, *rng.uniform(0.2, 2.0, 3)])
    return told(times, every[:, 7:], v[:, 6:], every[:, :7], v[:, :6])


def in_the_way(robot: Robot, motion: FollowedMotion, rng: np.random.Generator) -> list[Obstacle]:
    """Obstacles of all kinds and motions near the end effector, but not around it."""
    tip = arm_points(robot, motion.q)[1, -1]
    away = rng.normal(size=3)
    around = tip + 1.5 * away / np.linalg.norm(away)
    of_any_shape = random_obstacles(rng, around, 5)
    spheres = [replace(one, id=f"ball {one.id}") for one in tumbling_spheres(rng, around, 2)]
    return [*of_any_shape, *spheres, *passing(around, motion.time[-1], rng)]


def passing(around: Array, end: float, rng: np.random.Generator) -> list[Obstacle]:
    """A sphere that flies past a place between two points, and a rod that turns where it is."""
    velocity, upright = 2.0 * rng.normal(size=3), [0.0, 0.0, 0.0, 1.0]
    place = around - rng.uniform(0.1, 0.9) * end * velocity
    ball, rod = Solid("sphere", np.array([0.1])), Solid("box", np.array([1.2, 0.1, 0.1]))
    flying = RigidMotion(place, upright, velocity)
    turning = RigidMotion(
        around + 0.5 * rng.normal(size=3), upright, angular_velocity=2.0 * rng.normal(size=3)
    )
    return [Obstacle("flies", ball, flying), Obstacle("turns", rod, turning)]


def off(check: Sequence[Least], search: Callable[[Indices], float]) -> Array:
    """What both certify of each distance, by its number, differs by so much; of those apart [m]."""
    chosen = [number for number, least in enumerate(check) if least.found > APART]
    assert chosen
    return np.array([check[k].certified - search(np.array([k])) for k in chosen])


def off_obstacles(robot: Robot, motion: FollowedMotion, obstacles: list[Obstacle]) -> Array:
    """As of `off`, of all bodies and obstacles."""
    robot, last = with_bodies(robot), len(motion.time) - 1
    around = surroundings(tuple(obstacles))
    check = [
        least_obstacle_distance(robot, motion, around, np.array([number]), last, GAP)
        for number in range(len(robot.bodies) * len(obstacles))
    ]
    return off(
        check, lambda one: search_distance(robot, motion, obstacles, one, last, 0.0, SEARCH_GAP)
    )


@pytest.mark.sampled
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(("of", "seed"), [*itertools.product(LINES, range(2))])
def test_both_sides_certify_the_same_clearance_of_lines(of: str, seed: int, size: float) -> None:
    robot, rng = chain_robot(of), np.random.default_rng(seed)
    motion = drawn_motion(robot, rng, size)
    assert np.abs(off_obstacles(robot, motion, in_the_way(robot, motion, rng))).max() < CLOSE


@pytest.mark.sampled
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("seed", SHAPES)
def test_both_sides_certify_the_same_clearance_of_bodies(seed: int, size: float) -> None:
    robot, rng = random_robot(seed), np.random.default_rng(seed)
    motion = drawn_motion(robot, rng, size)
    assert np.abs(off_obstacles(robot, motion, in_the_way(robot, motion, rng))).max() < CLOSE


@pytest.mark.sampled
@pytest.mark.parametrize("size", [0.1, 0.4])
@pytest.mark.parametrize("seed", SHAPES)
def test_both_sides_certify_the_same_distance_between_bodies(seed: int, size: float) -> None:
    robot = random_robot(seed)
    robot = replace(robot, pairs=tuple(moving_pairs(robot)))
    motion = drawn_motion(robot, np.random.default_rng(seed), size)
    last = len(motion.time) - 1
    check = [
        least_pair_distance(robot, motion, np.array([number]), last)
        for number in range(len(robot.pairs))
    ]
    differ = off(check, lambda one: search_pair_distance(robot, motion, one, last, 0.0))
    assert np.abs(differ).max() < CLOSE
