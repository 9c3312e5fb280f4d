"""Planning time over numbers of spheres, points, joints and cores."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import islice

import numpy as np

from ff_planner_benchmark.bench import columns
from ff_planner_benchmark.bench.experiment import Experiment, Row, timed_plans
from ff_planner_benchmark.bench.least_attitude import BEST_KNOWN, least_attitude
from ff_planner_benchmark.problems.classes import ALL_FEATURES
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.share import share_directory
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.planning.distance.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.problem.problem import (
    Obstacle,
    PlanningProblem,
)
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.drawn import first_sound
from ff_planner_ros.problems.scenarios import scenario

_CORES = os.sched_getaffinity(0)  # of the machine: a run is pinned to one of them
# Added spheres fill a cube of this size around the chaser [m], this far from the arm on its way.
CUBE, APART = 8.0, 0.05


def shipped(name: str) -> PlanningProblem:
    """Return the problem of a scenario file of the package."""
    return load_scenario(share_directory() / "config" / "scenarios" / f"{name}.yaml")


def _growth(
    of: str,
    sized: Iterable[tuple[int, Sequence[PlanningProblem]]],
    settings: PlannerSettings,
    warm_up: int = 1,
) -> Iterator[Row]:
    """Yield the median time of each size's problems, and its ratio to that of the first size."""
    first = None
    for place, (size, problems) in enumerate(sized):
        row: Row = {"of": of, "size": size, "seconds": None, "rollouts": None, "ratio": None}
        with suppress(NoPlanFound):
            plans, seconds = timed_plans(problems, settings, warm_up)
            first = first if place else seconds
            row |= {"seconds": seconds, "ratio": seconds / first if first else None}
            row["rollouts"] = statistics.median(one.solver.rollouts for one in plans)
        yield row


def repeated(problem: PlanningProblem, count: int) -> list[PlanningProblem]:
    """Return a problem once to warm up, and for each timed run."""
    return [problem] * (1 + _runs(count))


def _runs(count: int) -> int:
    return 1 if count == 1 else 5


def _with_spheres(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Time the paper's capture as spheres clear of the plan are added."""
    problem, rng = shipped("lemur_capture"), np.random.default_rng(0)
    q, times = flown(problem, settings)
    positions, spheres = arm_points(problem.robot, q), list(problem.obstacles)

    def draw() -> Obstacle | None:
        center, radius = rng.uniform(-CUBE / 2, CUBE / 2, 3), rng.uniform(0.05, 0.2)
        sphere = Obstacle.sphere(f"s{len(spheres)}", center, radius)
        away = clearances(positions, times, segments(positions), [sphere]).distance.min()
        return sphere if away > APART else None

    def sized() -> Iterator[tuple[int, Sequence[PlanningProblem]]]:
        for size in (3, 30) if count == 1 else (3, 30, 100, 1000):
            while len(spheres) < size:
                spheres.append(first_sound("sphere", problem.robot.model.name, draw))
            yield size, repeated(replace(problem, obstacles=tuple(spheres)), count)

    yield from _growth("spheres", sized(), settings)


def _with_points(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Time the paper's capture over numbers of points."""
    problem, sizes = shipped("lemur_capture"), (50, 100) if count == 1 else (50, 100, 200, 500)
    sized = ((size, repeated(replace(problem, points=size), count)) for size in sizes)
    yield from _growth("points", sized, settings)


def _with_joints(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Time arms with numbers of joints, each on so many ordinary scenarios."""
    sized = (
        (size, [scenario("ordinary", f"arm{size}", n, turned=False).problem for n in range(count)])
        for size in ((7, 6) if count == 1 else (7, 6, 9))
    )
    yield from _growth("joints", sized, settings, warm_up=0)


SCALING = tuple(
    Experiment(
        "scaling",
        f"Time grows with {title}",
        rows,
        {title.partition(":")[0]: "size"},
        {
            f"time / {first}": columns.value("ratio", max, ".2f"),
            "time [s]": columns.value("seconds", max),
            "rollouts": columns.value("rollouts", max, "g"),
        },
        most=20,
    )
    for title, rows, first in (
        ("spheres: the paper's capture, more that leave the plan as it is", _with_spheres, 3),
        ("points: the paper's capture", _with_points, 50),
        ("joints: arms on ordinary scenarios, medians", _with_joints, 7),
    )
)


def flown(problem: PlanningProblem, settings: PlannerSettings) -> tuple[Array, Array]:
    """Return configurations and times of a plan."""
    motion = perform(PlanningTask(problem, settings)).trajectory
    return from_trajectory(problem.robot, motion)[0], motion.time


def _on_cores(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Plan in one, two and four processes, if the machine has as many cores."""
    kinds = {
        "least attitude": [least_attitude(*key) for key in islice(BEST_KNOWN, count)],
        # Not the first one, which takes twenty times the median.
        "all features": [ALL_FEATURES.draw(one).problem for one in range(1, 1 + count)],
    }
    own = os.sched_getaffinity(0)
    os.sched_setaffinity(0, _CORES)
    try:
        for search, problems in kinds.items():
            for processes in (one for one in (1, 2, 4) if one <= len(_CORES)):
                for problem in problems:
                    task = PlanningTask(problem, replace(settings, threads=processes))
                    begun = time.perf_counter()
                    with suppress(NoPlanFound):
                        perform(task)
                    seconds = time.perf_counter() - begun
                    yield {"search": search, "processes": processes, "seconds": seconds}
    finally:
        os.sched_setaffinity(0, own)


SEVERAL_CORES = Experiment(
    "several cores",
    "Searches on several cores",
    _on_cores,
    {"search": "search", "processes": "processes"},
    {
        "scenarios": columns.count,
        "wall clock, median [s]": columns.value("seconds", form=".2f"),
        "90 % [s]": columns.value("seconds", columns.quantile_90, ".2f"),
        "worst [s]": columns.value("seconds", max, ".2f"),
    },
    most=len(BEST_KNOWN),
)
