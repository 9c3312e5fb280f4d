"""Chaser attitude of minimum-attitude plans, beside the best known plans and SLSQP's."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import islice
from typing import TypeAlias

import numpy as np

from ff_planner_benchmark.bench import columns
from ff_planner_benchmark.bench.direct import Stop
from ff_planner_benchmark.bench.exact import solve_by_slsqp
from ff_planner_benchmark.bench.experiment import (
    OBJECTIVES,
    Cell,
    Experiment,
    Row,
    timed_plan,
)
from ff_planner_benchmark.problems.classes import SCENARIOS
from ff_planner_ros.errors import NoPlanFound, OutOfTime
from ff_planner_ros.planning.motion.plan import Plan, SolverReport
from ff_planner_ros.planning.motion.system_frame import in_own_frame
from ff_planner_ros.planning.motion.watch import Watch
from ff_planner_ros.planning.optimisation.program import PathProgram, path_program
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings, SearchDepth
from ff_planner_ros.planning.search.candidate import Candidate, plan_of_path
from ff_planner_ros.planning.search.planner import plan as plan_of
from ff_planner_ros.planning.task.task import PlanningTask, perform, without_search
from ff_planner_ros.problems.scenarios import scenario

# Largest Euler angle [rad] of the best known plan: of 80 initial guesses with 150 basin hops each,
# in each of the path families; or of one of our searches, where that was better.
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


def least_attitude(kind: str, robot: str, number: int) -> PlanningProblem:
    """Return a scenario that asks for the least attitude."""
    problem = scenario(kind, robot, number, turned=False).problem
    return replace(problem, objective=OBJECTIVES["min(Theta)"])


def _steadiness(count: int, settings: PlannerSettings) -> Iterator[Row]:
    """Plan the first scenarios of `BEST_KNOWN` for min(L) and min(Theta), with each depth."""
    for depth in SearchDepth:
        for (kind, robot, number), best in islice(BEST_KNOWN.items(), count):
            steady = least_attitude(kind, robot, number)
            short = replace(steady, objective=OBJECTIVES["min(L)"])
            (shortest, _), (steadiest, outcome) = (
                timed_plan(PlanningTask(one, replace(settings, search=depth)))
                for one in (short, steady)
            )
            row = {"kind": kind, "robot": robot, "number": number, "depth": str(depth)}
            row |= {"shortest": _attitude(shortest), "steadiest": _attitude(steadiest)}
            yield row | {"best_known": best, "seconds": outcome["seconds"]} | _of_best(row, best)


def _attitude(made: Plan | None) -> float | None:
    return made.metrics.max_chaser_euler if made else None


def _of_best(row: Row, best: float | None) -> Row:
    attitude = row["steadiest"]
    return {"of_best": attitude / best if attitude is not None and best else None}


def _has_both(row: Row) -> bool:
    return row["shortest"] is not None and row["steadiest"] is not None


STEADINESS = Experiment(
    "steadiness",
    "Chaser attitude beside the best that is known",
    _steadiness,
    {"search": "depth"},
    {
        "scenarios": columns.count,
        "min(L)": columns.number_of(lambda row: row["shortest"] is not None),
        "min(Theta) too": columns.number_of(_has_both),
        "worse than min(L)": columns.number_of(
            lambda row: _has_both(row) and row["steadiest"] > row["shortest"]
        ),
        "attitude / best, median": columns.value("of_best", form=".2f"),
        "worst": columns.value("of_best", max, ".2f"),
        "processor time, median [s]": columns.value("seconds", form=".2f"),
        "worst [s]": columns.value("seconds", max, ".2f"),
    },
    most=len(BEST_KNOWN),
)

# Processor time after which plans are compared [s].
TIMES = (0.1, 0.2, 0.5, 1.0, 3.0)
_SLSQP_ITERATIONS = 200
# When a plan was found, in processor time [s], and its attitude [rad].
Found: TypeAlias = list[tuple[float, float]]


class _Offers(Watch):
    """Ends a search after a processor time, and records when it found plans."""

    def __init__(self, seconds: float) -> None:
        self._begun, self._seconds = time.process_time(), seconds
        self.found: Found = []

    def require_time(self, _: str = "", /) -> None:
        if time.process_time() - self._begun > self._seconds:
            raise OutOfTime("the time of the benchmark is over")

    def offer(self, plan: Plan) -> None:
        self.found.append((time.process_time() - self._begun, plan.metrics.max_chaser_euler))


def _ours(problem: PlanningProblem, settings: PlannerSettings, seconds: float) -> Found:
    watch = _Offers(seconds)
    with suppress(NoPlanFound, OutOfTime):
        plan_of(problem, settings, watch)
    return watch.found


def _slsqp(
    starts: int | None, problem: PlanningProblem, settings: PlannerSettings, seconds: float
) -> Found:
    """Return what SLSQP with exact gradients finds from so many of our initial guesses in turn."""
    program = path_program(problem, end_effector_paths(problem), settings)
    guesses = program.family.first_guesses(problem.obstacles, program.points, 0.0)
    begun, found = time.process_time(), Found()
    for guess in islice(guesses, starts):
        with suppress(NoPlanFound):
            stop = solve_by_slsqp(program, _SLSQP_ITERATIONS, guess)
            attitude = _checked_attitude(program, settings, stop)
            if attitude is not None:
                found.append((time.process_time() - begun, attitude))
        if time.process_time() - begun > seconds:
            break
    return found


def _checked_attitude(program: PathProgram, settings: PlannerSettings, stop: Stop) -> float | None:
    """Return the attitude of the plan along a path, if that passes the check [rad]."""
    at_x = program.linearise(stop.x)
    if not at_x.is_defined:
        return None
    path = Candidate(at_x, SolverReport(1, 0, stop.rollouts, np.inf, stop.message))
    made, _ = plan_of_path(program.problem, settings, program.family, path)
    task = PlanningTask(program.problem, settings)
    try:
        return perform(task, method=without_search(lambda *_: made)).metrics.max_chaser_euler
    except NoPlanFound:
        return None


# Ours; SLSQP from the straight path alone, and restarted from our initial guesses.
_METHODS: dict[str, Callable[[PlanningProblem, PlannerSettings, float], Found]] = {
    "ours": _ours,
    "SLSQP": partial(_slsqp, 1),
    "with restarts": partial(_slsqp, None),
}


def best_until(found: Found, at: float, best: float | None) -> Row:
    """Return the number of plans found until a time, and the best one's attitude over a known."""
    until = [attitude for then, attitude in found if then <= at]
    row = {"at": at, "plans": len(until), "steadiest": min(until, default=None)}
    return row | _of_best(row, best)


