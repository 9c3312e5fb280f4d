"""Chaser attitude of minimum-attitude plans, beside the best known plans and SLSQP's."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from typing import TypeAlias

import numpy as np

from ff_planner_benchmark.bench.direct import Stop
from ff_planner_benchmark.bench.exact import solve_by_slsqp
from ff_planner_benchmark.bench.measurement import OBJECTIVES, Measurement, median, timed_plan
from ff_planner_ros.common.intervals import percent
from ff_planner_ros.common.text_table import Table
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
from ff_planner_ros.problems.robots import ROBOTS
from ff_planner_ros.problems.scenarios import scenario

# Processor times at which plans were found [s], and their attitudes [rad].
_Found: TypeAlias = tuple[tuple[float, ...], tuple[float, ...]]

_HEADER = (
    *("search", "scenarios", "min(L)", "min(Theta) too", "worse than min(L)"),
    *("attitude / best, median", "worst", "processor time, median [s]", "worst [s]"),
)
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


@dataclass(frozen=True)
class Steadiness:
    """Chaser attitudes of the plans of one scenario."""

    kind: str
    robot: str
    number: int
    depth: SearchDepth
    seconds: float  # processor time of the minimum-attitude plan
    shortest: float | None  # attitude of the minimum-path plan [rad]; None: there is none
    steadiest: float | None  # attitude of the minimum-attitude plan [rad]; None: there is none
    best_known: float  # [rad]


def measurement(count: int, settings: PlannerSettings) -> Measurement:
    """Plan the first `count` scenarios of `BEST_KNOWN`, with each depth of search."""
    done = [each for depth in SearchDepth for each in steadiness(count, depth, settings)]
    rows = [
        (str(depth), *_nearness([each for each in done if each.depth is depth]))
        for depth in SearchDepth
    ]
    title = "Chaser attitude beside the best that is known"
    return Measurement(done, [Table(title, _HEADER, rows)])


def steadiness(count: int, depth: SearchDepth, settings: PlannerSettings) -> Iterator[Steadiness]:
    """Plan the first `count` scenarios of `BEST_KNOWN` for min(L) and for min(Theta)."""
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


# Processor time after which plans are compared [s].
TIMES = (0.1, 0.2, 0.5, 1.0, 3.0)
_SLSQP_ITERATIONS = 200
_TIMES_HEADER = (
    *("processor time [s]", "scenarios", "ours: plans", "better than min(L)"),
    *("attitude / best, median", "SLSQP: plans", "attitude / best, median"),
    *("with restarts: plans", "attitude / best, median"),
)
_SHARES_HEADER = ("class", "processor time [s]", "scenarios", "plans", "better than min(L)")


@dataclass(frozen=True)
class EqualTime:
    """Attitudes of a method's plans for one scenario that pass the check, over processor time."""

    kind: str
    robot: str
    number: int
    method: str
    best_known: float | None  # [rad]; None: it is not known
    found_after: tuple[float, ...]  # processor time at which each plan was found [s]
    attitudes: tuple[float, ...]  # of each plan [rad]

    def at(self, seconds: float) -> tuple[int, float | None]:
        """Return the number of plans found until a time, and the attitude of the best [rad]."""
        until = [a for t, a in zip(self.found_after, self.attitudes, strict=True) if t <= seconds]
        return len(until), min(until, default=None)


