"""The wall clock's only say in planning: whether there is an answer, never which."""

from __future__ import annotations

import time
from collections.abc import Callable

from ff_planner_ros.errors import OutOfTime


def time_budget(seconds: float, begun: float | None = None) -> Callable[[], None]:
    """Return a function that raises OutOfTime once the budget is used up.

    Args:
        begun: Since when it counts, as `time.monotonic()` of any process of this host tells;
            None: since now.
    """
    deadline = (time.monotonic() if begun is None else begun) + seconds

    def keep_going() -> None:
        if time.monotonic() > deadline:
            raise OutOfTime(f"the time budget of {seconds:g} s is used up")

    return keep_going
