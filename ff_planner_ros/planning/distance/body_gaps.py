"""Lower bounds of distances between two times, of second order.

For a unit vector n that is fixed to one of two bodies, the gap min n b - max n a between both is
never above their signed distance. Seen from the one, a point b of the other has a second derivative
of at most its bend, so that n b is not below the parabola through both ends that is curved so; nor
is the least of all points b below the parabola through the least ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import coal
import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.distance.solids_apart import NO_DIRECTION, Distances
from ff_planner_ros.planning.motion.certified_least import Arcs, Known, Pieces
from ff_planner_ros.robot.collision.primitives import furthest


class Solids(NamedTuple):
    """A solid in each row."""

    every: Sequence[coal.CollisionGeometry]
    which: Indices  # one of them; shape (rows,)


class Measured(NamedTuple):
    """Two bodies that were measured, the second one seen from the first; a row each."""

    normal: Array  # unit vector, from the first to the second; shape (rows, 3)
    rotation: Array  # of the second's axes; shape (rows, 3, 3)
    position: Array  # of the second's origin; shape (rows, 3) [m]
    stretch: Array  # of the first, as of `Placed`; shape (rows, 3) [m]


def measured(
    found: Distances,
    first: tuple[Array, Array],
    second: tuple[Array, Array],
    stretch: Array | None = None,
) -> Known:
    """Return what was found of two bodies: distances, and more as in `Measured`.

    Args:
        found: Distances, and normals in the frame of the poses.
        first: Rotations, (rows, 3, 3), and positions, (rows, 3) [m], of the first.
        second: Likewise.
        stretch: Of the first, in the frame of the poses. Shape (rows, 3) [m]. None: of none.
    """
    # Bodies that touch may have no normal, or a wrong one: with any unit vector bounds are true.
    length = np.linalg.norm(found.normal, axis=1)
    normal = found.normal / np.maximum(length, NO_DIRECTION)[:, None]
    normal[length < NO_DIRECTION] = [1.0, 0.0, 0.0]
    (axes, origin), (other_axes, other_origin) = first, second
    to_first = axes.swapaxes(1, 2)
    more = Measured(
        _turned(to_first, normal),
        to_first @ other_axes,
        _turned(to_first, other_origin - origin),
        np.zeros_like(normal) if stretch is None else _turned(to_first, stretch),
    )
    return Known(found.distance, tuple(more))


def arcs_of(first: Solids, second: Solids, pieces: Pieces, bends: Array) -> Arcs:
    """Return gaps on pieces between two points, in four directions.

    The directions are the normals at both ends, each fixed to the first body and to the second.

    Args:
        first: Of each piece.
        second: Likewise.
        pieces: Of distances by `measured`.
        bends: By the part of the piece, of the second body's points seen from the first, and of the
            first's seen from the second. Shape (2, pieces) [m].
    """
    begin, end = Measured(*pieces.at_begin.more), Measured(*pieces.at_end.more)
    carried = end.rotation @ begin.rotation.swapaxes(1, 2)
    late, early = _turned(carried, begin.normal), _turned(carried.swapaxes(1, 2), end.normal)
    at_begin = _gaps(first, second, begin, np.array([begin.normal, end.normal, early]))
    at_end = _gaps(first, second, end, np.array([begin.normal, end.normal, late]))
    return Arcs(at_begin[[0, 1, 0, 2]], at_end[[0, 1, 2, 1]], bends[[0, 0, 1, 1]])


def _gaps(first: Solids, second: Solids, at: Measured, ways: Array) -> Array:
    """Return the gaps along directions in the first body's axes, (ways, rows, 3), likewise [m]."""
    along = np.einsum("wri,ri->wr", ways, at.position)
    seen = np.einsum("wri,rij->wrj", ways, at.rotation)
    gaps: Array = along - _furthest(first, ways) - _furthest(second, -seen)
    if at.stretch.any():
        gaps -= np.maximum(np.einsum("wri,ri->wr", ways, at.stretch), 0.0)
    return gaps


def _furthest(solids: Solids, ways: Array) -> Array:
    """Return the support function of each row's solid. Shape (ways, rows) [m]."""
    found = np.empty(ways.shape[:2])
    for number in np.unique(solids.which).tolist():
        rows = solids.which == number
        found[:, rows] = furthest(solids.every[number], ways[:, rows])
    return found


def _turned(rotations: Array, vectors: Array) -> Array:
    turned: Array = np.einsum("rij,rj->ri", rotations, vectors)
    return turned
