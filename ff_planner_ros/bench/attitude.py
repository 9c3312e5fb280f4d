"""How near the plans of least attitude come to the best that is known."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice

from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.planning.problem.problem import Objective, PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.scenarios import scenario

SHORTEST, STEADIEST = Objective(1.0, 0.0), Objective(0.0, 1.0)

# Largest Euler angle [rad] of the best plan that was ever found: of 100 first guesses each, solved
# on 13 points, the best 15 of them on all; or of one of our searches, where that
# was better.
BEST_KNOWN = {
    ("ordinary", "lemur", 4): 0.0948,
    ("ordinary", "lemur", 0): 0.0334,
    ("cluttered", "lemur", 1): 0.1052,
    ("ordinary", "lemur", 2): 0.3592,
    ("cluttered", "lemur", 3): 0.0687,
    ("cluttered", "lemur", 5): 0.0682,
    ("ordinary", "arm6", 0): 0.2415,
    ("ordinary", "arm6", 2): 0.2937,
    ("cluttered", "arm6", 3): 0.1852,
    ("ordinary", "arm6", 4): 0.0697,
    ("cluttered", "arm6", 1): 0.1844,
    ("ordinary", "canadarm2", 2): 0.0576,
    ("ordinary", "canadarm2", 4): 0.1475,
    ("ordinary", "canadarm2", 5): 0.4266,
    ("ordinary", "off7", 0): 0.3114,
    ("cluttered", "off7", 1): 0.0479,
    ("ordinary", "off7", 2): 0.0593,
    ("cluttered", "off7", 3): 0.0415,
    ("ordinary", "off7", 4): 0.0535,
    ("cluttered", "off7", 5): 0.0257,
}


@dataclass(frozen=True)
class Steadiness:
    """What became of one scenario."""

    kind: str
    robot: str
    number: int
    rounds: int  # of search
    seconds: float  # of processor time
    shortest: float | None  # attitude of the plan of least joint path [rad]; None: there is none
    steadiest: float | None  # that of the plan of least attitude [rad]
    best_known: float  # [rad]


def steadiness(count: int, rounds: int, settings: PlannerSettings) -> Iterator[Steadiness]:
    """Plan the first scenarios for least joint path and for least attitude."""
    settings = replace(settings, attitude_rounds=rounds)
    for (kind, robot, number), best in islice(BEST_KNOWN.items(), count):
        problem = scenario(kind, robot, number, turned=False).problem
        shortest, _ = _attitude(problem, SHORTEST, settings)
        steadiest, seconds = _attitude(problem, STEADIEST, settings)
        yield Steadiness(kind, robot, number, rounds, seconds, shortest, steadiest, best)


def _attitude(
    problem: PlanningProblem, objective: Objective, settings: PlannerSettings
) -> tuple[float | None, float]:
    """Return the largest Euler angle of a plan, and what it took [s]; None: there is no plan."""
    task = PlanningTask(replace(problem, objective=objective), settings)
    begun, angle = time.process_time(), None
    with suppress(NoPlanFound):
        angle = perform(task).metrics.max_chaser_euler
    return angle, time.process_time() - begun
