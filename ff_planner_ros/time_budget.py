"""The wall clock's only say in planning: whether there is a plan, never which."""

from __future__ import annotations

import time

from ff_planner_ros.errors import OutOfTime
from ff_planner_ros.planning.motion.watch import Watch


class TimeBudget(Watch):
    """A watch that ends a search once its time is used up."""

    def __init__(self, seconds: float, begun: float | None = None) -> None:
        """Count from `begun`, a `time.monotonic()` of any process of this host, or from now on."""
        self._seconds = seconds
        self._deadline = (time.monotonic() if begun is None else begun) + seconds

    def require_time(self) -> None:
        """Raise OutOfTime once the budget is used up.

        Raises:
            OutOfTime: It is.
        """
        if time.monotonic() > self._deadline:
            raise OutOfTime(f"the time budget of {self._seconds:g} s is used up")
