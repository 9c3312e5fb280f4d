"""Watches of a search: they observe its progress, and may end it."""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import EndedBy, OutOfTime

if TYPE_CHECKING:
    from ff_planner_ros.planning.motion.metrics import Metrics
    from ff_planner_ros.planning.motion.plan import Plan

Value = TypeVar("Value")

SEARCHING, REFINING, CHECKING = "searching", "refining", "checking"


class Budget(NamedTuple):
    """Wall-clock time that a search may take."""

    seconds: float  # until there is a plan, or a refusal [s]
    with_plan: float = math.inf  # in all, once there is a plan [s]


class Progress(NamedTuple):
    """How far a search has come."""

    phase: str  # SEARCHING on the coarse grid, REFINING on the fine grid, or CHECKING
    starts: int  # initial guesses tried
    iterations: int  # paths evaluated with derivatives, for all initial guesses
    objective: float  # of the path evaluated last
    violation: float  # of its worst constraint [m, rad or rad/s]
    step: int = 0  # of the search, as `Steps` counts them
    best: Metrics | None = None  # of the best plan until then; None: there is none yet


class Watch:
    """Observes the progress of a search, and may end it; this base class ignores it."""

    def require_time(self, phase: str = SEARCHING, /) -> None:
        """Called before every step of a search; raises OutOfTime to end it."""

    def time_left(self) -> float:
        """Return how long the step that begins may take, be it unfinished then [s]."""
        return math.inf

    def cut_short(self) -> OutOfTime:
        """Called when a step was ended after that time; return what ends the search."""
        return OutOfTime("a step took too long")

    def report(self, progress: Progress) -> None:
        """Called after every iteration, and before a path is checked.

        Of a part that runs beside others it is called once, when the search goes on from there.
        """

    def offer(self, plan: Plan) -> None:
        """Called with every plan that passed the check."""

    def share(self, searches: int) -> Watch:  # noqa: ARG002 (without a clock there is no end)
        """Return the watch of the next of so many consecutive searches."""
        return self

    def aside(self) -> Aside:
        """Return the watch of a part of the search that runs beside others."""
        return Aside(self)

    def passed(self, steps: int, end: OutOfTime | None = None) -> None:  # noqa: ARG002 (not counted)
        """Called with the number of steps of a part that ran beside others.

        Args:
            end: What ended the part early; it ends the search.

        Raises:
            OutOfTime: `end`, or the search was to end at one of the steps.
        """
        if end is not None:
            raise end


class PassingOn(Watch):
    """A watch that forwards every call to another one; subclasses override some."""

    def __init__(self, watch: Watch) -> None:
        """Forward to a watch."""
        self._watch = watch

    def require_time(self, phase: str = SEARCHING, /) -> None:
        """Forward the call."""
        self._watch.require_time(phase)

    def time_left(self) -> float:
        """Forward the call."""
        return self._watch.time_left()

    def cut_short(self) -> OutOfTime:
        """Forward the call."""
        return self._watch.cut_short()

    def report(self, progress: Progress) -> None:
        """Forward the call."""
        self._watch.report(progress)

    def offer(self, plan: Plan) -> None:
        """Forward the call."""
        self._watch.offer(plan)

    def share(self, searches: int) -> Watch:
        """Return a copy that forwards to the share of the other watch."""
        one = copy(self)
        one._watch = self._watch.share(searches)  # noqa: SLF001 (of its own class)
        return one

    def aside(self) -> Aside:
        """Forward the call."""
        return self._watch.aside()

    def passed(self, steps: int, end: OutOfTime | None = None) -> None:
        """Forward the call."""
        self._watch.passed(steps, end)


class Aside(PassingOn):
    """A watch of a part that runs beside others: it may end the part, and counts its steps."""

    def __init__(self, watch: Watch) -> None:
        """Forward nothing but `require_time`."""
        super().__init__(watch)
        self.steps = 0
        self.progress: Progress | None = None  # last one; None: the part has reported none

    def require_time(self, phase: str = SEARCHING, /) -> None:
        """Count a step."""
        super().require_time(phase)
        self.steps += 1

    def report(self, progress: Progress) -> None:
        """Keep the progress, for the search that the part belongs to."""
        self.progress = progress

    def offer(self, plan: Plan) -> None:
        """Keep the plan back: the search that the part belongs to offers it."""


class Steps(PassingOn):
    """Counts the steps of a search, which do not depend on the clock, and ends it at a step."""

    def __init__(self, watch: Watch, last: int = 0) -> None:
        """Count from 1; last: the step at which the search ends, zero: no limit."""
        super().__init__(watch)
        self._last, self._step = last, 1
        self.ended_at = 0  # the step at which the search was ended; zero: it was not

    def require_time(self, phase: str = SEARCHING, /) -> None:
        """Count a step.

        Raises:
            OutOfTime: The step is the last one, or the other watch ends the search. Every call
                after that raises it, too.
        """
        self._require_before_last(1)
        try:
            self._watch.require_time(phase)
        except OutOfTime:
            self._end_here()
            raise
        self._step += 1

    def cut_short(self) -> OutOfTime:
        """Take the step that was begun last as the last one: nothing of it counts."""
        self._step -= 1
        self._end_here()
        return super().cut_short()

    def passed(self, steps: int, end: OutOfTime | None = None) -> None:
        """Count steps.

        Raises:
            OutOfTime: One of them is the last one, or the part was ended.
        """
        self._require_before_last(steps)
        try:
            super().passed(steps, end)
        except OutOfTime:
            self._end_here()
            raise
        self._step += steps

    def _require_before_last(self, steps: int) -> None:
        """Raise OutOfTime if one of the next steps is the last one."""
        if self._step <= self._last < self._step + steps:
            self.ended_at = self._last
            raise OutOfTime(f"the search ends at step {self._last}", EndedBy.EFFORT)

    def _end_here(self) -> None:
        """Remember that the other watch ended the search at the present step."""
        self.ended_at = self._last = self._step

    def report(self, progress: Progress) -> None:
        """Forward the progress with the present step."""
        super().report(progress._replace(step=self._step))


def in_time(watch: Watch, step: Callable[[Array], Value], x: Array) -> Value:
    """Return what a step computes of x; the core ends it when the watch's time for it is over.

    Raises:
        OutOfTime: It is over.
    """
    left = watch.time_left()
    if left == math.inf:
        return step(x)
    try:
        with compiled.Deadline(left):
            return step(x)
    except compiled.DeadlineOver:
        raise watch.cut_short() from None
