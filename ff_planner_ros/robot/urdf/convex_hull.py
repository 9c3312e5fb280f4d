"""Convex hulls of points, simplified to few corners for fast distance queries."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import coal
import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.collision.outermost import Boxes

# Smaller solids are mistakes, and larger ones no robots [m].
SMALLEST_SIZE, LARGEST_SIZE = 1e-6, 1e4
# Thickness over length below which points are flat but for rounding, and have no convex hull.
_THINNEST = 1e-6
# Hulls of robots have a few hundred corners; each costs time in every distance query.
MAX_VERTICES = 1000
# Directions in which a simplified hull touches the original: it has at most twice as many vertices.
_DIRECTIONS = 300
# Of more points, those well inside are removed first; if there are still more, the exact hull is
# not tried: Qhull's time grows with the square of the corners of a face.
_MANY = 10_000


class NoSolid(ValueError):
    """Points have no convex hull; the message says why."""


def convex_solid(points: Array, scale: Array) -> tuple[Array, coal.Convex, float]:
    """Return the corners of a convex solid that holds points, the scaled solid, and its growth.

    The solid is the convex hull, or, if that has too many corners, a simpler one around it. Growth
    is by how much that is larger, relative to its width. Corners of a solid are returned unchanged.

    Args:
        points: Before scaling; shape (points, 3).
        scale: Factor along each axis; shape (3,).

    Raises:
        ValueError: A `NoSolid`: the points lie in a plane, say.
    """
    points, growth = once(points), 0.0
    for _ in range(2):
        _require_solid(points * scale)
        boxes = Boxes(points)
        corners = _corners(points, boxes, scale)
        if corners is not None:
            with suppress(RuntimeError):  # an edge fan of more than 255 at one corner
                return corners, _convex(corners * scale), growth
        around = _around(points * scale, boxes, scale) / scale
        simple = once(around.astype(np.float32).astype(float))
        growth = _growth(boxes, scale, simple * scale)
        points = simple
    raise NoSolid("its convex hull cannot be simplified")


def _convex(corners: Array) -> coal.Convex:
    """Return the hull of corners as a Coal geometry."""
    rows = coal.StdVec_Vec3s()
    rows.extend(list(corners))
    return coal.Convex.convexHull(rows, True, "Qt")


def once(points: Array) -> Array:
    """Return the rows sorted, without duplicates."""
    points = points[np.lexsort(points.T)] + 0.0  # no negative zeros
    new = np.ones(len(points), bool)
    new[1:] = (points[1:] != points[:-1]).any(axis=1)
    return np.array(points[new])


def _require_solid(points: Array) -> None:
    """Refuse points that have no hull: Coal would crash."""
    if not len(points) or not (np.abs(points) <= LARGEST_SIZE).all():
        raise NoSolid(f"it must have vertices, none further than {LARGEST_SIZE:g} m")
    extents = np.ptp(points @ _axes(points), axis=0)
    if extents.min() < max(SMALLEST_SIZE, _THINNEST * extents.max()):
        raise NoSolid("it is flat, and has no volume: a thin <box> says how thick it is")


def _axes(points: Array) -> Array:
    """Return the principal axes, as columns."""
    centred = points - points.mean(axis=0)
    return np.array(np.linalg.eigh(centred.T @ centred)[1])


def _corners(points: Array, boxes: Boxes, scale: Array) -> Array | None:
    """Return the points at the corners of the hull after `scale`; None: more than `MAX_VERTICES`.

    All points that are returned are corners of their hull.
    """
    if len(points) > _MANY:
        outer = _outer(boxes, scale)
        if outer is None:
            return None
        points = outer
    if len(points) > MAX_VERTICES:
        # One direction after the other: all at once would need gigabytes.
        scaled = points * scale
        furthest = {int(np.argmax(scaled @ way)) for way in _ways(4 * MAX_VERTICES)}
        if len(furthest) > MAX_VERTICES:
            return None
    while True:
        corners = np.sort(_hull(points * scale).vertices)
        if len(corners) == len(points):
            return points if len(points) <= MAX_VERTICES else None
        points = points[corners]


def _outer(boxes: Boxes, scale: Array) -> Array | None:
    """Return points not inside the hull of the outermost ones; None: more than `_MANY`."""
    outermost = once(boxes.outermost(_ways(_DIRECTIONS) * scale)) * scale
    _require_solid(outermost)
    planes = _hull(outermost).equations * [*scale, 1.0] + [0.0, 0.0, 0.0, _THINNEST]
    outside = boxes.outside(planes, _MANY)
    return None if outside is None else once(outside)


def _hull(points: Array) -> Any:
    """Return Qhull's hull of points, by SciPy."""
    from scipy.spatial import ConvexHull  # a tenth of a second, for meshes alone

    return ConvexHull(points)


def _around(points: Array, boxes: Boxes, scale: Array) -> Array:
    """Return the corners of the solid between planes that touch the points from outside.

    For planes n.(x - c) = h about an inner point c, the solid's corners are dual to the faces of
    the hull of the points n / h. Directions are chosen along principal axes in units of the widths,
    in which a long tube is as round as a ball.

    Args:
        points: After scaling.
        boxes: The points before scaling.
    """
    ways, axes = _ways(_DIRECTIONS), _axes(points)
    widths = np.ptp(points @ axes, axis=0)
    seen = scale[:, None] * axes / widths
    furthest = boxes.outermost(ways @ seen.T) @ seen
    center = furthest.mean(axis=0)
    reach = ((furthest - center) * ways).sum(axis=1)
    dual = _convex(ways / reach[:, None])
    corners = dual.points()
    faces = [dual.polygons(i) for i in range(dual.num_polygons)]
    planes = np.array([[corners[face[k]] for k in range(3)] for face in faces])
    normal = np.cross(planes[:, 1] - planes[:, 0], planes[:, 2] - planes[:, 0])
    height = np.einsum("ij,ij->i", normal, planes[:, 0])
    outside = normal / height[:, None] * (1.0 + _THINNEST)  # more than float32 rounds
    return np.array((center + outside) * widths @ axes.T)


def _ways(count: int) -> Array:
    """Return evenly distributed directions, with those of the axes; shape (count + 6, 3)."""
    k = np.arange(count) + 0.5
    height, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + 5.0**0.5) * k
    across = np.sqrt(1.0 - height**2)
    spiral = np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)
    return np.vstack([spiral, np.eye(3), -np.eye(3)])


def _growth(boxes: Boxes, scale: Array, simple: Array) -> float:
    """Return by how much a solid exceeds the points, relative to their width, at most."""
    ways = _ways(_DIRECTIONS // 2)
    reach, back = (
        (boxes.outermost(side * scale) * scale * side).sum(axis=1) for side in (ways, -ways)
    )
    return float((((simple @ ways.T).max(axis=0) - reach) / (reach + back)).max())
