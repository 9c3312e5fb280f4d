"""Distance of the arm's centre lines from spheres, Sec. 3.3 of the paper.

The arm is the chain of line segments between consecutive joint origins, the last ending at the
end effector. Segments without length, as in a spherical wrist, are left out.

Throughout, q are configurations, shape (points, 7 + joints); `positions` are those of `arm_points`,
`times` are those of the points from the plan's first on, shape (points,) [s], and `starts` are the
indices of `segments`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import chain_of
from ff_planner_ros.planning.distance.surroundings import surroundings
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.robot.kinematics import joint_frames
from ff_planner_ros.robot.model import Robot

# Joint origins nearer than this are the same point; drawings are not more exact.
_SAME_POINT = 1e-6
# A prismatic joint may bring a length, which is divided by, to zero.
_TINY = np.finfo(float).tiny


@dataclass(frozen=True, eq=False)
class Clearances:
    """Surface distance of every segment from every sphere at every point."""

    distance: Array  # negative inside the sphere; shape (points, segments, spheres) [m]
    fraction: Array  # place of the nearest point on the segment, 0 to 1; same shape
    offset: Array  # of that point from the sphere's centre; shape (..., 3) [m]

    @property
    def direction(self) -> Array:
        """From the sphere's centre to the nearest point, unit length. Shape (..., 3)."""
        away = np.maximum(np.linalg.norm(self.offset, axis=-1), _SAME_POINT)
        return np.asarray(self.offset / away[..., None], np.float64)


def arm_points(robot: Robot, q: Array) -> Array:
    """Return joint origins and end effector, inertial frame. Shape (points, joints + 1, 3) [m]."""
    _, points = joint_frames(robot, q)
    return points


def arm_points_with_derivatives(
    robot: Robot, q: Array, q_sensitivity: Array
) -> tuple[Array, Array]:
    """Return `arm_points` and their derivatives, shape (points, joints + 1, 3, columns).

    Args:
        q_sensitivity: Derivatives of q in its tangent space. Shape (points, 6 + joints, columns).
    """
    return compiled.arm_points_with_derivatives(chain_of(robot), q, q_sensitivity)


def segments(positions: Array) -> Indices:
    """Return the indices of the points that start a segment of some length, at any time."""
    length = np.linalg.norm(np.diff(positions, axis=1), axis=2)
    return np.flatnonzero((length > _SAME_POINT).any(axis=0))


def centers_at(times: Array, spheres: Sequence[Obstacle]) -> Array:
    """Return the spheres' centres in the inertial frame. Shape (points, spheres, 3) [m]."""
    return surroundings(tuple(spheres)).centers(times)


def clearances(
    positions: Array, times: Array, starts: Indices, spheres: Sequence[Obstacle]
) -> Clearances:
    """Return the surface distance of every segment from every sphere."""
    centers = centers_at(times, spheres)[:, None]
    radii = np.array([one.radius for one in spheres])
    start, end = positions[:, starts, None], positions[:, starts + 1, None]
    along = end - start
    from_center = start - centers
    fraction = -_dot(from_center, along) / np.maximum(_dot(along, along), _TINY)
    fraction = np.minimum(np.maximum(fraction, 0.0), 1.0)  # numpy's `clip` takes twice as long
    offset = from_center + fraction[..., None] * along
    return Clearances(np.sqrt(_dot(offset, offset)) - radii, fraction, offset)


def _dot(a: Array, b: Array) -> Array:
    """Return the products of vectors along the last axis."""
    return np.asarray(np.einsum("...k,...k->...", a, b), np.float64)


def clearance_gradients(
    clear: Clearances, derivatives: Array, starts: Indices, rows: tuple[Indices, ...]
) -> Array:
    """Return the derivatives of selected distances.

    The nearest point of a segment moves with the segment; its sliding along it does not change
    the distance to first order.

    Args:
        derivatives: Of `arm_points_with_derivatives`.
        rows: Indices into `clear.distance`.

    Returns:
        Shape (rows, columns).
    """
    point, segment, _ = rows
    start, end = derivatives[point, starts[segment]], derivatives[point, starts[segment] + 1]
    moving = start + clear.fraction[rows][:, None, None] * (end - start)
    gradients: Array = np.einsum("rk,rkc->rc", clear.direction[rows], moving)
    return gradients


def penalty(distance: Array, gain: float, exponent: float) -> float:
    """Return R_obst of Eqs. (46) and (47) with g1 and g2, from the distance of `Clearances`.

    The paper's delta_k is the distance of the whole arm from a centre: the nearest segment's.
    """
    depth = np.maximum(0.0, -distance.min(axis=1))
    return float(np.sum(gain * depth[depth > 0.0] ** exponent))
