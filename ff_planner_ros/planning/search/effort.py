"""Counters of what a search has tried."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace

from ff_planner_ros.planning.motion.plan import SolverReport


@dataclass
class Effort:
    """Counters of a search, over all its attempts so far."""

    starts: int = 0  # initial guesses
    iterations: int = 0
    rollouts: int = 0
    # Of the initial paths of all solves, how many met each requirement, by its name
    met: Counter[str] = field(default_factory=Counter)

    def add(self, report: SolverReport) -> None:
        """Add the effort that led to a plan."""
        self.starts += report.starts
        self.iterations += report.iterations
        self.rollouts += report.rollouts

    def report(self, of_plan: SolverReport) -> SolverReport:
        """Return the report of the chosen plan, with the effort of the whole search."""
        return replace(
            of_plan, starts=self.starts, iterations=self.iterations, rollouts=self.rollouts
        )
