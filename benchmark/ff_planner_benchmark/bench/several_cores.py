"""Wall-clock time of searches that several processes share."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from ff_planner_benchmark.bench.attitude import BEST_KNOWN
from ff_planner_benchmark.bench.measurement import OBJECTIVES, Measurement
from ff_planner_benchmark.problems import all_features
from ff_planner_ros.common.text_table import Table
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.scenarios import scenario

_PROCESSES = (1, 2, 4)
_HEADER = ("search", "scenarios", "processes", "wall clock, median [s]", "90 % [s]", "worst [s]")


@dataclass(frozen=True)
class Shared:
    """Wall-clock times of one kind of search in several processes."""

    search: str
    processes: int
    seconds: tuple[float, ...]  # of each problem


def measurement(count: int, settings: PlannerSettings, cores: Set[int]) -> Measurement:
    """Plan problems in one, two and four processes, if there are as many cores.

    Args:
        count: Number of problems of each kind.
        cores: Those that this process may use; it goes back to its own at the end.
    """
    own = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)
    try:
        found = list(_shared(count, settings, [n for n in _PROCESSES if n <= len(cores)]))
    finally:
        os.sched_setaffinity(0, own)
    rows = [
        (
            *(each.search, f"{len(each.seconds)}", f"{each.processes}"),
            f"{np.median(each.seconds):.2f}",
            f"{np.quantile(each.seconds, 0.9):.2f}",
            f"{max(each.seconds):.2f}",
        )
        for each in found
    ]
    return Measurement(found, [Table("Searches on several cores", _HEADER, rows)])


def _shared(count: int, settings: PlannerSettings, processes: Sequence[int]) -> Iterator[Shared]:
    steady = OBJECTIVES["min(Theta)"]
    kinds = {
        "least attitude": [
            replace(scenario(*key, turned=False).problem, objective=steady)
            for key in islice(BEST_KNOWN, count)
        ],
        # Not the first one, which takes twenty times the median.
        "all features": [all_features.problem(number).problem for number in range(1, 1 + count)],
    }
    for search, problems in kinds.items():
        for number in processes:
            threads = replace(settings, threads=number)
            yield Shared(search, number, tuple(_seconds(one, threads) for one in problems))


def _seconds(problem: PlanningProblem, settings: PlannerSettings) -> float:
    begun = time.perf_counter()
    with suppress(NoPlanFound):
        perform(PlanningTask(problem, settings))
    return time.perf_counter() - begun
