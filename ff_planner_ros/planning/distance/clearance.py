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
from ff_planner_ros.core.conversions import chain_of, sphere_arrays
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
    centers, velocities, _ = sphere_arrays(spheres)
    moved: Array = centers + times[:, None, None] * velocities
    bodies = {id(sphere.body): sphere.body for sphere in spheres if sphere.body is not None}
    for body in bodies.values():
        attached = [k for k, sphere in enumerate(spheres) if sphere.body is body]
        levers = np.array([spheres[k].motion.lever for k in attached])
        moved[:, attached] = body.places(levers, times)
    return moved


def highest_speeds(spheres: Sequence[Obstacle]) -> Array:
    """Return upper bounds of the speeds of the spheres' centres. Shape (spheres,) [m/s]."""
    _, velocities, _ = sphere_arrays(spheres)
    speeds: Array = np.linalg.norm(velocities, axis=1)
    for k, sphere in enumerate(spheres):
        if sphere.body is not None:
            speeds[k] = sphere.highest_speed
    return speeds


def may_be_nearest(
    positions: Array,
    times: Array,
    starts: Indices,
    spheres: Sequence[Obstacle],
    moved: Array | float = 0.0,
) -> list[Obstacle]:
    """Return the spheres that are not surely further from the arm than another one.

    A sphere is left out whose distance from the box around all `positions` exceeds a distance of
    the arm from a sphere.

    Args:
        moved: How far arm and each sphere may move, together, from where they are at the times.
            Shape (spheres,) [m].
    """
    _, _, radii = sphere_arrays(spheres)
    ends = [0, len(times) // 2, -1]
    within = clearances(positions[ends], times[ends], starts, spheres).distance.min()
    fixed_to_bodies = any(sphere.body is not None for sphere in spheres)
    centers = centers_at(times if fixed_to_bodies else times[[0, -1]], spheres)
    low, high = positions.min(axis=(0, 1)), positions.max(axis=(0, 1))
    apart = np.maximum(low - centers.max(axis=0), centers.min(axis=0) - high)
    least = np.linalg.norm(np.maximum(apart, 0.0), axis=1) - radii - moved
    return [one for one, far in zip(spheres, least > within + _SAME_POINT, strict=True) if not far]


def clearances(
    positions: Array,
    times: Array,
    starts: Indices,
    spheres: Sequence[Obstacle],
    centers: Array | None = None,
) -> Clearances:
    """Return the surface distance of every segment from every sphere.

    Args:
        centers: Of `centers_at`. None: they are computed.
    """
    centers = (centers_at(times, spheres) if centers is None else centers)[:, None]
    _, _, radii = sphere_arrays(spheres)
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
