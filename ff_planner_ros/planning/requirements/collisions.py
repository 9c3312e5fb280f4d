"""What requirements on distances share: their margin, and messages with advice."""

from __future__ import annotations

from collections.abc import Sequence

from ff_planner_ros.errors import Failure, Status
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


def collision(
    samples: Samples, least: Least, names: Sequence[str], advice: tuple[str, ...]
) -> Failure:
    """Return the failure of two bodies, by their names, whose certified distance is negative."""
    (first, second), when = names, samples.at(least.time)
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
