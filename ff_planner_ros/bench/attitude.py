"""How near the plans of least attitude come to the best that is known."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from ff_planner_ros.bench.measurement import OBJECTIVES, Measurement, timed_plan
from ff_planner_ros.common.text_table import Table
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.problems.scenarios import scenario

# Rounds of search for the attitude: none, a race alone, and with hops, the default.
_ROUNDS = (0, 1, 3)
_HEADER = (
    *("rounds", "scenarios", "min(L)", "min(Theta) too", "worse than min(L)"),
    *("attitude / best, median", "worst", "processor time, median [s]", "worst [s]"),
)
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
    seconds: float  # of processor time, for the plan of least attitude
    shortest: float | None  # attitude of the plan of least joint path [rad]; None: there is none
    steadiest: float | None  # that of the plan of least attitude [rad]
    best_known: float  # [rad]


def measurement(count: int, settings: PlannerSettings) -> Measurement:
    """Plan the first scenarios, with each number of rounds."""
    done = [each for rounds in _ROUNDS for each in steadiness(count, rounds, settings)]
    rows = [
        (f"{rounds}", *_nearness([each for each in done if each.rounds == rounds]))
        for rounds in _ROUNDS
    ]
    title = "Chaser attitude beside the best that is known"
    return Measurement(done, [Table(title, _HEADER, rows)])


def steadiness(count: int, rounds: int, settings: PlannerSettings) -> Iterator[Steadiness]:
    """Plan the first scenarios for least joint path and for least attitude."""
    settings = replace(settings, attitude_rounds=rounds)
    for (kind, robot, number), best in islice(BEST_KNOWN.items(), count):
        problem = scenario(kind, robot, number, turned=False).problem
        (shortest, _), (steadiest, seconds) = (
            _attitude(replace(problem, objective=OBJECTIVES[name]), settings)
            for name in ("min(L)", "min(Theta)")
        )
        yield Steadiness(kind, robot, number, rounds, seconds, shortest, steadiest, best)


def _attitude(problem: PlanningProblem, settings: PlannerSettings) -> tuple[float | None, float]:
    """Return the largest Euler angle of a plan, and what it took [s]; None: there is no plan."""
    made, outcome = timed_plan(PlanningTask(problem, settings))
    return made.metrics.max_chaser_euler if made else None, outcome["seconds"]


def _nearness(group: Sequence[Steadiness]) -> Iterator[str]:
    pairs = [(each.shortest, each.steadiest) for each in group if each.shortest is not None]
    both = [(short, steady) for short, steady in pairs if steady is not None]
    yield from (f"{len(group)}", f"{len(pairs)}", f"{len(both)}")
    yield f"{sum(steady > short for short, steady in both)}"
    ratios = [e.steadiest / e.best_known for e in group if e.steadiest is not None]
    seconds = [each.seconds for each in group]
    yield from (f"{np.median(ratios):.2f}", f"{max(ratios):.2f}")
    yield from (f"{np.median(seconds):.2f}", f"{max(seconds):.2f}")
