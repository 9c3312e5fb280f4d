"""How often, and how fast, the planner goes on with a body that it has captured."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

from ff_planner_ros.bench.measurement import Attempt, Measurement, misses, solved_and_times
from ff_planner_ros.common.text_table import Table
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import perform
from ff_planner_ros.problems import captured

_HEADER = (
    *("kind", "problems", "solved", "median [s]", "95 % [s]", "worst [s]"),
    "largest grasp force [N]",
)


@dataclass(frozen=True)
class CapturedAttempt(Attempt):
    """What became of one task; its time is that of a phase in the mean."""

    kind: str  # of `captured.KINDS`
    robot: str  # of `captured.ROBOTS`
    number: int
    force: float  # largest through the grasp [N]; NaN: there is no plan


def measurement(count: int, settings: PlannerSettings) -> Measurement:
    """Plan so many tasks of each kind."""
    tried = list(attempts(count, settings))
    rows = []
    for kind in captured.KINDS:
        group = [each for each in tried if each.kind == kind]
        worst = f"{max(each.seconds for each in group):.3f}"
        force = f"{max((each.force for each in group if each.solved), default=0.0):.1f}"
        rows.append((kind, *solved_and_times(group), worst, force))
    table = Table("With a captured body, time of each phase", _HEADER, rows)
    return Measurement(tried, [table], misses(tried, "{0.kind} {0.robot} {0.number}"))


def attempts(count: int, settings: PlannerSettings) -> Iterator[CapturedAttempt]:
    """Plan so many tasks of each kind."""
    for kind in captured.KINDS:
        for number, drawn in enumerate(captured.problems(kind, count)):
            task, phases, begun = drawn.task(settings), 1 + len(drawn.then), time.process_time()
            status, message, force = Status.SOLVED, "", float("nan")
            try:
                force = perform(task).phases[-1].metrics.peak_grasp_force
            except FfPlannerError as error:
                status, message = error.status, str(error)
            seconds = (time.process_time() - begun) / phases
            yield CapturedAttempt(
                *(kind, drawn.robot, number, force), status=status, message=message, seconds=seconds
            )
