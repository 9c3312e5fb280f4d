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
# Directions whose furthest points are corners of a simplified hull, besides six along axes; with
# the fewer ones, no corner has more than 255 edges, which is all that Coal takes.
_DIRECTIONS = (400, 249)
# Of more points, those well inside are removed first; if there are still more, the exact hull is
# not tried: Qhull's time grows with the square of the corners of a face.
_MANY = 10_000


class NoSolid(ValueError):
    """Points have no convex hull; the message says why."""


def convex_solid(points: Array, scale: Array) -> tuple[Array, coal.Convex, float]:
    """Return the corners of a convex solid that holds points, the scaled solid, and its growth.

    The solid is the convex hull, or, if that has too many corners, some of them, moved away from
    their middle until their hull holds all points. Growth is by which part of its width that solid
    is larger, at most. Corners of a solid are returned unchanged.

    Args:
        points: Before scaling; shape (points, 3).
        scale: Factor along each axis; shape (3,).

    Raises:
        ValueError: A `NoSolid`: the points lie in a plane, say.
    """
    points = once(points)
    seen = scale[:, None] * _principal(points * scale)
    boxes = Boxes(points)
    corners, growth = _corners(points, boxes, scale), 0.0
    for directions in (*_DIRECTIONS, 0):
        if corners is not None:
            with suppress(RuntimeError):  # an edge fan of more than 255 at one corner
                return corners, _convex(corners * scale), growth
        if directions:
            simple, growth = _simpler(points, boxes, seen, directions)
            corners = _corners(simple, Boxes(simple), scale)
    raise NoSolid("its convex hull cannot be simplified")


def said_of(vertices: int, corners: int, growth: float) -> list[str]:
    """Return a note on a solid that is larger than the hull of its vertices; none: it is not."""
    if not growth > 0.0:
        return []
    volume = (1.0 + growth) ** 3 - 1.0
    note = (
        f"its hull is simplified from {vertices} vertices to {corners}, and at most {growth:.2g} "
        f"of its width and {volume:.2g} of its volume larger"
    )
    return [note]


def _convex(corners: Array) -> coal.Convex:
    """Return the hull of corners as a Coal geometry."""
    rows = coal.StdVec_Vec3s()
    rows.extend(list(corners))
    return coal.Convex.convexHull(rows, True, "Qt")


def once(points: Array) -> Array:
    """Return the rows sorted by z, then y, then x, without duplicates."""
    points = points + 0.0  # no negative zeros
    steps = np.diff(points[:, ::-1], axis=0)
    first = (steps != 0.0).argmax(axis=1)
    if (np.take_along_axis(steps, first[:, None], axis=1) > 0.0).all():
        return points
    points = points[np.lexsort(points.T)]
    return points[np.r_[True, (points[1:] != points[:-1]).any(axis=1)]] if len(points) else points


def _principal(points: Array) -> Array:
    """Return the principal axes in units of the widths, as columns; refuse points without a hull.

    Coal would crash.
    """
    if not len(points) or not (np.abs(points) <= LARGEST_SIZE).all():
        raise NoSolid(f"it must have vertices, none further than {LARGEST_SIZE:g} m")
    centred = points - points.mean(axis=0)
    axes = np.linalg.eigh(centred.T @ centred)[1]
    extents = np.ptp(points @ axes, axis=0)
    if extents.min() < max(SMALLEST_SIZE, _THINNEST * extents.max()):
        raise NoSolid("it is flat, and has no volume: a thin <box> says how thick it is")
    return np.array(axes / extents)


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
    outermost = once(boxes.outermost(_ways(_DIRECTIONS[0]) * scale)) * scale
    _principal(outermost)  # refused if flat
    planes = _hull(outermost).equations * [*scale, 1.0] + [0.0, 0.0, 0.0, _THINNEST]
    outside = boxes.outside(planes, _MANY)
    return None if outside is None else once(outside)


def _hull(points: Array) -> Any:
    """Return Qhull's hull of points, by SciPy."""
    from scipy.spatial import ConvexHull  # a tenth of a second, for meshes alone

    return ConvexHull(points)


def _simpler(points: Array, boxes: Boxes, seen: Array, directions: int) -> tuple[Array, float]:
    """Return corners of a solid that holds points, before scaling, and its growth.

    Corners are the furthest points in some directions. About an inner point c, the planes
    n.(x - c) = h of their hull become those of a solid that holds all points by the factor
    max(H / h), where H is the furthest of all points along n. Points are seen along principal axes
    in units of the widths, in which a long tube is as round as a ball.

    Args:
        seen: Those axes of scaled points, as columns, each element times the scale of its row.
    """
    corners = once(boxes.outermost(_ways(directions) @ seen.T)) @ seen
    corners = corners[_hull(corners).vertices]
    normals, offsets = np.split(_hull(corners).equations, [3], axis=1)
    furthest = ((boxes.outermost(normals @ seen.T) @ seen) * normals).sum(axis=1)
    rounding = np.spacing(np.float32(np.abs(points).max())) * np.linalg.norm(seen)
    center = corners.mean(axis=0)
    reach = normals @ center
    factor = ((furthest + rounding - reach) / (-offsets[:, 0] - reach)).max() + _THINNEST
    outside = (center + factor * (corners - center)) @ np.linalg.inv(seen)
    return once(outside.astype(np.float32).astype(float)), float(factor - 1.0)


def _ways(count: int) -> Array:
    """Return evenly distributed directions, with those of the axes; shape (count + 6, 3)."""
    k = np.arange(count) + 0.5
    height, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + 5.0**0.5) * k
    across = np.sqrt(1.0 - height**2)
    spiral = np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)
    return np.vstack([spiral, np.eye(3), -np.eye(3)])
