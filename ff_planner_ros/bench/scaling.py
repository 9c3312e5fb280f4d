"""How the planner's time grows with spheres, points and joints."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ff_planner_ros.bench.measurement import Measurement, timed_plans
from ff_planner_ros.common.text_table import Table
from ff_planner_ros.planning.distance.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.problem.problem import PlanningProblem, Sphere
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.scenarios import scenario

# Added spheres fill a cube of this size around the chaser [m], this far from the arm on its way.
_CUBE, _APART = 8.0, 0.05


@dataclass(frozen=True)
class Growth:
    """Time at one size."""

    of: str  # what grows: spheres, points or joints
    size: int
    seconds: float  # median time of a plan
    rollouts: float  # median


def measurement(problem: PlanningProblem, settings: PlannerSettings, *, quick: bool) -> Measurement:
    """Measure the times of a problem and of arms; if quick, without the large sizes."""
    runs, count = (1, 1) if quick else (5, 20)
    spheres, points = ((3, 30), (50, 100)) if quick else ((3, 30, 100, 1000), (50, 100, 200, 500))
    joints = (7, 6) if quick else (7, 6, 9)
    growths = {
        "spheres: the paper's capture, more that leave the plan as it is": [
            *with_spheres(problem, settings, spheres, runs)
        ],
        "points: the paper's capture": [*with_points(problem, settings, points, runs)],
        f"joints: arms on {count} ordinary scenarios, medians": [
            *with_joints(settings, joints, count)
        ],
    }
    tables = [
        Table(
            f"Time grows with {name}",
            (growth[0].of, f"time / {growth[0].size}", "time [s]", "rollouts"),
            [
                (
                    f"{g.size}",
                    f"{g.seconds / growth[0].seconds:.2f}",
                    f"{g.seconds:.3f}",
                    f"{g.rollouts:g}",
                )
                for g in growth
            ],
        )
        for name, growth in growths.items()
    ]
    return Measurement([each for growth in growths.values() for each in growth], tables)


def with_spheres(
    problem: PlanningProblem, settings: PlannerSettings, sizes: Sequence[int], runs: int
) -> Iterator[Growth]:
    """Yield the times with more and more spheres than the problem has; the plan stays."""
    shortest = perform(PlanningTask(problem, settings))
    q, _ = from_trajectory(problem.robot, shortest.trajectory)
    positions = arm_points(problem.robot, q)
    rng = np.random.default_rng(0)
    spheres = list(problem.obstacles)
    for size in sizes:
        while len(spheres) < size:
            center, radius = rng.uniform(-_CUBE / 2, _CUBE / 2, 3), rng.uniform(0.05, 0.2)
            sphere = Sphere(f"s{len(spheres)}", center, radius)
            times = shortest.trajectory.time
            distance = clearances(positions, times, segments(positions), [sphere]).distance
            if distance.min() > _APART:
                spheres.append(sphere)
        crowded = replace(problem, obstacles=tuple(spheres))
        yield _growth("spheres", size, [crowded] * (1 + runs), settings, warm_up=1)


def with_points(
    problem: PlanningProblem, settings: PlannerSettings, sizes: Sequence[int], runs: int
) -> Iterator[Growth]:
    """Yield the times with more and more points."""
    for size in sizes:
        finer = replace(problem, points=size)
        yield _growth("points", size, [finer] * (1 + runs), settings, warm_up=1)


def with_joints(settings: PlannerSettings, sizes: Sequence[int], count: int) -> Iterator[Growth]:
    """Yield the times of arms with more and more joints, each on some ordinary scenarios."""
    for size in sizes:
        drawn = [scenario("ordinary", f"arm{size}", n, turned=False) for n in range(count)]
        yield _growth("joints", size, [each.problem for each in drawn], settings)


def _growth(
    of: str,
    size: int,
    problems: Iterable[PlanningProblem],
    settings: PlannerSettings,
    warm_up: int = 0,
) -> Growth:
    plans, seconds = timed_plans(problems, settings, warm_up)
    return Growth(of, size, seconds, statistics.median(plan.solver.rollouts for plan in plans))
