"""Captures of bodies that tumble: how often, how fast, and how they come true in MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ff_planner_ros.bench import tumbling
from ff_planner_ros.bench.success import Stopwatch
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.scene import scene_of
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.planning.task import PlanningTask, perform
from ff_planner_ros.simulation.verification import verify

HEADER = (
    *("class", "problems", "solved", "median [s]", "95 % [s]", "apart in MuJoCo [mm]"),
    *("[deg]", "moving apart [mm/s]"),
)


@dataclass(frozen=True)
class CaptureAttempt:
    """What became of one problem."""

    kind: str  # key of `tumbling.KINDS`
    number: int
    status: Status
    message: str  # cause of a miss; empty if solved
    seconds: float  # that the planner took
    # Of end effector and grasp at the capture, as executed; None for a miss
    position_error: float | None  # [m]
    orientation_error: float | None  # [rad]
    linear_speed: float | None  # [m/s]


def capture_attempts(count: int, settings: PlannerSettings) -> Iterator[CaptureAttempt]:
    """Plan so many problems of each class, and execute the plans."""
    for kind in tumbling.KINDS:
        for number, problem in enumerate(tumbling.problems(kind, count)):
            stopwatch = Stopwatch()
            try:
                plan = perform(PlanningTask(problem, settings), method=stopwatch)
            except FfPlannerError as error:
                missed = (error.status, str(error), stopwatch.seconds, None, None, None)
                yield CaptureAttempt(kind, number, *missed)
                continue
            found = verify(problem.robot, plan.trajectory, scene_of(problem)).capture
            errors = (
                (None, None, None)
                if found is None
                else (found.position_error, found.orientation_error, found.linear_speed)
            )
            yield CaptureAttempt(kind, number, Status.SOLVED, "", stopwatch.seconds, *errors)


def capture_rows(tried: Sequence[CaptureAttempt]) -> Iterator[tuple[str, ...]]:
    """Yield a row for each class, the worst of the errors: `HEADER`."""
    for kind in dict.fromkeys(each.kind for each in tried):
        group = [each for each in tried if each.kind == kind]
        solved = [each for each in group if each.status is Status.SOLVED]
        seconds = [each.seconds for each in group]
        apart = [each.position_error or 0.0 for each in solved]
        turned = [each.orientation_error or 0.0 for each in solved]
        moving = [each.linear_speed or 0.0 for each in solved]
        yield (
            kind,
            f"{len(group)}",
            f"{len(solved) / len(group):.1%}",
            f"{np.median(seconds):.3f}",
            f"{np.quantile(seconds, 0.95):.3f}",
            f"{1e3 * max(apart, default=0.0):.4f}",
            f"{np.rad2deg(max(turned, default=0.0)):.4f}",
            f"{1e3 * max(moving, default=0.0):.4f}",
        )
