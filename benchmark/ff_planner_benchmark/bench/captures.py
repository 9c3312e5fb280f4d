"""Captures of tumbling bodies, the shortest ones too, and what follows a grasp."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ff_planner_benchmark.bench import columns
from ff_planner_benchmark.bench.experiment import (
    SOLVED,
    Experiment,
    Row,
    attempt,
    each,
    missed,
    planned,
)
from ff_planner_benchmark.problems.classes import (
    CAPTURED,
    TUMBLING,
    ProblemClass,
)
from ff_planner_ros.errors import FfPlannerError, NoPlanFound
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
from ff_planner_ros.problems.drawn import Drawn


def _captured(one: ProblemClass, number: int, settings: PlannerSettings) -> Iterator[Row]:
    """Plan a task with a captured body; its time is the mean of its phases."""
    task, begun = one.task(number, settings), time.process_time()
    row: Row = {"kind": one.name, "robot": one.robot(number), "number": number, "force": None}
    outcome = {"status": SOLVED, "message": ""}
    try:
        row["force"] = perform(task).phases[-1].metrics.peak_grasp_force  # [N]
    except FfPlannerError as error:
        outcome = {"status": error.status.name, "message": str(error)}
    seconds = (time.process_time() - begun) / (1 + len(task.then))
    yield row | outcome | {"seconds": seconds}


CAPTURED_PLANS = Experiment(
    "captured",
    "With a captured body, time of each phase",
    each(CAPTURED, _captured),
    {"kind": "kind"},
    {
        "problems": columns.count,
        **columns.TIMES,
        **columns.WORST,
        "largest grasp force [N]": columns.value("force", max, ".1f"),
    },
    most=60,
    remark=missed("{kind} {robot} {number}"),
)


def _errors(drawn: Drawn[Any], made: Plan | None) -> Row:
    """Return the end effector's errors against the grasp, at the capture in MuJoCo.

    Position [m], orientation [rad], velocity [m/s]; None for a miss, and without MuJoCo.
    """
    names = "position_error", "orientation_error", "linear_speed"
    try:
        from ff_planner_ros.simulation.verification import verify
    except FfPlannerError:  # the rest of the table needs none
        return dict.fromkeys(names)
    problem = drawn.problem
    found = made and verify(problem.robot, made.trajectory, scene_of(problem)).capture
    return {name: getattr(found, name) if found else None for name in names}


CAPTURES = Experiment(
    "captures",
    "Captures of bodies that tumble",
    each(TUMBLING, planned(_errors)),
    {"class": "kind"},
    {
        "problems": columns.count,
        **columns.TIMES,
        "apart in MuJoCo [mm]": columns.value("position_error", max, ".4f", 1e3),
        "[deg]": columns.value("orientation_error", max, ".4f", float(np.rad2deg(1.0))),
        "moving apart [mm/s]": columns.value("linear_speed", max, ".4f", 1e3),
    },
    most=60,
    remark=missed("{kind} {number}"),
)

# Ranges of durations over the witness's: around it, and down to what no arm can do.
RANGES = {"70 %": (0.7, 1.3), "10 %": (0.1, 1.3)}
# Of the sweep, in parts of the duration that was chosen, the longest first.
_SWEPT = (0.98, 0.96, 0.94, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5)


def _fastest(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Plan captures of minimum duration, and sweep over fixed ones unless there is only one."""
    one = TUMBLING[0]
    for name, part in RANGES.items():
        for index in range(count):
            given = one.draw(index).problem
            problem = fastest(given, part)

            def measured(
                made: Plan | None,
                given: PlanningProblem = given,
                problem: PlanningProblem = problem,
            ) -> Row:
                if made is None:
                    return {"of_witness": None, "of_sweep": None}
                chosen = problem.duration if made.duration is None else made.duration
                swept = _swept(problem, chosen, settings) if count > 1 else chosen
                return {"of_witness": chosen / given.duration, "of_sweep": chosen / swept}

            labels = {"shortest": name, "number": index}
            yield attempt(PlanningTask(problem, settings), measured, **labels)


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


FREE_MOMENTS = Experiment(
    "free moments",
    "Fastest captures",
    _fastest,
    {"from": "shortest"},
    {
        "problems": columns.count,
        **columns.TIMES,
        "slowest / reference's": columns.value("of_witness", max),
        "slowest / sweep's": columns.value("of_sweep", max),
    },
    most=20,
    remark=missed("{shortest} {number}"),
)
