"""The phases that follow the first goal, planned one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

from ff_planner_ros.common.declared import (
    check_declared,
    declare,
    declare_inline,
    declared_by_name,
)
from ff_planner_ros.common.declared_parts import part
from ff_planner_ros.common.forms import a_whole_number
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.camera import Camera
from ff_planner_ros.planning.problem.limits import ANY_ATTITUDE, ChaserGoal
from ff_planner_ros.planning.problem.path.circle import CircleToFollow
from ff_planner_ros.planning.problem.posture import Goal
from ff_planner_ros.planning.problem.problem import (
    CONTACT_DISTANCE,
    Approach,
    DurationRange,
    Limits,
    Objective,
    Parametrisation,
    PathToFollow,
    PlanningProblem,
    TargetBody,
)
from ff_planner_ros.robot.urdf.payload import Payload

# More steps than any search takes; messages count them in a uint64.
MOST_STEPS = 2**53
# Of phases behind the first, as messages have them.
MOST_PHASES = 8
# Where a request has how it is searched for; a phase has these values by themselves.
_SEARCH = "search."


def of_problem(name: str, **default: Any) -> Any:
    """Declare a field of a phase like the field of PlanningProblem that has the name."""
    said = declared_by_name(PlanningProblem)[name]
    place = None if said.message is None else said.message.removeprefix(_SEARCH)
    one = replace(said, optional=bool(default), message=place)
    return field(metadata={"declared": one}, **default)


@dataclass(frozen=True, eq=False)
class Phase:
    """A phase that follows another one: it begins where the phase before ends.

    Raises:
        InvalidInput: Neither `target` nor `target_body` is given, or both; or a value is not
            allowed.
    """

    FIRST: ClassVar[Sequence[str]] = ("target", "target_body")

    duration: float | DurationRange = of_problem("duration")
    # Where the target is when the phase ends, as in a problem of its own; None: a body's grasp
    target: Goal | None = of_problem("target", default=None)
    # In its state at the first point of the whole sequence
    target_body: TargetBody | None = of_problem("target_body", default=None)
    chaser_goal: ChaserGoal = declare_inline(ChaserGoal, default=ANY_ATTITUDE)
    # None: as in the phase before
    objective: Objective | None = of_problem("objective", default=None)
    limits: Limits | None = of_problem("limits", default=None)
    points: int | None = of_problem("points", default=None)
    parametrisation: Parametrisation | None = of_problem("parametrisation", default=None)
    approach: Approach | None = of_problem("approach", default=None)
    camera: Camera | None = of_problem("camera", default=None)
    allowed_collisions: tuple[str, ...] = of_problem("allowed_collisions", default=())
    contact_distance: float = of_problem("contact_distance", default=CONTACT_DISTANCE)
    payload: Payload | None = declare(
        part(Payload),
        "held from the phase's start on; default: what the phase before held, or has captured",
        default=None,
    )
    effort: int = declare(
        a_whole_number(0, MOST_STEPS),
        "step at which the phase's search ends, as an answer tells it; default: it goes to its end",
        key="search.effort",
        message="effort",
        brief=True,
        default=0,
    )

    FACTS = ("duration", "target", "target_body", "points")
    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check what the parts cannot check by themselves."""
        check_declared(self, "")
        if (self.target is None) == (self.target_body is None):
            found = "missing" if self.target is None else "given beside target_body"
            allowed = "either it or target_body must be given"
            raise InvalidInput(Status.OUT_OF_RANGE, "target", found, allowed)
        if isinstance(self.target, PathToFollow | CircleToFollow):
            field = "target.path" if isinstance(self.target, PathToFollow) else "target.circle"
            allowed = "a path is followed in the first phase alone"
            raise InvalidInput(Status.UNSUPPORTED, field, "given", allowed)

    @property
    def longest_duration(self) -> float:
        """The longest that it may have [s]."""
        lasts = self.duration
        return lasts.maximum if isinstance(lasts, DurationRange) else lasts

    def after(self, before: PlanningProblem | Phase) -> Phase:
        """Return the phase with the values that it omits taken from the phase before."""
        return replace(
            self,
            objective=self.objective or before.objective,
            limits=self.limits or before.limits,
            points=self.points or before.points,
            parametrisation=self.parametrisation or before.parametrisation,
        )


def require_mass(body: TargetBody) -> None:
    """Refuse a captured body of unknown mass: the phases that follow depend on it.

    Raises:
        InvalidInput: The mass is zero, which means unknown.
    """
    if body.mass == 0.0:
        allowed = "what follows a capture needs it, and the inertia in kg m2"
        raise InvalidInput(Status.OUT_OF_RANGE, "target_body.mass", "missing", allowed)
