"""A problem that was drawn, and a motion that solves it; draws are repeated until one is sound."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.phase import Phase
from ff_planner_ros.planning.task.planning_task import PlanningTask

T = TypeVar("T")
W = TypeVar("W", covariant=True)

# Sound draws are one of a few, or of a thousand. A class that has none would be drawn for ever.
_MOST_DRAWS = 100_000


@dataclass(frozen=True, eq=False)
class Drawn(Generic[W]):
    """A problem, and its witness: a motion, or the coefficients of a path, that solves it."""

    problem: PlanningProblem
    witness: W
    then: tuple[Phase, ...] = ()  # phases after the problem

    def task(self, settings: PlannerSettings) -> PlanningTask:
        """Return the planning task of all phases."""
        return PlanningTask(self.problem, settings, then=self.then)


def first_sound(kind: str, robot: str, draw: Callable[[], T | None], most: int = _MOST_DRAWS) -> T:
    """Return the first result of a draw that is not None.

    Raises:
        InvalidInput: There is none, as for a robot that is never free of its own links.
    """
    for _ in range(most):
        if (drawn := draw()) is not None:
            return drawn
    allowed = f"of {most} problems of kind {kind} that were drawn for it none has a plan"
    raise InvalidInput(Status.UNSUPPORTED, "robot", robot, allowed)
