"""What is told of a collision, and what may help."""

from __future__ import annotations

from ff_planner_ros.errors import Failure, Status
from ff_planner_ros.planning.distance.body_certificate import Least
from ff_planner_ros.planning.requirements.requirement import Samples

# The search asks only whether anything is left of a clearance.
SLACK_PART = 0.5

DETOURS = (
    "a longer duration",
    "a goal or start posture on another side of the obstacle",
    "more planner.starts",
)


def collision(
    samples: Samples, least: Least, first: str, second: str, advice: tuple[str, ...]
) -> Failure:
    """Return what is told of two bodies whose least distance is not certainly positive."""
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
