"""The wall clock, which says when a search ends."""

from __future__ import annotations

import time
from collections import defaultdict, deque
from typing import TYPE_CHECKING

from ff_planner_ros.errors import OutOfTime
from ff_planner_ros.planning.motion.watch import SEARCHING, Budget, Watch

if TYPE_CHECKING:
    from ff_planner_ros.planning.motion.plan import Plan

# A step is taken to last as long as the longest of so many before it of the same phase.
_REMEMBERED = 5


class TimeBudget(Watch):
    """A watch that ends a search before a step for which the time will not do."""

    def __init__(self, budget: Budget, begun: float | None = None, reserved: float = 0.0) -> None:
        """Count from `begun`, a `time.monotonic()` of any process of this host, or from now on.

        Args:
            reserved: Of the budget, for what comes after the search [s].
        """
        now = time.monotonic()
        self._begun = now if begun is None else begun
        self._budget, self._seconds, self._reserved = budget, budget.seconds, reserved
        self._before = now - self._begun
        self._took = defaultdict[str, float](float)  # by phase [s]
        self._last: tuple[str, float] | None = None  # phase and begin of the last step
        self._lasted = defaultdict[str, deque[float]](lambda: deque(maxlen=_REMEMBERED))

    def require_time(self, phase: str = SEARCHING, /) -> None:
        """Raise OutOfTime once the budget is used up, or nearly so.

        Raises:
            OutOfTime: It is.
        """
        now = time.monotonic()
        if self._last is not None:
            before, begun = self._last
            self._lasted[before].append(now - begun)
            self._took[before] += now - begun
        self._last = phase, now
        deadline = self._begun + self._seconds - self._reserved
        if now + max(self._lasted[phase], default=0.0) > deadline:
            end = OutOfTime(f"the time budget of {self._seconds:g} s is used up")
            end.used_for = self._used_for()
            raise end

    def offer(self, plan: Plan) -> None:  # noqa: ARG002 (that there is one is enough)
        """Allow no more than what counts once there is a plan."""
        self._seconds = min(self._budget)

    def _used_for(self) -> str:
        """Return words on what used the time."""
        parts = {"before the search": self._before, **self._took}
        if self._reserved:
            parts["kept for the answer"] = self._reserved
        return ", ".join(f"{seconds:.2f} s {what}" for what, seconds in parts.items())
