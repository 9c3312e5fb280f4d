"""Joint accelerations at the points of a path, as the search sees them.

The search has derivatives of positions and velocities. The acceleration at a point is that of the
quintic through both there and at its neighbours: exact for quintics, of fourth order in the step
for other motions. It is linear in positions and velocities, and so its derivative is the same sum.
"""

from __future__ import annotations

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.paths.path_family import Motion, Sensitivity


def accelerations_at_points(positions: Array, rates: Array, step: float) -> Array:
    """Return accelerations, or their derivatives by x from those of positions and velocities.

    Args:
        positions: At three points or more. Shape (points, ...).
        rates: Time derivatives of `positions`. Shape (points, ...).
        step: Time from point to point [s].
    """
    way, rate = positions / step**2, rates / step
    found = np.empty_like(way)
    found[1:-1] = 2 * (way[2:] - 2 * way[1:-1] + way[:-2]) - (rate[2:] - rate[:-2]) / 2
    for end, inward, sign in ((0, 1, 1), (-1, -1, -1)):
        near, far = end + inward, end + 2 * inward
        of_rates = 6 * rate[end] + 8 * rate[near] + rate[far]
        found[end] = -11.5 * way[end] + 8 * way[near] + 3.5 * way[far] - sign * of_rates
    return found


def accelerations_by_x(motion: Motion, sensitivity: Sensitivity, step: float) -> Array:
    """Return the derivatives of joint accelerations by x. Shape (points, joints, variables)."""
    by_x = accelerations_at_points(sensitivity.q[:, 6:], sensitivity.v[:, 6:], step)
    if sensitivity.goal_motion is not None:  # positions count by 1 / T^2 there, rates by 1 / T
        duration = step * (len(motion.q) - 1)
        slower = accelerations_at_points(-2.0 * motion.q[:, 7:], -motion.v[:, 6:], step)
        by_x[..., -1] += slower / duration
    return by_x
