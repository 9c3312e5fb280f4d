"""Support points of millions of points, and the points among them outside a solid.

Points are sorted into boxes of a few hundred neighbours each; most boxes are decided as a whole.
"""

from __future__ import annotations

import numpy as np

from ff_planner_ros.common.arrays import Array

_IN_A_BOX = 500


class Boxes:
    """Points sorted into boxes of equal numbers."""

    def __init__(self, points: Array) -> None:
        """Sort points; shape (points, 3), one at least."""
        parts = 1 + int((len(points) / _IN_A_BOX) ** (1 / 3))
        each = -(-len(points) // parts**3)
        missing = each * parts**3 - len(points)
        boxes = np.pad(points, ((0, missing), (0, 0)), "edge")[None]  # the last one is there again
        for axis in range(3):
            order = np.argsort(boxes[..., axis], axis=1, kind="stable")
            boxes = np.take_along_axis(boxes, order[..., None], axis=1)
            boxes = boxes.reshape(len(boxes) * parts, -1, 3)
        self._points = boxes
        self._low, self._high = boxes.min(axis=1), boxes.max(axis=1)

    def outermost(self, ways: Array) -> Array:
        """Return a point that is the furthest in each direction; shape (directions, 3)."""
        return np.array([self._furthest(way) for way in ways])

    def outside(self, planes: Array, most: int) -> Array | None:
        """Return the points that are not below every plane; None: they are more than `most`.

        Args:
            planes: Rows of n and d, where n.x + d is negative below; shape (planes, 4).
        """
        found: list[Array] = [np.empty((0, 3))]
        highest = np.stack([self._reach(plane[:3]) + plane[3] for plane in planes], axis=1)
        for box in np.flatnonzero((highest >= 0.0).any(axis=1)):
            near, points = planes[highest[box] >= 0.0], self._points[box]
            found.append(points[(points @ near[:, :3].T + near[:, 3] >= 0.0).any(axis=1)])
            if sum(map(len, found)) > most:
                return None
        return np.concatenate(found)

    def _furthest(self, way: Array) -> Array:
        reach = self._reach(way)
        first = self._points[np.argmax(reach)]
        boxes = self._points[reach >= (first @ way).max()].reshape(-1, 3)
        # None: rounding has put that very box below its own point.
        points = boxes if len(boxes) else first
        furthest: Array = points[np.argmax(points @ way)]
        return furthest

    def _reach(self, way: Array) -> Array:
        """Return how far each box reaches in a direction; no point in it is further."""
        reach: Array = np.where(way > 0.0, self._high, self._low) @ way
        return reach
