"""What several threads measure is what one measures, to the last bit."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from statistics import median

import numpy as np
import pytest
from bodied_robots import random_obstacles, random_robot
from core_rows import distances_of_core
from test_body_distances import configurations

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.robot.model import Robot

POINTS, INTEREST = 100, 0.4
MOST_THREADS = 4  # of the core; with one core more, nothing changes
CORES = os.sched_getaffinity(0)


@contextmanager
def cores(count: int) -> Iterator[None]:
    """Let this process use some of its cores."""
    os.sched_setaffinity(0, sorted(CORES)[:count])
    try:
        yield
    finally:
        os.sched_setaffinity(0, CORES)


def crowded(seed: int, count: int) -> tuple[Robot, Array, tuple[Obstacle, ...]]:
    """Return a robot, configurations, and obstacles of all kinds among its bodies."""
    robot = random_robot(seed)
    q = configurations(robot, POINTS, seed)
    q[:, :3] *= 0.3
    rng = np.random.default_rng(seed)
    return robot, q, random_obstacles(rng, np.zeros(3), count)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("count", [3, 40, 400])
def test_any_number_of_threads_finds_the_same_rows(seed: int, count: int) -> None:
    robot, q, obstacles = crowded(seed, count)
    times = np.linspace(0.1, 3.0, POINTS)
    found = []
    for used in range(1, min(len(CORES), MOST_THREADS + 1) + 1):
        with cores(used):
            found.append(distances_of_core(robot, q, times, obstacles, INTEREST))
    for rows in found:
        for part, expected in zip(rows, found[0], strict=True):
            np.testing.assert_array_equal(part, expected)
    distances, _, names, *_ = found[0]
    at = names // (len(robot.bodies) * len(obstacles))
    assert (np.diff(at) >= 0).all()
    assert min((distances > 0.0).sum(), (distances < 0.0).sum()) > count


@pytest.mark.skipif(len(CORES) < 2, reason="there is one core")
def test_many_pairs_are_shared_and_few_are_not() -> None:
    """Else this thread takes all of the processor time that the process takes."""
    times = np.linspace(0.1, 3.0, POINTS)
    for count, is_shared in ((400, True), (1, False)):
        robot, q, obstacles = crowded(0, count)
        parts = []
        for _ in range(5):
            begun = time.process_time(), time.thread_time()
            distances_of_core(robot, q, times, obstacles, INTEREST)
            parts.append((time.thread_time() - begun[1]) / (time.process_time() - begun[0]))
        assert (median(parts) < 0.9) == is_shared, parts
