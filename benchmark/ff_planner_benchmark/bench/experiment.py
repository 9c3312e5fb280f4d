"""Experiments: problems planned in variations, and a table of what became of them."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

from ff_planner_benchmark.problems.classes import ProblemClass
from ff_planner_ros.common.text_table import Table
from ff_planner_ros.errors import FfPlannerError, NoPlanFound, Status
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.watch import Watch
from ff_planner_ros.planning.problem.problem import Objective, PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.search.planner import FirstGuess, plan
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.drawn import Drawn

# What became of one problem, with what tells it from the others: values that JSON has.
Row: TypeAlias = dict[str, Any]
Rows: TypeAlias = Sequence[Row]
Cell: TypeAlias = Callable[[Rows], str]
# A row's value by name, or a function of the row.
Key: TypeAlias = str | Callable[[Row], str]
Rower: TypeAlias = Callable[[int, PlannerSettings], Iterable[Row]]

OBJECTIVES = {
    "min(L)": Objective(1.0, 0.0),
    "min(Theta)": Objective(0.0, 1.0),
    "L + Theta": Objective(1.0, 1.0),
}
SOLVED = Status.SOLVED.name


@dataclass(frozen=True)
class Experiment:
    """Problems that are planned, and the columns of a table of the results."""

    name: str
    title: str  # of the table
    rows: Rower  # plans so many problems of each class
    groups: Mapping[str, Key]  # a line of the table for all rows with equal values of these
    columns: Mapping[str, Cell]
    # In each group a line for all rows, and for those with each value of these; its first cell's
    # column is called `part`
    parts: Sequence[Key] = ()
    part: str = "which"
    most: int | None = None  # problems of each class, of which a quick run has one; None: no limit
    remark: Callable[[Row], str] = lambda _: ""  # a line of text on a row; empty: none

    def count(self, scenarios: int, *, quick: bool) -> int:
        """Return how many problems of each class are planned."""
        return scenarios if self.most is None else 1 if quick else min(scenarios, self.most)

    def table(self, rows: Rows) -> Table:
        """Return the table of all rows."""
        lines = list[tuple[str, ...]]()
        for first, group in grouped(rows, *self.groups.values()):
            found: list[tuple[tuple[str, ...], Rows]] = [(("all",) * bool(self.parts), group)]
            found += [one for key in self.parts for one in grouped(group, key)]
            lines += [
                (*first, *part, *(cell(some) for cell in self.columns.values()))
                for part, some in found
            ]
        part = [self.part] if self.parts else []
        return Table(self.title, [*self.groups, *part, *self.columns], lines)


def grouped(rows: Rows, *keys: Key) -> Iterator[tuple[tuple[str, ...], Rows]]:
    """Yield the rows of equal values of all keys, with these; in order of their first row."""
    groups = dict[tuple[str, ...], list[Row]]()
    for row in rows:
        values = tuple(str(row[key]) if isinstance(key, str) else key(row) for key in keys)
        groups.setdefault(values, []).append(row)
    yield from groups.items()


def each(
    classes: Iterable[ProblemClass],
    vary: Callable[[ProblemClass, int, PlannerSettings], Iterable[Row]],
) -> Rower:
    """Return the rows of so many problems of each class, each varied and planned by `vary`."""

    def rows(count: int, settings: PlannerSettings) -> Iterator[Row]:
        for one in classes:
            for number in range(count):
                yield from vary(one, number, settings)

    return rows


def attempt(
    task: PlanningTask, measured: Callable[[Plan | None], Row] = lambda _: {}, **labels: Any
) -> Row:
    """Plan a task, and return the row of it: labels, what is measured, and how it ended."""
    made, outcome = timed_plan(task)
    return labels | measured(made) | outcome


def planned(
    measured: Callable[[Drawn[Any], Plan | None], Row] = lambda *_: {},
) -> Callable[[ProblemClass, int, PlannerSettings], Iterator[Row]]:
    """Return how a problem is planned as it is, and what of it and its plan is measured."""

    def vary(one: ProblemClass, number: int, settings: PlannerSettings) -> Iterator[Row]:
        drawn = one.draw(number)
        labels = {"kind": one.name, "robot": one.robot(number), "number": number}
        yield attempt(drawn.task(settings), partial(measured, drawn), **labels)

    return vary


def is_solved(row: Row) -> bool:
    """Tell whether there is a plan, and it passes the check."""
    return bool(row["status"] == SOLVED)


def missed(name: str, among: Callable[[Row], bool] = lambda _: True) -> Callable[[Row], str]:
    """Return remarks on rows without a plan, by a name that has values of the row in braces."""

    def remark(row: Row) -> str:
        if is_solved(row) or not among(row):
            return ""
        return f"missed: {name.format_map(row)}: {row['status']}: {row['message']}"

    return remark


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
        """Plan; `perform` computes the metrics of another method than its own anew."""
        begun = time.process_time()
        try:
            return plan(problem, settings, watch, guess)
        finally:
            self.seconds = time.process_time() - begun


def timed_plan(task: PlanningTask) -> tuple[Plan | None, Row]:
    """Return the plan of a task, None where there is none, and status, message and seconds."""
    stopwatch, made, status, message = Stopwatch(), None, Status.SOLVED, ""
    try:
        made = perform(task, method=stopwatch)
    except FfPlannerError as error:
        status, message = error.status, str(error)
    return made, {"status": status.name, "message": message, "seconds": stopwatch.seconds}


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
        raise NoPlanFound(Status[last["status"]], last["message"])
    return [made for made, _ in timed if made], statistics.median(seconds)
