"""What requirements on distances share: their margin, and messages with advice."""

from __future__ import annotations

from typing import NoReturn

from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.distance.start_room import LEAST_CLEARANCE
from ff_planner_ros.planning.motion.certified_least import Least
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.requirement import Requirement, Samples

# Relative accuracy of certificates in the search, which only asks whether a clearance is positive;
# what is left of one is far more than rounding.
SLACK_PART = 0.95


class KeptClear(Requirement):
    """A requirement on distances, of which the search keeps the same margin."""

    def margin(self, problem: PlanningProblem, settings: PlannerSettings) -> float:
        """Return the clearance that the search keeps at the points [m]."""
        return settings.clearance_margin


def detours(problem: PlanningProblem) -> tuple[str, ...]:
    """Return advice for a body that is in an obstacle on the way."""
    posture = problem.posture
    ends = "" if posture is not None and posture.at_rest else "goal or "
    aside = f"a {ends}start posture on another side of the obstacle"
    return "a longer duration", aside, "more planner.starts"


def collision(
    samples: Samples, least: Least, first: str, second: str, advice: tuple[str, ...]
) -> Failure:
    """Return the failure of two bodies whose certified distance is not positive."""
    when = samples.at(least.time)
    if least.found >= 0.0:
        return Failure(
            Status.COLLISION,
            f"{first} may touch {second} near {when}: all that is certain is a clearance of "
            f"{least.certified * 1e3:.2f} mm",
            ("more points", "a larger planner.clearance_margin"),
        )
    depth = -least.found
    shallow = depth < samples.settings.clearance_margin
    margin = ("a smaller planner.clearance_margin",) if shallow else ()
    return Failure(
        Status.COLLISION, f"{first} is {depth:.3g} m inside {second} at {when}", (*advice, *margin)
    )


def refuse_nearness(obstacle: str, body: str, distance: float, what: str, way_out: str) -> NoReturn:
    """Refuse a start inside an obstacle, or nearer than `LEAST_CLEARANCE`.

    Args:
        distance: Between both; negative: penetration depth [m].
        what: Noun for what must be outside: arm or robot.
        way_out: Words on how to get out.

    Raises:
        InvalidInput: Always.
    """
    value, allowed = (
        f"around {body}, {-distance:.4f} m deep",
        f"at the start the {what} must be outside every obstacle",
    )
    if distance > 0.0:
        value = f"{distance * 1e3:.4f} mm from {body}"
        allowed = (
            f"a start needs a clearance of {LEAST_CLEARANCE * 1e3:g} mm from every obstacle; start "
            "further away"
        )
    raise InvalidInput(
        Status.START_IN_COLLISION, f"obstacles[{obstacle}]", value, allowed + way_out
    )
