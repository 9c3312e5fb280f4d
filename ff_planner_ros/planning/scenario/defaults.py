"""What a scenario may leave out, because its reader knows it otherwise."""

from __future__ import annotations

from dataclasses import dataclass

from ff_planner_ros.common.declared import check_declared, declare
from ff_planner_ros.common.forms import a_number, a_whole_number, a_word
from ff_planner_ros.planning.problem.problem import MAX_POINTS, MIN_POINTS, USUAL_POINTS, Limits
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.controller_rules import Controller
from ff_planner_ros.planning.task.tail import EndBehaviour

_NO_LIMITS = Limits()


@dataclass(frozen=True)
class Defaults:
    """Values for keys that a scenario omits. A key without a value here is required.

    Raises:
        InvalidInput: A value is of another kind, or out of its range.
    """

    settings: PlannerSettings
    limits: Limits = _NO_LIMITS  # beside the joints' position limits
    end_behaviour: EndBehaviour = declare(
        a_word(EndBehaviour), "what the arm does after the goal", default=EndBehaviour.NONE
    )
    tail: float | None = declare(a_number(), "duration of that", unit="s", default=None)
    points: int = declare(
        a_whole_number(MIN_POINTS, MAX_POINTS), "number of points", default=USUAL_POINTS
    )
    controller: Controller | None = None  # must accept the plan

    def __post_init__(self) -> None:
        """Check every value."""
        kinds = {"settings": PlannerSettings, "limits": Limits, "controller": Controller}
        check_declared(self, "defaults", **kinds)
