"""Success rate and time of the planner on problems that use all features at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ff_planner_ros.bench.measurement import (
    Attempt,
    Measurement,
    misses,
    solved_and_times,
    timed_plan,
)
from ff_planner_ros.common.text_table import Table
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.problems import all_features

_HEADER = (
    *("robot", "problems", "solved", "median [s]", "90 % [s]", "95 % [s]", "worst [s]"),
    "duration / reference's, median",
)


@dataclass(frozen=True)
class EverythingAttempt(Attempt):
    """The planner's result on one problem."""

    robot: str
    number: int
    of_witness: float | None  # chosen duration over the witness's; None for a miss


def measurement(count: int, settings: PlannerSettings, *, quick: bool) -> Measurement:
    """Plan `count` problems; if quick, not the first one, which takes twenty times the median."""
    tried = list(attempts(count, settings, first=1 if quick else 0))
    groups = {"all": tried} | {
        robot: [each for each in tried if each.robot == robot] for robot in all_features.ROBOTS
    }
    rows = [(name, *_summary(group)) for name, group in groups.items() if group]
    table = Table("All features at once", _HEADER, rows)
    return Measurement(tried, [table], misses(tried, "{0.robot} {0.number}"))


def attempts(count: int, settings: PlannerSettings, first: int = 0) -> Iterator[EverythingAttempt]:
    """Plan `count` problems, from number `first` on."""
    for number in range(first, first + count):
        drawn = all_features.problem(number)
        made, outcome = timed_plan(PlanningTask(drawn.problem, settings))
        part = made.duration / drawn.duration if made and made.duration else None
        robot = all_features.ROBOTS[number % len(all_features.ROBOTS)]
        yield EverythingAttempt(robot, number, part, **outcome)


def _summary(group: Sequence[EverythingAttempt]) -> Iterator[str]:
    seconds = [each.seconds for each in group]
    problems, solved, median, most = solved_and_times(group)
    yield from (problems, solved, median, f"{np.quantile(seconds, 0.9):.3f}", most)
    yield f"{max(seconds):.3f}"
    parts = [each.of_witness for each in group if each.of_witness is not None]
    yield f"{np.median(parts):.3f}" if parts else "-"
