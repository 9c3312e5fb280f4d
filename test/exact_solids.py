"""Signed distances of convex solids, between bounds on both sides that agree; no Coal, no core.

The distance of two solids is that of the origin from their Minkowski difference: negative where the
origin is inside. What is round all over counts by its core, a point or a piece of a line.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.collision.solids import Solid

AGREED = 1e-9  # [m] bounds that are so near each other are the truth
MOST = 200  # times that the bounds are improved
_SIDES = ((-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0))


@dataclass(frozen=True)
class Placed:
    """What is left of a solid without its radius, in a pose; the solid is what is so near it."""

    solid: Solid
    rotation: Array  # to the common frame; shape (3, 3)
    position: Array  # shape (3,) [m]

    @property
    def radius(self) -> float:
        """That of a sphere or capsule, else 0 [m]."""
        return float(self.solid.sizes[0]) if self.solid.kind in ("sphere", "capsule") else 0.0

    @property
    def width(self) -> float:
        """The least of its sizes, diameters among them; of a mesh, of the box around it [m]."""
        if self.solid.kind == "mesh":
            return float(np.ptp(self.solid.corners, axis=0).min())
        diameters = 1.0 if self.solid.kind == "box" else [2.0] + [1.0] * (len(self.solid.sizes) - 1)
        widths = self.solid.sizes * diameters
        return float(widths[0] if self.solid.kind == "capsule" else widths.min())

    @property
    def is_curved(self) -> bool:
        """Whether it is no hull of a few points."""
        return self.solid.kind in ("cylinder", "cone")

    @property
    def corners(self) -> Array:
        """Those of one that is not curved. Shape (corners, 3) [m]."""
        kind, sizes = self.solid.kind, self.solid.sizes
        if kind == "mesh":
            found = self.solid.corners
        elif kind == "box":
            found = np.array([(x, *yz) for x in (-1.0, 1.0) for yz in _SIDES]) * sizes / 2.0
        else:
            ends = (0.0,) if kind == "sphere" else (-sizes[1] / 2.0, sizes[1] / 2.0)
            found = np.array([(0.0, 0.0, end) for end in ends])
        return np.asarray(found @ self.rotation.T + self.position)

    def furthest(self, ways: Array) -> Array:
        """Return a point of it that is the furthest in each direction. Shape (ways, 3) [m]."""
        if not self.is_curved:
            corners = self.corners
            return np.asarray(corners[(ways @ corners.T).argmax(axis=1)])
        radius, length = self.solid.sizes.tolist()
        seen = ways @ self.rotation
        across = np.hypot(seen[:, 0], seen[:, 1])
        rim = radius * seen[:, :2] / np.maximum(across, 1e-300)[:, None]
        end = np.copysign(length / 2.0, seen[:, 2])
        if self.solid.kind == "cone":
            is_apex = seen[:, 2] * length > radius * across
            end, rim = np.where(is_apex, length / 2.0, -length / 2.0), rim * ~is_apex[:, None]
        return np.asarray(np.column_stack([rim, end]) @ self.rotation.T + self.position)


def signed_distance(first: Placed, second: Placed) -> tuple[float, Array]:
    """Return the distance of two solids [m], and the direction in which the second must move away.

    Negative: the length of the shortest move that separates them, which is along the direction.
    """
    radii = first.radius + second.radius
    distance, way = _of_cores(first, second)
    return distance - radii, way


def gap_along(first: Placed, second: Placed, way: Array) -> float:
    """Return the gap between planes across a direction that touch both from between them [m]."""
    ahead, back = second.furthest(-way[None, :])[0], first.furthest(way[None, :])[0]
    return float((ahead - back) @ way) - first.radius - second.radius


def _of_cores(first: Placed, second: Placed) -> tuple[float, Array]:
    if not (first.is_curved or second.is_curved):
        points = (second.corners[:, None] - first.corners).reshape(-1, 3)
        return _of_hull(points)
    return _between_bounds(first, second)


def _of_hull(points: Array) -> tuple[float, Array]:
    """Return the signed distance of the origin from the hull of points, and the way out of it.

    The way is from the origin to the nearest point of the surface, or, inside, the reverse.
    """
    if len(points) <= 4:  # of two cores that are points or pieces of lines
        return _outside(points)
    equations = ConvexHull(points).equations
    nearest = int(equations[:, 3].argmax())
    if equations[nearest, 3] < 0.0:
        return float(equations[nearest, 3]), -equations[nearest, :3]
    return _outside(points)


def _outside(points: Array) -> tuple[float, Array]:
    """Return the distance of the origin from the hull of points around it, and the way there."""
    weights, _ = nnls(np.vstack([points.T, np.ones(len(points))]), np.array([0.0, 0.0, 0.0, 1.0]))
    nearest = points.T @ (weights / weights.sum())
    distance = float(np.linalg.norm(nearest))
    return distance, nearest / max(distance, 1e-300)


def _spiral(count: int) -> Array:
    k = np.arange(count) + 0.5
    height, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + 5.0**0.5) * k
    across = np.sqrt(1.0 - height**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)


def _between_bounds(first: Placed, second: Placed) -> tuple[float, Array]:
    """Return likewise, of solids that are curved.

    The hull of some points of the difference is inside of it, and every direction has a plane that
    is outside of it. Points are added where the hull is nearest, until both tell the same.
    """

    def reached(ways: Array) -> Array:
        return second.furthest(ways) - first.furthest(-ways)

    axes = np.vstack([first.rotation.T, second.rotation.T])  # or a flat cone's apex is missed
    points = reached(np.vstack([_spiral(60), axes, -axes]))
    lower = -np.inf  # the largest gap that a plane leaves
    for _ in range(MOST):
        upper, way = _outside(points)
        looked = -way[None, :]
        if upper < AGREED:
            hull = ConvexHull(points)
            points = points[hull.vertices]
            nearest = np.argsort(-hull.equations[:, 3])[:50]
            planes = hull.equations[nearest]
            upper = float(planes[0, 3])
            looked = planes[planes[:, 3] >= max(min(lower, upper), 1.5 * upper), :3]
        found = reached(looked)
        gaps = -np.einsum("ij,ij->i", found, looked)
        if gaps.max() > lower:
            lower, best = float(gaps.max()), -looked[gaps.argmax()]
        if upper - lower < AGREED:
            return lower, best
        points = np.vstack([points, found])
    raise AssertionError(f"{first} {second}: {lower} and {upper} do not agree")
