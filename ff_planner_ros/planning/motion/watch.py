"""The progress of a search, and what may end it."""

from __future__ import annotations

from dataclasses import dataclass

SEARCHING, REFINING, CHECKING = "searching", "refining", "checking"


@dataclass(frozen=True)
class Progress:
    """How far a search has come."""

    phase: str  # SEARCHING on few points, REFINING on all of them, CHECKING what was found
    starts: int  # first guesses tried
    iterations: int  # paths looked at with their derivatives, over all starts
    objective: float  # of the path last looked at
    violation: float  # by how much it violates its worst constraint [m, rad or rad/s]


class Watch:
    """Is told of the progress of a search, and may end it. This one does neither."""

    def require_time(self) -> None:
        """Called before every iteration of a search; raises OutOfTime to end it."""

    def report(self, progress: Progress) -> None:
        """Called after every iteration, and before a path is checked."""
