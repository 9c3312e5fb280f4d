"""The fastest captures, where the planner chooses the duration: how often, how soon, how fast.

Of the witness of each problem it is known that it arrives after its duration. A sweep over fixed
durations that are shorter than the one chosen says whether the planner could have been faster.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from ff_planner_ros.bench.success import Stopwatch, solved_and_times
from ff_planner_ros.errors import FfPlannerError, NoPlanFound, Status
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Objective,
    PlanningProblem,
    lasting,
)
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems import tumbling

HEADER = (
    *("from", "problems", "solved", "median [s]", "95 % [s]", "slowest of the witness's"),
    "slowest of the sweep's",
)
# Ranges of durations, in parts of the witness's: about it, and down to what no arm can do.
RANGES = {"70 %": (0.7, 1.3), "10 %": (0.1, 1.3)}
# Of the sweep, in parts of the duration that was chosen, the longest first.
_SWEPT = (0.98, 0.96, 0.94, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5)


@dataclass(frozen=True)
class FreeAttempt:
    """What became of one problem."""

    shortest: str  # key of `RANGES`
    number: int
    status: Status
    message: str  # cause of a miss; empty if solved
    seconds: float  # that the planner took
    # The duration that was chosen, in parts of the witness's and of the shortest that the sweep
    # found, which is at most 1 where it found none; None for a miss
    of_witness: float | None = None
    of_sweep: float | None = None


def fastest(problem: PlanningProblem, part: tuple[float, float]) -> PlanningProblem:
    """Return a problem that asks for the fastest capture, in parts of its duration."""
    shortest, longest = (one * problem.duration for one in part)
    body = problem.target_body
    return replace(
        problem,
        duration=longest,
        target=problem.target if body is None else body.target(longest),
        duration_range=DurationRange(shortest, longest),
        objective=Objective(0.0, 0.0, duration=1.0),
    )


def free_attempts(count: int, settings: PlannerSettings, *, sweep: bool) -> Iterator[FreeAttempt]:
    """Plan so many problems in each range; without a sweep in the first one only."""
    for name, part in list(RANGES.items())[: None if sweep else 1]:
        for number, given in enumerate(tumbling.problems("tumbling", count)):
            problem, stopwatch = fastest(given, part), Stopwatch()
            try:
                chosen = perform(PlanningTask(problem, settings), method=stopwatch).duration
            except FfPlannerError as error:
                yield FreeAttempt(name, number, error.status, str(error), stopwatch.seconds)
                continue
            chosen = problem.duration if chosen is None else chosen
            swept = _swept(problem, chosen, settings) if sweep else chosen
            parts = chosen / given.duration, chosen / swept
            yield FreeAttempt(name, number, Status.SOLVED, "", stopwatch.seconds, *parts)


def free_rows(tried: Sequence[FreeAttempt]) -> Iterator[tuple[str, ...]]:
    """Yield a row for each range: `HEADER`."""
    for name in dict.fromkeys(each.shortest for each in tried):
        group = [each for each in tried if each.shortest == name]
        solved = [each for each in group if each.status is Status.SOLVED]
        yield (
            name,
            *solved_and_times(
                [each.status is Status.SOLVED for each in group], [each.seconds for each in group]
            ),
            f"{max((each.of_witness or 0.0 for each in solved), default=0.0):.3f}",
            f"{max((each.of_sweep or 0.0 for each in solved), default=0.0):.3f}",
        )


def _swept(problem: PlanningProblem, chosen: float, settings: PlannerSettings) -> float:
    """Return the shortest duration [s], of fixed ones up to the one chosen, that has a plan."""
    found = chosen
    for part in _SWEPT:
        if part * chosen >= problem.durations.minimum:
            try:
                perform(PlanningTask(lasting(problem, part * chosen), settings))
            except NoPlanFound:
                continue
            found = part * chosen
    return found
