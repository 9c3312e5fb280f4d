"""The least margin of a moving point, certified between the times at which it is known.

Its places and velocities are given in a frame that may move and rotate. Between two times it moves
on the cubic through both.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.motion.certified_least import Known, Least, Pieces, certified_least

# Between the times the margin is known to this [m].
_GAP = 5e-4


def places_between(times: Array, places: Array, velocities: Array, count: int) -> Array:
    """Return the places at `count` times of each interval, and the last one.

    Args:
        times: Shape (times,) [s].
        places: Shape (times, 3) [m].
        velocities: Shape (times, 3) [m/s].

    Returns:
        Shape (count (times - 1) + 1, 3) [m].
    """
    cubics, _ = _cubics(times, places, velocities)
    powers = np.linspace(0.0, 1.0, count, endpoint=False)[:, None] ** np.array([1, 2, 3])
    between = places[:-1, None] + np.einsum("cp,ipj->icj", powers, cubics)
    return np.concatenate([between.reshape(-1, 3), places[-1:]])


def least_margin(
    times: Array,
    places: Array,
    velocities: Array,
    margins: Callable[[Array], Array],
    gap: float = _GAP,
) -> tuple[Least, Array]:
    """Return the least margin of a moving point, and where the point is then, (3,) [m].

    A margin changes by no more than the point moves.

    Args:
        times: Shape (times,) [s].
        places: Shape (times, 3) [m].
        velocities: Shape (times, 3) [m/s].
        margins: Margins of places, with Lipschitz constant 1: from shape (places, 3) to shape
            (places,) [m].
        gap: Between the times the margin is known to this [m].
    """
    cubics, fastest = _cubics(times, places, velocities)

    def values_at(steps: Array, _: Indices) -> Known:
        index = steps.astype(np.intp)
        powers = (steps - index)[:, None] ** np.array([1, 2, 3])
        between = places[index] + np.einsum("ip,ipj->ij", powers, cubics[index])
        return Known(margins(between), (between,))

    def ways(pieces: Pieces) -> Array:
        speeds: Array = fastest[pieces.begin.astype(np.intp)]
        return speeds * (pieces.end - pieces.begin)

    at_points, steps = Known(margins(places), (places,)), np.arange(float(len(times)))
    none = np.zeros(len(cubics), np.intp)
    ends = at_points.rows(slice(-1)), at_points.rows(slice(1, None))
    pieces = Pieces(none, steps[:-1], steps[1:], *ends)
    least = certified_least(times, pieces, values_at, ways, None, gap)
    return least, least.more[0]


def _cubics(times: Array, places: Array, velocities: Array) -> tuple[Array, Array]:
    """Return the cubic of each piece, of powers 1 to 3 of the part of it, and its largest speed.

    Returns:
        Shapes (pieces, 3 powers, 3) [m] and (pieces,) [m], both by the part of the piece.
    """
    steps, way = np.diff(times)[:, None], np.diff(places, axis=0)
    first, last = steps * velocities[:-1], steps * velocities[1:]
    cubics = np.stack([first, 3 * way - 2 * first - last, first + last - 2 * way], axis=1)
    # The rate is a Bezier curve of second order: never faster than the fastest of its points.
    control = np.stack([first, 3 * way - first - last, last])
    return cubics, np.linalg.norm(control, axis=2).max(axis=0)
