"""What a search has tried until now."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace

from ff_planner_ros.planning.motion.plan import SolverReport


@dataclass
class Effort:
    """How much was tried until now."""

    starts: int = 0  # initial guesses
    iterations: int = 0
    rollouts: int = 0
    # How many paths that a solve began at met each requirement, by its name
    met: Counter[str] = field(default_factory=Counter)

    def add(self, report: SolverReport) -> None:
        """Count what led to a plan."""
        self.starts += report.starts
        self.iterations += report.iterations
        self.rollouts += report.rollouts

    def report(self, of_plan: SolverReport) -> SolverReport:
        """Return the report of the plan that was chosen, with all the effort."""
        return replace(
            of_plan, starts=self.starts, iterations=self.iterations, rollouts=self.rollouts
        )
