"""Captures of bodies that tumble: how often, how fast, and how they come true in MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ff_planner_ros.bench.success import Stopwatch, solved_and_times
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems import tumbling

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
    # Of end effector and grasp at the capture, as executed; None for a miss, and without MuJoCo
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
            errors = _errors(problem, plan)
            yield CaptureAttempt(kind, number, Status.SOLVED, "", stopwatch.seconds, *errors)


def _errors(problem: PlanningProblem, plan: Plan) -> tuple[float | None, ...]:
    """Return position [m], orientation [rad] and speed [m/s] of the capture as executed."""
    try:
        from ff_planner_ros.simulation.verification import verify
    except FfPlannerError:  # MuJoCo is not installed: the rest of the table needs none
        return None, None, None
    found = verify(problem.robot, plan.trajectory, scene_of(problem)).capture
    if found is None:
        return None, None, None
    return found.position_error, found.orientation_error, found.linear_speed


def capture_rows(tried: Sequence[CaptureAttempt]) -> Iterator[tuple[str, ...]]:
    """Yield a row for each class, the worst of the errors: `HEADER`."""
    for kind in dict.fromkeys(each.kind for each in tried):
        group = [each for each in tried if each.kind == kind]
        solved = [each for each in group if each.status is Status.SOLVED]
        yield (
            kind,
            *solved_and_times(
                [each.status is Status.SOLVED for each in group], [each.seconds for each in group]
            ),
            _worst([each.position_error for each in solved], 1e3),
            _worst([each.orientation_error for each in solved], np.rad2deg(1.0)),
            _worst([each.linear_speed for each in solved], 1e3),
        )


def _worst(errors: Sequence[float | None], unit: float) -> str:
    """Return the largest of the errors that are known, in its unit."""
    known = [error for error in errors if error is not None]
    return f"{unit * max(known):.4f}" if known else "-"
