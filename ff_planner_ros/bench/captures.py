"""Captures of bodies that tumble: how often, how fast, and how they come true in MuJoCo.

The fastest captures, too, where the planner chooses the duration. Of the witness of each problem
it is known that it arrives after its duration. A sweep over fixed durations that are shorter than
the one chosen says whether the planner could have been faster.

And what follows a grasp: how often, and how fast, the planner goes on with the body.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ff_planner_ros.bench.measurement import (
    Attempt,
    Measurement,
    misses,
    solved_and_times,
    timed_plan,
)
from ff_planner_ros.common.text_table import Table
from ff_planner_ros.errors import FfPlannerError, NoPlanFound, Status
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Objective,
    PlanningProblem,
    lasting,
)
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems import captured, tumbling

_HEADER = (
    *("class", "problems", "solved", "median [s]", "95 % [s]", "apart in MuJoCo [mm]"),
    *("[deg]", "moving apart [mm/s]"),
)
_FASTEST_HEADER = (
    *("from", "problems", "solved", "median [s]", "95 % [s]", "slowest / witness's"),
    "slowest / sweep's",
)
# Ranges of durations, in parts of the witness's: about it, and down to what no arm can do.
RANGES = {"70 %": (0.7, 1.3), "10 %": (0.1, 1.3)}
# Of the sweep, in parts of the duration that was chosen, the longest first.
_SWEPT = (0.98, 0.96, 0.94, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5)


@dataclass(frozen=True)
class CaptureAttempt(Attempt):
    """What became of one problem."""

    kind: str  # key of `tumbling.KINDS`
    number: int
    # Of end effector and grasp at the capture, as executed; None for a miss, and without MuJoCo
    position_error: float | None = None  # [m]
    orientation_error: float | None = None  # [rad]
    linear_speed: float | None = None  # [m/s]


@dataclass(frozen=True)
class FastestAttempt(Attempt):
    """What became of one problem of which the planner chooses the duration."""

    shortest: str  # key of `RANGES`
    number: int
    # The duration that was chosen, in parts of the witness's and of the shortest that the sweep
    # found, which is at most 1 where it found none; None for a miss
    of_witness: float | None = None
    of_sweep: float | None = None


def measurement(count: int, settings: PlannerSettings) -> Measurement:
    """Plan so many problems of each class, and execute the plans."""
    tried, rows = [], []
    for kind in tumbling.KINDS:
        group = [*capture_attempts(kind, count, settings)]
        tried += group
        rows.append(
            (
                kind,
                *solved_and_times(group),
                _worst([each.position_error for each in group], 1e3),
                _worst([each.orientation_error for each in group], np.rad2deg(1.0)),
                _worst([each.linear_speed for each in group], 1e3),
            )
        )
    table = Table("Captures of bodies that tumble", _HEADER, rows)
    return Measurement(tried, [table], misses(tried, "{0.kind} {0.number}"))


def capture_attempts(kind: str, count: int, settings: PlannerSettings) -> Iterator[CaptureAttempt]:
    """Plan so many problems of a class, and execute the plans."""
    for number, problem in enumerate(tumbling.problems(kind, count)):
        made, outcome = timed_plan(PlanningTask(problem, settings))
        errors = _errors(problem, made) if made else ()
        yield CaptureAttempt(kind, number, *errors, **outcome)


def _errors(problem: PlanningProblem, plan: Plan) -> tuple[float, ...]:
    """Return position [m], orientation [rad] and speed [m/s] of the capture as executed."""
    try:
        from ff_planner_ros.simulation.verification import verify
    except FfPlannerError:  # MuJoCo is not installed: the rest of the table needs none
        return ()
    found = verify(problem.robot, plan.trajectory, scene_of(problem)).capture
    return (found.position_error, found.orientation_error, found.linear_speed) if found else ()


def _worst(errors: Sequence[float | None], unit: float) -> str:
    """Return the largest of the errors that are known, in its unit."""
    known = [error for error in errors if error is not None]
    return f"{unit * max(known):.4f}" if known else "-"


def fastest_measurement(count: int, settings: PlannerSettings, *, quick: bool) -> Measurement:
    """Plan so many problems in each range; if quick, in the first one only, and without a sweep."""
    tried, rows = [], []
    for name in list(RANGES)[: 1 if quick else None]:
        group = [*fastest_attempts(name, count, settings, sweep=not quick)]
        tried += group
        parts = [[each.of_witness for each in group], [each.of_sweep for each in group]]
        slowest = (f"{max(one or 0.0 for one in part):.3f}" for part in parts)
        rows.append((name, *solved_and_times(group), *slowest))
    table = Table("Fastest captures", _FASTEST_HEADER, rows)
    return Measurement(tried, [table], misses(tried, "{0.shortest} {0.number}"))


def fastest_attempts(
    name: str, count: int, settings: PlannerSettings, *, sweep: bool
) -> Iterator[FastestAttempt]:
    """Plan so many problems in a range, a key of `RANGES`."""
    for number, given in enumerate(tumbling.problems("tumbling", count)):
        problem = fastest(given, RANGES[name])
        made, outcome = timed_plan(PlanningTask(problem, settings))
        parts: tuple[float, ...] = ()
        if made is not None:
            chosen = problem.duration if made.duration is None else made.duration
            swept = _swept(problem, chosen, settings) if sweep else chosen
            parts = chosen / given.duration, chosen / swept
        yield FastestAttempt(name, number, *parts, **outcome)


def fastest(problem: PlanningProblem, part: tuple[float, float]) -> PlanningProblem:
    """Return a problem that asks for the fastest capture, in parts of its duration."""
    shortest, longest = (one * problem.duration for one in part)
    body = problem.target_body
    return replace(
        problem,
        duration=longest,
        target=problem.target if body is None else body.target(longest),
        duration_range=DurationRange(shortest, longest),
        objective=Objective(0.0, 0.0, duration=1.0),
    )


def _swept(problem: PlanningProblem, chosen: float, settings: PlannerSettings) -> float:
    """Return the shortest duration [s], of fixed ones up to the one chosen, that has a plan."""
    found = chosen
    for part in _SWEPT:
        if part * chosen >= problem.durations.minimum:
            try:
                perform(PlanningTask(lasting(problem, part * chosen), settings))
            except NoPlanFound:
                continue
            found = part * chosen
    return found


_CAPTURED_HEADER = (
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


def captured_measurement(count: int, settings: PlannerSettings) -> Measurement:
    """Plan so many tasks of each kind."""
    tried = list(captured_attempts(count, settings))
    rows = []
    for kind in captured.KINDS:
        group = [each for each in tried if each.kind == kind]
        worst = f"{max(each.seconds for each in group):.3f}"
        force = f"{max((each.force for each in group if each.solved), default=0.0):.1f}"
        rows.append((kind, *solved_and_times(group), worst, force))
    table = Table("With a captured body, time of each phase", _CAPTURED_HEADER, rows)
    return Measurement(tried, [table], misses(tried, "{0.kind} {0.robot} {0.number}"))


def captured_attempts(count: int, settings: PlannerSettings) -> Iterator[CapturedAttempt]:
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
