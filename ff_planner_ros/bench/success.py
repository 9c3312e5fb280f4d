"""How often, and how fast, the planner finds a plan where there is one."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

from ff_planner_ros.bench.robots import ROBOTS
from ff_planner_ros.bench.scenarios import scenario
from ff_planner_ros.errors import FfPlannerError, Status
from ff_planner_ros.planning.check import measure, require_sound
from ff_planner_ros.planning.planner import plan
from ff_planner_ros.planning.settings import PlannerSettings


@dataclass(frozen=True)
class Attempt:
    """What became of one scenario.

    Attributes:
        kind: Its class.
        robot: Its robot.
        number: Its number.
        turned: Whether its inertial frame is turned.
        status: Of the answer; solved only if the plan passes the check once more.
        message: Cause of a miss; empty if solved.
        seconds: Time to the answer.
        starts: First guesses tried; 0 for a miss.
    """

    kind: str
    robot: str
    number: int
    turned: bool
    status: Status
    message: str
    seconds: float
    starts: int

    @property
    def solved(self) -> bool:
        """Whether there is a plan, and it is sound."""
        return self.status is Status.SOLVED


def attempts(kind: str, count: int, settings: PlannerSettings) -> Iterator[Attempt]:
    """Plan scenarios of a class: the robots in turn, each one as drawn and turned."""
    for index in range(count):
        pair, turned = divmod(index, 2)
        number, robot = divmod(pair, len(ROBOTS))
        yield attempt(kind, ROBOTS[robot], number, bool(turned), settings)


def attempt(kind: str, robot: str, number: int, turned: bool, settings: PlannerSettings) -> Attempt:
    """Plan one scenario.

    Args:
        turned: Whether its inertial frame is turned.
    """
    problem = scenario(kind, robot, number, turned=turned).problem
    begun = time.perf_counter()
    status, message, starts = Status.SOLVED, "", 0
    try:
        answer = plan(problem, settings)
        seconds = time.perf_counter() - begun
        starts = answer.solver.starts
        metrics = measure(problem, answer.trajectory, settings)
        require_sound(problem, replace(answer, metrics=metrics), settings)
    except FfPlannerError as error:
        seconds = time.perf_counter() - begun
        status, message = error.status, str(error)
    return Attempt(kind, robot, number, turned, status, message, seconds, starts)
