"""The approach of a request, as it is or decoded from a bag, as planning has it."""

from __future__ import annotations

from typing import Any

import numpy as np

from ff_planner_ros.planning.approach import CONE, Approach

# Fields of the request, by those of a scenario.
APPROACH_NAMED_AS = {
    f"approach.{part}": f"approach_{part}" for part in ("direction", "distance", "cone")
}


def approach_in(request: Any) -> Approach | None:
    """Return the corridor that a request asks for; None: the end effector may come any way.

    Raises:
        InvalidInput: A part of it is missing, or cannot be; named as in a scenario.
    """
    # A message decoded from a bag of an earlier version has no such fields.
    if not hasattr(request, "approach_direction"):
        return None
    told = request.approach_direction
    direction, distance = np.array([told.x, told.y, told.z]), request.approach_distance
    cone = request.approach_cone
    if not (direction.any() or distance or cone):
        return None
    return Approach(direction, distance, cone or CONE)
