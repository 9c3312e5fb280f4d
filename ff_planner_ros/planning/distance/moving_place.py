"""The least margin of a moving point, certified between the times at which it is known.

Its places and velocities are given in a frame that may move and rotate. Between two times it moves
on the cubic through both.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array

# Between the times the margin is known to this [m].
_GAP = 5e-4
# Pieces that are looked at: a motion that needs more, no arm makes, and the bound is lower.
_MOST_PIECES = 1 << 18


class LeastMargin(NamedTuple):
    """The least margin of a moving point, and where it is then."""

    # Lower bound at all times, within 0.5 mm of the least unless it moves too fast to tell [m]
    certified: float
    margin: float  # the least that was found [m]
    time: float  # of that [s]
    place: Array  # then; shape (3,) [m]


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
    times: Array, places: Array, velocities: Array, margins: Callable[[Array], Array]
) -> LeastMargin:
    """Return the least margin of a moving point.

    In an interval the margin changes by no more than the point moves; intervals whose bound is too
    low to decide are halved.

    Args:
        times: Shape (times,) [s].
        places: Shape (times, 3) [m].
        velocities: Shape (times, 3) [m/s].
        margins: Margins of places, with Lipschitz constant 1: from shape (places, 3) to shape
            (places,) [m].
    """
    cubics, fastest = _cubics(times, places, velocities)
    values = margins(places)
    number = int(values.argmin())
    lowest, when, where = float(values[number]), float(times[number]), places[number]
    certified = lowest
    index, begin, end = np.arange(len(cubics)), np.zeros(len(cubics)), np.ones(len(cubics))
    at_begin, at_end, looked_at = values[:-1], values[1:], 0
    while True:
        bound = (at_begin + at_end - fastest[index] * (end - begin)) / 2
        open_ = (bound < lowest - _GAP) & (looked_at < _MOST_PIECES)
        looked_at += len(index)
        certified = min(certified, float(bound[~open_].min(initial=np.inf)))
        if not open_.any():
            return LeastMargin(certified, lowest, when, where)
        index, begin, end = index[open_], begin[open_], end[open_]
        middle = (begin + end) / 2
        powers = middle[:, None] ** np.array([1, 2, 3])
        between = places[index] + np.einsum("ip,ipj->ij", powers, cubics[index])
        at_middle = margins(between)
        number = int(at_middle.argmin())
        if at_middle[number] < lowest:
            lowest, where = float(at_middle[number]), between[number]
            step = times[index[number] + 1] - times[index[number]]
            when = float(times[index[number]] + middle[number] * step)
        index = np.concatenate([index, index])
        begin, end = np.concatenate([begin, middle]), np.concatenate([middle, end])
        at_begin = np.concatenate([at_begin[open_], at_middle])
        at_end = np.concatenate([at_middle, at_end[open_]])


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
