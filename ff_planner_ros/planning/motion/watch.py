"""The progress of a search, and what may end it."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

from ff_planner_ros.errors import EndedBy, OutOfTime

if TYPE_CHECKING:
    from ff_planner_ros.planning.motion.metrics import Metrics
    from ff_planner_ros.planning.motion.plan import Plan

SEARCHING, REFINING, CHECKING = "searching", "refining", "checking"


class Budget(NamedTuple):
    """Time that a search may take."""

    seconds: float
    with_plan: float = math.inf  # once there is a plan: no more than so long in all [s]


@dataclass(frozen=True)
class Progress:
    """How far a search has come."""

    phase: str  # SEARCHING on few points, REFINING on all of them, CHECKING what was found
    starts: int  # first guesses tried
    iterations: int  # paths looked at with their derivatives, over all starts
    objective: float  # of the path last looked at
    violation: float  # by how much it violates its worst constraint [m, rad or rad/s]
    step: int = 0  # of the search, as `Steps` counts them
    best: Metrics | None = None  # of the best plan until then; None: there is none yet


class Watch:
    """Is told of the progress of a search, and may end it. This one does neither."""

    def require_time(self, phase: str = SEARCHING, /) -> None:
        """Called before every step of a search; raises OutOfTime to end it."""

    def report(self, progress: Progress) -> None:
        """Called after every iteration, and before a path is checked."""

    def offer(self, plan: Plan) -> None:
        """Called with every plan that passed the check."""

    def share(self, searches: int) -> Watch:  # noqa: ARG002 (without a clock there is no end)
        """Return the watch of a search, after which so many less one follow it."""
        return self


class PassingOn(Watch):
    """Passes on to another watch whatever it does not do itself."""

    def __init__(self, watch: Watch) -> None:
        """Watch together with another one."""
        self._watch = watch

    def require_time(self, phase: str = SEARCHING, /) -> None:
        """Pass it on."""
        self._watch.require_time(phase)

    def report(self, progress: Progress) -> None:
        """Pass it on."""
        self._watch.report(progress)

    def offer(self, plan: Plan) -> None:
        """Pass it on."""
        self._watch.offer(plan)

    def share(self, searches: int) -> Watch:
        """Return a watch that passes on to another's share."""
        one = copy(self)
        one._watch = self._watch.share(searches)  # noqa: SLF001 (of its own class)
        return one


class Steps(PassingOn):
    """Counts the steps of a search, which do not depend on the clock, and ends it at a step."""

    def __init__(self, watch: Watch, last: int = 0) -> None:
        """Begin to count; last: the step at which the search ends; zero: none."""
        super().__init__(watch)
        self._last, self._step = last, 1
        self.ended_at = 0  # the step at which the search was ended; zero: it was not

    def require_time(self, phase: str = SEARCHING, /) -> None:
        """Count a step.

        Raises:
            OutOfTime: It is the last one, or the other watch ends the search. From then on every
                step is the last one.
        """
        if self._step == self._last:
            self.ended_at = self._last
            raise OutOfTime(f"the search ends at step {self._last}", EndedBy.EFFORT)
        try:
            self._watch.require_time(phase)
        except OutOfTime:
            self.ended_at = self._last = self._step
            raise
        self._step += 1

    def report(self, progress: Progress) -> None:
        """Tell the step, too."""
        super().report(replace(progress, step=self._step))
