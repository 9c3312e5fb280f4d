"""How the planner's time grows with spheres, points and joints."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ff_planner_ros.bench.methods import timed_plan
from ff_planner_ros.bench.scenarios import scenario
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.planning.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.motion import from_trajectory
from ff_planner_ros.planning.planner import plan
from ff_planner_ros.planning.problem import PlanningProblem, Sphere
from ff_planner_ros.planning.settings import PlannerSettings

# Added spheres fill a cube of this size around the chaser [m], this far from the arm on its way.
_CUBE, _APART = 8.0, 0.05


@dataclass(frozen=True)
class Growth:
    """Time at one size."""

    of: str  # what grows: spheres, points or joints
    size: int
    seconds: float  # median time of a plan
    rollouts: float  # median


def with_spheres(
    problem: PlanningProblem, settings: PlannerSettings, sizes: Sequence[int], runs: int
) -> Iterator[Growth]:
    """Yield the times with more and more spheres that leave the answer as it is.

    Args:
        sizes: Numbers of spheres, not fewer than the problem has.
    """
    q, _ = from_trajectory(problem.robot, plan(problem, settings).trajectory)
    positions = arm_points(problem.robot, q)
    rng = np.random.default_rng(0)
    spheres = list(problem.obstacles)
    for size in sizes:
        while len(spheres) < size:
            center, radius = rng.uniform(-_CUBE / 2, _CUBE / 2, 3), rng.uniform(0.05, 0.2)
            sphere = Sphere(f"s{len(spheres)}", center, radius)
            if clearances(positions, segments(positions), [sphere]).distance.min() > _APART:
                spheres.append(sphere)
        yield _growth("spheres", size, replace(problem, obstacles=tuple(spheres)), settings, runs)


def with_points(
    problem: PlanningProblem, settings: PlannerSettings, sizes: Sequence[int], runs: int
) -> Iterator[Growth]:
    """Yield the times with more and more points."""
    for size in sizes:
        yield _growth("points", size, replace(problem, points=size), settings, runs)


def with_joints(settings: PlannerSettings, sizes: Sequence[int], count: int) -> Iterator[Growth]:
    """Yield the times of arms with more and more joints on ordinary scenarios.

    Args:
        count: Scenarios for each; those that are not solved do not count.
    """
    for size in sizes:
        seconds, rollouts = [], []
        for number in range(count):
            problem = scenario("ordinary", f"arm{size}", number, turned=False).problem
            begun = time.perf_counter()
            try:
                rollouts.append(plan(problem, settings).solver.rollouts)
            except NoPlanFound:
                continue
            seconds.append(time.perf_counter() - begun)
        yield Growth("joints", size, statistics.median(seconds), statistics.median(rollouts))


def _growth(
    of: str, size: int, problem: PlanningProblem, settings: PlannerSettings, runs: int
) -> Growth:
    answer, seconds = timed_plan(problem, settings, runs)
    return Growth(of, size, seconds, answer.solver.rollouts)