def _after_equal_times(count: int, settings: PlannerSettings) -> Iterator[Row]:
    for (kind, robot, number), best in islice(BEST_KNOWN.items(), count):
        problem = in_own_frame(least_attitude(kind, robot, number))
        for method, search in _METHODS.items():
            found = search(problem, settings, TIMES[-1])
            row = {"kind": kind, "robot": robot, "number": number, "method": method}
            yield from (row | best_until(found, at, best) for at in TIMES)


def _of_method(method: str, cell: Cell) -> Cell:
    return columns.among(cell, lambda row: row["method"] == method)


def _at_least(plans: int) -> Callable[[Row], bool]:
    return lambda row: bool(row["plans"] >= plans)


_quality = columns.value("of_best", form=".2f")


_AFTER = Experiment(
    "equal time",
    "Least attitude after equal times",
    _after_equal_times,
    {"processor time [s]": lambda row: f"{row['at']:g}"},
    {
        "scenarios": _of_method("ours", columns.count),
        "ours: plans": _of_method("ours", columns.number_of(_at_least(1))),
        "better than min(L)": _of_method("ours", columns.number_of(_at_least(2))),
        "attitude / best, median": _of_method("ours", _quality),
        "SLSQP: plans": _of_method("SLSQP", columns.number_of(_at_least(1))),
        "SLSQP: attitude / best, median": _of_method("SLSQP", _quality),
        "with restarts: plans": _of_method("with restarts", columns.number_of(_at_least(1))),
        "with restarts: attitude / best, median": _of_method("with restarts", _quality),
    },
    most=len(BEST_KNOWN),
)


def _with_small_budget(count: int, settings: PlannerSettings) -> Iterator[Row]:
    ordinary, at = SCENARIOS[0], TIMES[1]
    for index in range(count):
        robot, number = ordinary.robot(index), index // len(ordinary.robots)
        found = _ours(in_own_frame(least_attitude("ordinary", robot, number)), settings, at)
        row = {"kind": "ordinary", "robot": robot, "number": number, "method": "ours"}
        yield row | best_until(found, at, None)


_BUDGET = Experiment(
    "equal time",
    "Least attitude with a small budget",
    _with_small_budget,
    {"class": "kind", "processor time [s]": lambda row: f"{row['at']:g}"},
    {
        "scenarios": columns.count,
        "plans": columns.share(_at_least(1)),
        "better than min(L)": columns.share(_at_least(2)),
    },
    most=100,
)
EQUAL_TIME = (_AFTER, _BUDGET)
