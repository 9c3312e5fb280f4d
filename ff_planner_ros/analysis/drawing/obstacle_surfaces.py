"""What is in the way as surfaces of triangles, where it is at a time."""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np
from scipy.spatial import ConvexHull

from ff_planner_ros.analysis.drawing.solids import Triangles, surface_of
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.obstacles import Obstacle, Sphere


def obstacle_surface(one: Obstacle, around: int) -> tuple[Array, Triangles]:
    """Return the surface of an obstacle in its own frame; around: corners of a circle."""
    return surface_of(
        coal.Sphere(one.radius) if isinstance(one, Sphere) else one.solid.geometry, around
    )


def placed(one: Obstacle, corners: Array, times: Array) -> Array:
    """Return points of an obstacle at some times, in the inertial frame.

    Args:
        corners: In its own frame. Shape (corners, 3) [m].
        times: From the plan's first point on. Shape (times,) [s].

    Returns:
        Shape (times, corners, 3) [m].
    """
    rotations, origins = obstacle_poses(one, times)
    points: Array = origins[:, None] + corners @ rotations.swapaxes(1, 2)
    return points


def obstacle_poses(one: Obstacle, times: Array) -> tuple[Array, Array]:
    """Return its axes to inertial axes, (times, 3, 3), and its origin, (times, 3) [m]."""
    if isinstance(one, Sphere):
        ways = [one.way(float(time)) for time in times]
        axes = np.broadcast_to(np.eye(3), (len(times), 3, 3))
        return axes, one.center + np.reshape(ways, (-1, 3))
    return one.poses(times)


def around_obstacles(obstacles: Sequence[Obstacle], times: Array) -> tuple[Array, Array]:
    """Return centres of spheres around obstacles, (times, obstacles, 3), and radii [m]."""
    inside = [np.zeros(3) if isinstance(one, Sphere) else one.solid.center for one in obstacles]
    centers = [
        placed(one, at[None], times)[:, 0] for one, at in zip(obstacles, inside, strict=True)
    ]
    radii = [one.radius if isinstance(one, Sphere) else one.solid.radius for one in obstacles]
    return np.reshape(centers, (-1, len(times), 3)).swapaxes(0, 1), np.array(radii)


def outline(points: Array) -> Array:
    """Return the corners of the convex outline of points in a plane, in order; (corners, 2)."""
    return np.array(points[ConvexHull(points).vertices])


def obstacle_words(one: Obstacle) -> str:
    """Return id and shape."""
    shape = f"radius {one.radius:g}" if isinstance(one, Sphere) else one.solid.words
    return f"{one.id}, {shape} m" if isinstance(one, Sphere) else f"{one.id}, {shape}"
