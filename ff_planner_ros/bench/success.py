"""How often, and how fast, the planner finds a plan where there is one."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ff_planner_ros.errors import FfPlannerError, NoPlanFound, Status
from ff_planner_ros.planning.check.check import measure
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import Watch
from ff_planner_ros.planning.problem.problem import PlanningProblem, lasting
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.search.planner import FirstGuess, plan
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.robots import ROBOTS
from ff_planner_ros.problems.scenarios import scenario


@dataclass(frozen=True)
class Attempt:
    """What became of one scenario."""

    kind: str  # key of `KINDS`
    robot: str
    number: int
    turned: bool  # whether its inertial frame is turned
    status: Status  # solved only if the plan passes the check once more
    message: str  # cause of a miss; empty if solved
    seconds: float  # that the planner took
    starts: int  # first guesses tried; 0 for a miss

    @property
    def solved(self) -> bool:
        """Whether there is a plan, and it is sound."""
        return self.status is Status.SOLVED


@dataclass
class Stopwatch:
    """The planner as a method of `perform`, with the time that it takes."""

    # Processor time of the last plan; what `perform` does before and after does not count
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


def attempts(kind: str, count: int, settings: PlannerSettings) -> Iterator[Attempt]:
    """Plan scenarios of a class: the robots in turn, each one as drawn and turned."""
    for index in range(count):
        pair, turned = divmod(index, 2)
        number, robot = divmod(pair, len(ROBOTS))
        yield attempt(kind, ROBOTS[robot], number, bool(turned), settings)


def attempt(kind: str, robot: str, number: int, turned: bool, settings: PlannerSettings) -> Attempt:
    """Plan one scenario, its inertial frame turned or not."""
    problem = scenario(kind, robot, number, turned=turned).problem
    stopwatch = Stopwatch()
    status, message, starts = Status.SOLVED, "", 0
    try:
        starts = perform(PlanningTask(problem, settings), method=stopwatch).solver.starts
    except FfPlannerError as error:
        status, message = error.status, str(error)
    return Attempt(kind, robot, number, turned, status, message, stopwatch.seconds, starts)


def timed_plans(
    problems: Iterable[PlanningProblem], settings: PlannerSettings, warm_up: int = 0
) -> tuple[list[Plan], float]:
    """Return plans of all problems that are solved, and their median time [s] after the warm-up."""
    plans, seconds, stopwatch = [], [], Stopwatch()
    for problem in problems:
        try:
            plans.append(perform(PlanningTask(problem, settings), method=stopwatch))
        except NoPlanFound:
            continue
        seconds.append(stopwatch.seconds)
    return plans, statistics.median(seconds[warm_up:])


def solved_and_times(solved: Sequence[bool], seconds: Sequence[float]) -> tuple[str, ...]:
    """Return cells of a table: problems, part that is solved, median and 95 % of the times [s]."""
    return (
        f"{len(solved)}",
        f"{sum(solved) / len(solved):.1%}",
        f"{np.median(seconds):.3f}",
        f"{np.quantile(seconds, 0.95):.3f}",
    )
