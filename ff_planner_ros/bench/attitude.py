"""How near the plans of least attitude come to the best that is known."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from ff_planner_ros.bench.measurement import OBJECTIVES, Measurement, timed_plan
from ff_planner_ros.common.text_table import Table
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings, SearchDepth
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.problems.scenarios import scenario

_HEADER = (
    *("search", "scenarios", "min(L)", "min(Theta) too", "worse than min(L)"),
    *("attitude / best, median", "worst", "processor time, median [s]", "worst [s]"),
)
# Largest Euler angle [rad] of the best plan that was ever found: of 80 initial guesses and 150 hops
# each, in each of the path families; or of one of our searches, where that was better.
BEST_KNOWN = {
    ("ordinary", "lemur", 4): 0.0591,
    ("ordinary", "lemur", 0): 0.0251,
    ("cluttered", "lemur", 1): 0.0954,
    ("ordinary", "lemur", 2): 0.2929,
    ("cluttered", "lemur", 3): 0.0546,
    ("cluttered", "lemur", 5): 0.0508,
    ("ordinary", "arm6", 0): 0.1579,
    ("ordinary", "arm6", 2): 0.2053,
    ("cluttered", "arm6", 3): 0.1577,
    ("ordinary", "arm6", 4): 0.0665,
    ("cluttered", "arm6", 1): 0.1201,
    ("ordinary", "canadarm2", 2): 0.0537,
    ("ordinary", "canadarm2", 4): 0.1458,
    ("ordinary", "canadarm2", 5): 0.4253,
    ("ordinary", "off7", 0): 0.3114,
    ("cluttered", "off7", 1): 0.0314,
    ("ordinary", "off7", 2): 0.0338,
    ("cluttered", "off7", 3): 0.0124,
    ("ordinary", "off7", 4): 0.0247,
    ("cluttered", "off7", 5): 0.0142,
}


@dataclass(frozen=True)
class Steadiness:
    """What became of one scenario."""

    kind: str
    robot: str
    number: int
    depth: SearchDepth
    seconds: float  # of processor time, for the plan of least attitude
    shortest: float | None  # attitude of the plan of least joint path [rad]; None: there is none
    steadiest: float | None  # that of the plan of least attitude [rad]
    best_known: float  # [rad]


def measurement(count: int, settings: PlannerSettings) -> Measurement:
    """Plan the first scenarios, with each depth of search."""
    done = [each for depth in SearchDepth for each in steadiness(count, depth, settings)]
    rows = [
        (str(depth), *_nearness([each for each in done if each.depth is depth]))
        for depth in SearchDepth
    ]
    title = "Chaser attitude beside the best that is known"
    return Measurement(done, [Table(title, _HEADER, rows)])


def steadiness(count: int, depth: SearchDepth, settings: PlannerSettings) -> Iterator[Steadiness]:
    """Plan the first scenarios for least joint path and for least attitude."""
    settings = replace(settings, search=depth)
    for (kind, robot, number), best in islice(BEST_KNOWN.items(), count):
        problem = scenario(kind, robot, number, turned=False).problem
        (shortest, _), (steadiest, seconds) = (
            _attitude(replace(problem, objective=OBJECTIVES[name]), settings)
            for name in ("min(L)", "min(Theta)")
        )
        yield Steadiness(kind, robot, number, depth, seconds, shortest, steadiest, best)


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