def equal_time_measurement(count: int, ordinary: int, settings: PlannerSettings) -> Measurement:
    """Compare the methods' plans after equal processor times.

    Args:
        count: Number of scenarios of `BEST_KNOWN`.
        ordinary: Number of ordinary scenarios that only our planner solves, in the second of
            `TIMES`.
    """
    known = list(islice(BEST_KNOWN.items(), count))
    methods = {"ours": _ours, "SLSQP": _slsqp, "with restarts": _slsqp_with_restarts}
    results = [
        EqualTime(*key, method, best, *search(_least_attitude(*key), settings, TIMES[-1]))
        for key, best in known
        for method, search in methods.items()
    ]
    rows = [(f"{at:g}", f"{count}", *_qualities(results, methods, at)) for at in TIMES]
    drawn = [("ordinary", ROBOTS[n % len(ROBOTS)], n // len(ROBOTS)) for n in range(ordinary)]
    at = TIMES[1]
    small = [
        EqualTime(*key, "ours", None, *_ours(_least_attitude(*key), settings, at)) for key in drawn
    ]
    has, better = ([each.at(at)[0] >= least for each in small] for least in (1, 2))
    share = (
        "ordinary",
        f"{at:g}",
        f"{len(small)}",
        percent(float(np.mean(has))),
        percent(float(np.mean(better))),
    )
    tables = [
        Table("Least attitude after equal times", _TIMES_HEADER, rows),
        Table("Least attitude with a small budget", _SHARES_HEADER, [share]),
    ]
    return Measurement([*results, *small], tables)


def _qualities(
    results: Sequence[EqualTime], methods: Iterable[str], seconds: float
) -> Iterator[str]:
    """Yield cells of each method: number of scenarios with a plan after a time, and its quality."""
    for method in methods:
        group = [(each, *each.at(seconds)) for each in results if each.method == method]
        found = [a / each.best_known for each, _, a in group if a is not None and each.best_known]
        yield f"{len(found)}"
        if method == "ours":
            yield f"{sum(plans > 1 for _, plans, _ in group)}"
        yield median(found, 2)


def _least_attitude(kind: str, robot: str, number: int) -> PlanningProblem:
    problem = scenario(kind, robot, number, turned=False).problem
    return in_own_frame(replace(problem, objective=OBJECTIVES["min(Theta)"]))


class _Offers(Watch):
    """Ends a search after a processor time, and records when it found plans."""

    def __init__(self, seconds: float) -> None:
        self._begun, self._seconds = time.process_time(), seconds
        self.found = list[tuple[float, float]]()

    def require_time(self, _: str = "", /) -> None:
        if time.process_time() - self._begun > self._seconds:
            raise OutOfTime("the time of the benchmark is over")

    def offer(self, plan: Plan) -> None:
        self.found.append((time.process_time() - self._begun, plan.metrics.max_chaser_euler))


def _ours(problem: PlanningProblem, settings: PlannerSettings, seconds: float) -> _Found:
    """Return the processor times at which our search found plans, and their attitudes."""
    watch = _Offers(seconds)
    with suppress(NoPlanFound, OutOfTime):
        plan_of(problem, settings, watch)
    return _in_columns(watch.found)


def _slsqp(problem: PlanningProblem, settings: PlannerSettings, seconds: float) -> _Found:
    """Return the same of SLSQP with exact gradients, from the straight path alone."""
    return _slsqp_from(problem, settings, seconds, 1)


def _slsqp_with_restarts(
    problem: PlanningProblem, settings: PlannerSettings, seconds: float
) -> _Found:
    """Return the same of SLSQP, started from our initial guesses in turn."""
    return _slsqp_from(problem, settings, seconds, None)


def _slsqp_from(
    problem: PlanningProblem, settings: PlannerSettings, seconds: float, starts: int | None
) -> _Found:
    program = path_program(problem, end_effector_paths(problem), settings)
    guesses = program.family.first_guesses(problem.spheres, program.points, 0.0)
    begun, found = time.process_time(), list[tuple[float, float]]()
    for guess in islice(guesses, starts):
        with suppress(NoPlanFound):
            stop = solve_by_slsqp(program, _SLSQP_ITERATIONS, guess)
            attitude = _checked_attitude(program, settings, stop)
            if attitude is not None:
                found.append((time.process_time() - begun, attitude))
        if time.process_time() - begun > seconds:
            break
    return _in_columns(found)


def _checked_attitude(program: PathProgram, settings: PlannerSettings, stop: Stop) -> float | None:
    """Return the attitude of the plan along a path, if that passes the check [rad]."""
    at_x = program.linearise(stop.x)
    if not at_x.is_defined:
        return None
    path = Candidate(at_x, SolverReport(1, 0, stop.rollouts, np.inf, stop.message))
    made = plan_of_path(program.problem, settings, program.family, path)
    task = PlanningTask(program.problem, settings)
    try:
        return perform(task, method=without_search(lambda *_: made)).metrics.max_chaser_euler
    except NoPlanFound:
        return None


def _in_columns(found: Sequence[tuple[float, float]]) -> _Found:
    return tuple(at for at, _ in found), tuple(attitude for _, attitude in found)


def _nearness(group: Sequence[Steadiness]) -> Iterator[str]:
    pairs = [(each.shortest, each.steadiest) for each in group if each.shortest is not None]
    both = [(short, steady) for short, steady in pairs if steady is not None]
    yield from (f"{len(group)}", f"{len(pairs)}", f"{len(both)}")
    yield f"{sum(steady > short for short, steady in both)}"
    ratios = [e.steadiest / e.best_known for e in group if e.steadiest is not None]
    seconds = [each.seconds for each in group]
    yield from (median(ratios, 2), f"{max(ratios):.2f}" if ratios else "-")
    yield from (f"{np.median(seconds):.2f}", f"{max(seconds):.2f}")
