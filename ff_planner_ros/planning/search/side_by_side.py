"""Parts of a search that do not depend on each other, computed side by side.

What they found and took counts in their order, so that neither the results of the search nor its
count of steps depend on the number of processes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Generic, TypeVar

from ff_planner_ros.errors import OutOfTime
from ff_planner_ros.planning.motion.watch import Progress, Watch
from ff_planner_ros.planning.optimisation.workers import Workers
from ff_planner_ros.planning.search.candidate import Effort

Part = TypeVar("Part")
Value = TypeVar("Value")


@dataclass(frozen=True, eq=False)
class _Outcome(Generic[Value]):
    """What a part of a search found, and what it took."""

    value: Value | OutOfTime  # or what ended it
    steps: int
    effort: Effort
    progress: Progress | None  # of its last iteration


class SideBySide(Generic[Part, Value]):
    """Computes parts of a search in several processes, until it is closed."""

    def __init__(
        self,
        compute: Callable[[Part, Watch, Effort], Value],
        watch: Watch,
        effort: Effort,
        threads: int,
    ) -> None:
        """Prepare to compute.

        Args:
            compute: Computes a part under a watch, and adds to an effort; what it changes beside
                that is lost.
            watch: That of the search.
            effort: That of the search.
            threads: Most processes, this one included.
        """
        self._watch, self._effort = watch, effort
        self._workers = Workers(partial(_outcome, compute, watch), threads)

    def close(self) -> None:
        """End the processes."""
        self._workers.close()

    def values(self, parts: Sequence[Part]) -> Iterator[Value]:
        """Yield the values of parts in their order; a part that is not asked for does not count.

        Raises:
            OutOfTime: By the watch.
        """
        for found in self._workers.results(parts):
            if isinstance(found.value, OutOfTime):
                self._watch.passed(0, found.value)
                raise found.value
            self._watch.passed(found.steps)
            self._effort.add(found.effort)
            if found.progress is not None:
                starts, rollouts = self._effort.starts, self._effort.rollouts
                self._watch.report(found.progress._replace(starts=starts, iterations=rollouts))
            yield found.value


def _outcome(
    compute: Callable[[Part, Watch, Effort], Value], watch: Watch, part: Part
) -> _Outcome[Value]:
    aside, effort = watch.aside(), Effort()
    value: Value | OutOfTime
    try:
        value = compute(part, aside, effort)
    except OutOfTime as end:
        value = end
    return _Outcome(value, aside.steps, effort, aside.progress)
