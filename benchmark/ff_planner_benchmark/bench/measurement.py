"""An experiment of the benchmark: its results, and the measurement of the planner's time."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ff_planner_ros.common.intervals import percent
from ff_planner_ros.common.text_table import Table
from ff_planner_ros.errors import FfPlannerError, NoPlanFound, Status
from ff_planner_ros.planning.check.check import measure
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import Watch
from ff_planner_ros.planning.problem.problem import Objective, PlanningProblem, lasting
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.search.planner import FirstGuess, plan
from ff_planner_ros.planning.task.task import PlanningTask, perform

OBJECTIVES = {
    "min(L)": Objective(1.0, 0.0),
    "min(Theta)": Objective(0.0, 1.0),
    "L + Theta": Objective(1.0, 1.0),
}


@dataclass(frozen=True)
class Measurement:
    """The results of an experiment."""

    results: Sequence[Any]  # dataclasses
    tables: Sequence[Table]  # summaries of the results
    remarks: Sequence[str] = ()  # lines of text, such as a miss and its cause


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """The planner's result on one problem."""

    status: Status
    message: str  # cause of a miss; empty if solved
    seconds: float  # processor time of the planner

    @property
    def solved(self) -> bool:
        """Whether there is a plan, and it passes the check."""
        return self.status is Status.SOLVED


def misses(attempts: Iterable[Attempt], name: str) -> list[str]:
    """Return a remark for each attempt that found no plan; `name` has the attempt's fields."""
    return [
        f"missed: {name.format(each)}: {each.status.name}: {each.message}"
        for each in attempts
        if not each.solved
    ]


@dataclass
class Stopwatch:
    """The planner as a method of `perform`, with a measurement of its time."""

    # Processor time of the last plan, without what `perform` does before and after
    seconds: float = 0.0

    def __call__(
        self,
        problem: PlanningProblem,
        settings: PlannerSettings,
        watch: Watch,
        guess: FirstGuess | None,
    ) -> Plan:
        """Plan, and compute the metrics anew instead of trusting the planner's."""
        begun = time.process_time()
        try:
            made = plan(problem, settings, watch, guess)
        finally:
            self.seconds = time.process_time() - begun
        fixed = lasting(problem, made.duration)
        return replace(made, metrics=measure(fixed, made.trajectory, settings))


def timed_plan(task: PlanningTask) -> tuple[Plan | None, dict[str, Any]]:
    """Return the plan of a task, None where there is none, and the fields of `Attempt`."""
    stopwatch, made, status, message = Stopwatch(), None, Status.SOLVED, ""
    try:
        made = perform(task, method=stopwatch)
    except FfPlannerError as error:
        status, message = error.status, str(error)
    return made, {"status": status, "message": message, "seconds": stopwatch.seconds}


def timed_plans(
    problems: Iterable[PlanningProblem], settings: PlannerSettings, warm_up: int = 0
) -> tuple[list[Plan], float]:
    """Return the plans of all problems that are solved, and their median processor time [s].

    Args:
        warm_up: Number of first problems whose times do not count.

    Raises:
        NoPlanFound: None is solved whose time counts; that of the last problem.
    """
    timed = [timed_plan(PlanningTask(problem, settings)) for problem in problems]
    seconds = [outcome["seconds"] for made, outcome in timed[warm_up:] if made]
    if not seconds:
        _, last = timed[-1]
        raise NoPlanFound(last["status"], last["message"])
    return [made for made, _ in timed if made], statistics.median(seconds)


def solved_and_times(attempts: Sequence[Attempt]) -> tuple[str, ...]:
    """Return cells of a table: problems, rate solved, median and 95 % quantile of the times [s]."""
    seconds = [each.seconds for each in attempts]
    return (
        f"{len(attempts)}",
        percent(sum(each.solved for each in attempts) / len(attempts)),
        f"{np.median(seconds):.3f}",
        f"{np.quantile(seconds, 0.95):.3f}",
    )


def median(values: Sequence[float], digits: int) -> str:
    """Return a median as a cell of a table, `-` of no values."""
    return f"{np.median(values):.{digits}f}" if values else "-"
