"""The time budget of a search, by the wall clock."""

from __future__ import annotations

import math
import statistics
import time
from collections import defaultdict, deque
from typing import TYPE_CHECKING

from ff_planner_ros.errors import OutOfTime
from ff_planner_ros.planning.motion.watch import CHECKING, SEARCHING, Budget, Watch

if TYPE_CHECKING:
    from ff_planner_ros.planning.motion.plan import Plan

# A step is predicted to last as long as the longest of the last so many of the same phase.
_REMEMBERED = 5
# The first check, which goes between the points, is predicted to last as long as so many steps
# before it: of four arms, with lines and with shapes, it was 4 to 10. By the median, since a step
# that waited for the processor predicts nothing; and the first step alone, which loads what the
# others find loaded, counts once.
_STEPS_OF_A_CHECK = 8.0


class TimeBudget(Watch):
    """A watch that ends a search before a step that would exceed the time budget."""

    def __init__(self, budget: Budget, begun: float | None = None, reserved: float = 0.0) -> None:
        """Count from `begun`, a `time.monotonic()` of any process of this host, or from now on.

        Args:
            reserved: Part of the budget that is kept for the time after the search [s].
        """
        now = time.monotonic()
        self._begun = now if begun is None else begun
        self._budget, self._seconds, self._reserved = budget, budget.seconds, reserved
        self._before = now - self._begun
        self._took = defaultdict[str, float](float)  # by phase [s]
        self._last: tuple[str, float] | None = None  # phase and begin of the last step
        self._latest = math.inf  # `time.monotonic()` at which that step ends
        self._lasted = defaultdict[str, deque[float]](lambda: deque(maxlen=_REMEMBERED))

    def require_time(self, phase: str = SEARCHING, /) -> None:
        """Called before every step of a search; raises OutOfTime if the time left is too short.

        The time left must suffice for a check, and for the step before it unless the step is the
        check itself: every answer, plan or refusal, needs one. Durations are predicted from past
        steps.

        Raises:
            OutOfTime: The budget is used up, or would be.
        """
        now = self._count_last()
        self._last = phase, now
        deadline = self._begun + self._seconds - self._reserved
        check = self._check()
        self._latest = deadline - check
        step = check if phase == CHECKING else check + max(self._lasted[phase], default=0.0)
        if now + step > deadline:
            raise self._used_up(foreseen=min(step, deadline - now))

    def time_left(self) -> float:
        """Return how long the step may take that a check still has its time after it [s]."""
        return self._latest - time.monotonic()

    def cut_short(self) -> OutOfTime:
        """Return what ends the search after a step that took longer than foreseen."""
        self._count_last()
        self._last = None
        return self._used_up(foreseen=0.0)

    def _count_last(self) -> float:
        """Count how long the last step took, and return the time."""
        now = time.monotonic()
        if self._last is not None:
            before, begun = self._last
            self._lasted[before].append(now - begun)
            self._took[before] += now - begun
        return now

    def _used_up(self, foreseen: float) -> OutOfTime:
        """Return the error; foreseen: what the next step would have used [s]."""
        end = OutOfTime(f"the time budget of {self._seconds:g} s is used up")
        end.used_for = self._used_for(foreseen)
        return end

    def _check(self) -> float:
        """Return how long a check is taken to last [s]."""
        checks = self._lasted[CHECKING]
        if checks:
            return max(checks)
        steps = [lasted for phase in self._lasted.values() for lasted in phase]
        if len(steps) <= 1:
            return sum(steps)
        return _STEPS_OF_A_CHECK * statistics.median_low(steps)

    def share(self, searches: int) -> TimeBudget:
        """Return the budget of the next of so many searches: an equal share of the time left."""
        if searches == 1:
            return self
        used = time.monotonic() - self._begun
        left = max(self._seconds - self._reserved - used, 0.0)
        budget = Budget(used + left / searches, min(self._budget))
        return TimeBudget(budget, self._begun)

    def offer(self, plan: Plan) -> None:  # noqa: ARG002 (that there is one is enough)
        """Reduce the budget to the one that applies once there is a plan."""
        self._seconds = min(self._budget)

    def _used_for(self, foreseen: float) -> str:
        """Return words on what used the time; foreseen: what the next step would have used [s]."""
        parts = {"before the search": self._before, **self._took}
        if foreseen > 0.0:
            parts["too short for the next step and its check"] = foreseen
        if self._reserved:
            parts["kept for the answer"] = self._reserved
        return ", ".join(f"{seconds:.2f} s {what}" for what, seconds in parts.items())
