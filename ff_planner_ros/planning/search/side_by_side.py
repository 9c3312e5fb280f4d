"""Parts of a search that do not depend on each other, computed side by side.

Each part begins with what the search knew before all of them, and what they found is taken over in
their order: neither the results nor the count of steps depends on the number of processes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Generic, NamedTuple, Protocol, TypeAlias, TypeVar

from ff_planner_ros.errors import OutOfTime
from ff_planner_ros.planning.motion.watch import Progress
from ff_planner_ros.planning.optimisation.workers import Workers
from ff_planner_ros.planning.search.candidate import Effort
from ff_planner_ros.planning.search.grid_solver import GridSolver


class Search(Protocol):
    """What has parts: their solver is its own, or one of theirs."""

    solver: GridSolver


Of = TypeVar("Of", bound=Search)
Value = TypeVar("Value")


class Part(NamedTuple, Generic[Of, Value]):
    """A part of a search, as it is sent to another process."""

    compute: Callable[[Of], Value]
    on_demand: frozenset[str]  # requirements that have no rows yet


@dataclass(frozen=True, eq=False)
class Outcome(Generic[Value]):
    """What a part of a search found, and what it took."""

    value: Value | OutOfTime  # or what ended it
    steps: int
    effort: Effort
    progress: Progress | None  # of its last iteration
    on_demand: frozenset[str]


Helpers: TypeAlias = Workers[Part[Of, Any], Outcome[Any]]


def helpers_of(search: Of) -> Helpers[Of]:
    """Return processes that compute parts of a search, at most `planner.threads`."""
    return Workers(partial(_outcome, search), search.solver.settings.threads)


def side_by_side(
    helpers: Helpers[Of],
    solver: GridSolver,
    parts: Sequence[Callable[[Of], Value]],
) -> Iterator[Value]:
    """Yield the values of parts in their order, once all are computed.

    Raises:
        OutOfTime: By the watch.
    """
    on_demand = solver.program.on_demand
    for found in helpers.results([Part(part, on_demand) for part in parts]):
        if isinstance(found.value, OutOfTime):
            solver.watch.passed(0, found.value)
            raise found.value
        solver.watch.passed(found.steps)
        solver.take_over(found.effort, found.on_demand)
        if found.progress is not None:
            starts, rollouts = solver.effort.starts, solver.effort.rollouts
            solver.watch.report(replace(found.progress, starts=starts, iterations=rollouts))
        yield found.value


def _outcome(search: Of, part: Part[Of, Value]) -> Outcome[Value]:
    """Compute a part with a solver of its own."""
    aside, own = search.solver.watch.aside(), copy(search)
    own.solver = search.solver.beside(aside, part.on_demand)
    value: Value | OutOfTime
    try:
        value = part.compute(own)
    except OutOfTime as end:
        value = end
    solver = own.solver
    return Outcome(value, aside.steps, solver.effort, aside.progress, solver.program.on_demand)
