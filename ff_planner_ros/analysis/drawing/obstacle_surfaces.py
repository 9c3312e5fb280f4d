"""Triangle meshes of obstacles, and their poses over time."""

from __future__ import annotations

import numpy as np

from ff_planner_ros.analysis.drawing.solids import Triangles, surface_of
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.surroundings import obstacle_poses
from ff_planner_ros.planning.problem.obstacles import Obstacle


def obstacle_surface(one: Obstacle, around: int) -> tuple[Array, Triangles]:
    """Return the surface of an obstacle in its own frame; a circle has `around` corners."""
    return surface_of(one.solid.geometry, around)


def placed(one: Obstacle, corners: Array, times: Array) -> Array:
    """Return points of an obstacle at some times, in the inertial frame.

    Args:
        corners: In its own frame. Shape (corners, 3) [m].
        times: Since the plan's first point. Shape (times,) [s].

    Returns:
        Shape (times, corners, 3) [m].
    """
    rotations, origins = obstacle_poses(one, times)
    points: Array = origins[:, None] + corners @ rotations.swapaxes(1, 2)
    return points


def outline(points: Array) -> Array:
    """Return the corners of the convex hull of points in a plane, in order; (corners, 2)."""
    from scipy.spatial import ConvexHull  # half a second, which no scene of triangles needs

    return np.array(points[ConvexHull(points).vertices])


def obstacle_words(one: Obstacle) -> str:
    """Return an obstacle's id, shape and size."""
    return f"{one.id}, {f'radius {one.radius:g} m' if one.is_sphere else one.solid.words}"
