"""Captures of tumbling bodies: success rate, time, and errors of the plans executed in MuJoCo.

Captures of minimum duration are compared with the duration of the problem's witness, a known
feasible motion, and with the shortest duration found by a sweep over fixed ones. Tasks with a
captured body are measured, too.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ff_planner_benchmark.bench.measurement import (
    Attempt,
    Measurement,
    misses,
    solved_and_times,
    timed_plan,
)
from ff_planner_benchmark.problems import captured, tumbling
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

_HEADER = (
    *("class", "problems", "solved", "median [s]", "95 % [s]", "apart in MuJoCo [mm]"),
    *("[deg]", "moving apart [mm/s]"),
)
_FASTEST_HEADER = (
    *("from", "problems", "solved", "median [s]", "95 % [s]", "slowest / reference's"),
    "slowest / sweep's",
)
# Ranges of durations over the witness's: around it, and down to what no arm can do.
RANGES = {"70 %": (0.7, 1.3), "10 %": (0.1, 1.3)}
# Of the sweep, in parts of the duration that was chosen, the longest first.
_SWEPT = (0.98, 0.96, 0.94, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5)


@dataclass(frozen=True)
class CaptureAttempt(Attempt):
    """The planner's result on one problem."""

    kind: str  # key of `tumbling.KINDS`
    number: int
    # Of the end effector relative to the grasp, at the capture as executed; None for a miss, and
    # without MuJoCo
    position_error: float | None = None  # [m]
    orientation_error: float | None = None  # [rad]
    linear_speed: float | None = None  # [m/s]


@dataclass(frozen=True)
class FastestAttempt(Attempt):
    """The planner's result on one problem of minimum duration."""

    shortest: str  # key of `RANGES`
    number: int
    # Chosen duration over the witness's, and over the shortest that the sweep found (1: the sweep
    # found none shorter, or there was no sweep); None for a miss
    of_witness: float | None = None
    of_sweep: float | None = None


def measurement(count: int, settings: PlannerSettings) -> Measurement:
    """Plan `count` problems of each class, and execute the plans."""
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
    """Plan `count` problems of a class, and execute the plans."""
    for number, problem in enumerate(tumbling.problems(kind, count)):
        made, outcome = timed_plan(PlanningTask(problem, settings))
        errors = _errors(problem, made) if made else ()
        yield CaptureAttempt(kind, number, *errors, **outcome)


def _errors(problem: PlanningProblem, plan: Plan) -> tuple[float, ...]:
    """Return a capture's errors in MuJoCo: position [m], orientation [rad], velocity [m/s]."""
    try:
        from ff_planner_ros.simulation.verification import verify
    except FfPlannerError:  # MuJoCo is not installed: the rest of the table needs none
        return ()
    found = verify(problem.robot, plan.trajectory, scene_of(problem)).capture
    return (found.position_error, found.orientation_error, found.linear_speed) if found else ()


def _worst(values: Sequence[float | None], unit: float, digits: int = 4) -> str:
    """Return the largest known value times `unit`, as text; `-` of none."""
    known = [value for value in values if value is not None]
    return f"{unit * max(known):.{digits}f}" if known else "-"


def fastest_measurement(count: int, settings: PlannerSettings, *, quick: bool) -> Measurement:
    """Plan `count` problems in each range; if quick, in the first one only, without a sweep."""
    tried, rows = [], []
    for name in list(RANGES)[: 1 if quick else None]:
        group = [*fastest_attempts(name, count, settings, sweep=not quick)]
        tried += group
        parts = [[each.of_witness for each in group], [each.of_sweep for each in group]]
        slowest = (_worst(part, 1.0, digits=3) for part in parts)
        rows.append((name, *solved_and_times(group), *slowest))
    table = Table("Fastest captures", _FASTEST_HEADER, rows)
    return Measurement(tried, [table], misses(tried, "{0.shortest} {0.number}"))


def fastest_attempts(
    name: str, count: int, settings: PlannerSettings, *, sweep: bool
) -> Iterator[FastestAttempt]:
    """Plan `count` problems of minimum duration in a range, a key of `RANGES`."""
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
    """Return a problem of minimum duration; part: shortest and longest over the given duration."""
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
    """Return the shortest fixed duration [s] with a plan, up to the chosen one."""
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
    """The planner's result on one task; `seconds` is the mean time of its phases."""

    kind: str  # of `captured.KINDS`
    robot: str  # of `captured.ROBOTS`
    number: int
    force: float | None  # peak force at the grasp in the last phase [N]; None: there is no plan


def captured_measurement(count: int, settings: PlannerSettings) -> Measurement:
    """Plan `count` tasks with a captured body of each kind, and tabulate the results."""
    tried = list(captured_attempts(count, settings))
    rows = []
    for kind in captured.KINDS:
        group = [each for each in tried if each.kind == kind]
        worst = f"{max(each.seconds for each in group):.3f}"
        force = _worst([each.force for each in group], 1.0, digits=1)
        rows.append((kind, *solved_and_times(group), worst, force))
    table = Table("With a captured body, time of each phase", _CAPTURED_HEADER, rows)
    return Measurement(tried, [table], misses(tried, "{0.kind} {0.robot} {0.number}"))


def captured_attempts(count: int, settings: PlannerSettings) -> Iterator[CapturedAttempt]:
    """Plan `count` tasks with a captured body of each kind."""
    for kind in captured.KINDS:
        for number, drawn in enumerate(captured.problems(kind, count)):
            task, phases, begun = drawn.task(settings), 1 + len(drawn.then), time.process_time()
            status, message, force = Status.SOLVED, "", None
            try:
                force = perform(task).phases[-1].metrics.peak_grasp_force
            except FfPlannerError as error:
                status, message = error.status, str(error)
            seconds = (time.process_time() - begun) / phases
            yield CapturedAttempt(
                *(kind, drawn.robot, number, force), status=status, message=message, seconds=seconds
            )
