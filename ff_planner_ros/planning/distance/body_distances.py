"""Signed distances of the robot's bodies from each other and from spheres, with derivatives.

Coal measures pairs of bodies, and the distance of a sphere's centre from a convex hull; from a
ball, capsule, box or cylinder it has a closed form. The check uses these, the search the core.
Places and axes are in the base frame.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.distance.bodies import (
    Placed,
    carriers,
    kinds_and_sizes,
    pairs,
    radii,
)
from ff_planner_ros.robot.collision.bodies import Body
from ff_planner_ros.robot.collision.primitives import Kind, kind_and_sizes
from ff_planner_ros.robot.model import Robot

# Distances are exact to this [m], and depths nearly so: asked for better ones, Coal sometimes fails
# in round solids.
_EXACT, _EXACT_DEPTH = 1e-8, 1e-6
# No robot is so deep in itself [m]: Coal failed.
_ABSURD = 1e3
# A shorter vector has no direction: the point is on an axis, or in a centre [m].
NO_DIRECTION = 1e-12


class Distances(NamedTuple):
    """Signed distances, and the points and normals that their derivatives need; one a row."""

    distance: Array  # negative: penetration depth; shape (rows,) [m]
    point: Array  # on the line through both nearest points; shape (rows, 3) [m]
    normal: Array  # unit vector, from the first to the second; shape (rows, 3)


def pair_bounds(robot: Robot, placed: Placed) -> Array:
    """Return lower bounds of the distances of pairs, by bounding spheres.

    Shape (configurations, pairs) [m].
    """
    (first, second), around = pairs(robot), radii(robot)
    apart = np.linalg.norm(placed.centers[:, first] - placed.centers[:, second], axis=-1)
    bounds: Array = apart - around[first] - around[second]
    return bounds


def pair_distances(robot: Robot, placed: Placed, rows: tuple[Indices, ...]) -> Distances:
    """Measure pairs of bodies; rows: configurations and pair numbers, each of shape (rows,)."""
    request, measures, result = coal_request(), _pair_measures(robot), coal.DistanceResult()
    transforms = [coal.Transform3s() for _ in robot.bodies]
    set_to = [-1] * len(transforms)
    rotations, positions = placed.rotations, placed.positions
    count = len(rows[0])
    distance, point, normal = np.empty(count), np.empty((count, 3)), np.empty((count, 3))
    for row, (at, number) in enumerate(zip(*(each.tolist() for each in rows), strict=True)):
        first, second = robot.pairs[number]
        for body in (first, second):
            if set_to[body] != at:
                transforms[body].setTransform(rotations[at, body], positions[at, body])
                set_to[body] = at
        result.clear()
        distance[row] = measures[number](transforms[first], transforms[second], request, result)
        point[row] = result.getNearestPoint2()
        normal[row] = result.normal
    for row in np.flatnonzero(has_failed(distance, normal) | (distance < 0.0)).tolist():
        at, number = (int(each[row]) for each in rows)
        first, second = (
            PlacedSolid(robot.bodies[k].solid, coal.Transform3s(rotations[at, k], positions[at, k]))
            for k in robot.pairs[number]
        )
        found = measured_otherwise(first, second, distance[row], normal[row])
        if found is not None:
            distance[row], point[row], normal[row] = found
    for row in np.flatnonzero(has_failed(distance, normal)).tolist():
        distance[row], point[row], normal[row] = _as_spheres(
            robot, placed, *(at[row] for at in rows)
        )
    return Distances(distance, point, normal)


def has_failed(distance: Array, normal: Array) -> NDArray[np.bool_]:
    """Tell for which rows Coal failed: distance or normal is absurd. Shape (rows,)."""
    is_far = ~(np.abs(distance) < _ABSURD)
    return np.asarray(is_far | ~(np.abs(normal).max(axis=1, initial=0.0) <= 2.0), np.bool_)


class PlacedSolid(NamedTuple):
    """A solid in a place."""

    solid: coal.CollisionGeometry
    at: coal.Transform3s


def measured_otherwise(
    first: PlacedSolid, second: PlacedSolid, distance: float, normal: Array
) -> tuple[float, Array, Array] | None:
    """Return distance, point and normal, as in `Distances`, where those of Coal are wrong.

    In a cylinder, Coal 3.0.3 takes a sphere's depth from the mantle even if an end is nearer. And
    of solids that touch it fails in one order at one pair in a thousand, but not in the other.
    """
    match first.solid, second.solid:
        case coal.Sphere(), coal.Cylinder() if distance < 0.0:
            deep, point, out = _in_cylinder(second, first)
            return deep, point, -out
        case coal.Cylinder(), coal.Sphere() if distance < 0.0:
            return _in_cylinder(first, second)
    if not has_failed(np.array([distance]), normal[None]).any():
        return None
    result = coal.DistanceResult()
    exchanged = coal.distance(*second, *first, coal_request(), result)
    return float(exchanged), np.array(result.getNearestPoint1()), -np.array(result.normal)


def line_from(begin: Array, stretch: Array) -> PlacedSolid:
    """Return a line from its begin, (3,) [m], along a stretch, (3,) [m], as a thin capsule."""
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), stretch).toRotationMatrix()
    solid = coal.Capsule(0.0, float(np.linalg.norm(stretch)))
    return PlacedSolid(solid, coal.Transform3s(turn, begin + stretch / 2))


def _in_cylinder(tube: PlacedSolid, ball: PlacedSolid) -> tuple[float, Array, Array]:
    """Return the distance of a cylinder from a sphere, with point and normal."""
    rotation, center = tube.at.getRotation(), ball.at.getTranslation()
    seen = rotation.T @ (center - tube.at.getTranslation())
    sizes = np.array([[tube.solid.radius, tube.solid.halfLength]])
    (distance,), (out,) = _from_cylinders(seen[None], sizes)
    grown = tube.solid.getSweptSphereRadius() + ball.solid.getSweptSphereRadius()
    return float(distance) - ball.solid.radius - grown, np.array(center), rotation @ out


def _as_spheres(
    robot: Robot, placed: Placed, at: np.intp, number: np.intp
) -> tuple[float, Array, Array]:
    """Return the distance of a pair's bounding spheres, with point and normal."""
    first, second = robot.pairs[number]
    ends = placed.centers[at, first], placed.centers[at, second]
    return between_spheres(*ends, robot.bodies[first].radius, robot.bodies[second].radius)


def between_spheres(
    start: Array, end: Array, first: float, second: float
) -> tuple[float, Array, Array]:
    """Return the distance of two spheres, with point and normal as in `Distances`.

    Args:
        start: Centre of the first. Shape (3,) [m].
        end: Centre of the second.
        first: Radius of the first [m].
        second: Radius of the second.
    """
    apart = float(np.linalg.norm(end - start))
    normal = (end - start) / apart if apart > NO_DIRECTION else np.array([1.0, 0.0, 0.0])
    return apart - first - second, end, normal


@lru_cache(maxsize=8)
def _pair_measures(robot: Robot) -> tuple[coal.ComputeDistance, ...]:
    # Coal keeps no reference to the solids: they live as long as the robot, and the cache keeps it.
    solids = [body.solid for body in robot.bodies]
    return tuple(coal.ComputeDistance(solids[a], solids[b]) for a, b in robot.pairs)


def coal_request() -> coal.DistanceRequest:
    """Return a request to Coal for signed distances, to `_EXACT`, and depths, to `_EXACT_DEPTH`."""
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    request.gjk_tolerance, request.epa_tolerance = _EXACT, _EXACT_DEPTH
    return request


def sphere_bounds(robot: Robot, placed: Placed, centers: Array, radius: Array) -> Array:
    """Return lower bounds of the distances of bodies from spheres, by bounding spheres.

    Args:
        centers: Of the spheres, in the base frame. Shape (configurations, spheres, 3) [m].
        radius: Of the spheres. Shape (spheres,) [m].

    Returns:
        Shape (configurations, bodies, spheres) [m].
    """
    apart = np.linalg.norm(placed.centers[:, :, None] - centers[:, None], axis=-1)
    bounds: Array = apart - radii(robot)[:, None] - radius
    return bounds


def sphere_distances(
    robot: Robot,
    placed: Placed,
    centers: Array,
    radius: Array,
    rows: tuple[Indices, ...],
) -> Distances:
    """Measure bodies against spheres.

    Args:
        centers: As in `sphere_bounds`.
        radius: Likewise.
        rows: Configurations, bodies and spheres, each of shape (rows,).
    """
    configuration, body, sphere = rows
    center = centers[configuration, sphere]
    to_base = placed.rotations[configuration, body]
    away, stretch = (
        center - placed.positions[configuration, body],
        placed.stretches[configuration, body],
    )
    if stretch.any():
        along = np.einsum("ri,ri->r", stretch, stretch)
        part = np.einsum("ri,ri->r", away, stretch) / np.maximum(along, np.finfo(float).tiny)
        away = away - np.clip(part, 0.0, 1.0)[:, None] * stretch
    seen = np.einsum("rji,rj->ri", to_base, away)
    distance, out = np.empty(len(seen)), np.empty((len(seen), 3))
    kinds, sizes = kinds_and_sizes(robot)
    for kind in Kind:
        of_kind = np.flatnonzero(kinds[body] == kind)
        if of_kind.size and kind in _FORMULAS:
            found = _FORMULAS[kind](seen[of_kind], sizes[body[of_kind]])
            distance[of_kind], out[of_kind] = found
        for row in of_kind if kind not in _FORMULAS else ():
            distance[row], out[row] = _from_hull(robot.bodies[body[row]].solid, seen[row])
    normal = np.einsum("rij,rj->ri", to_base, out)
    return Distances(distance - radius[sphere], center, normal)


def distance_from(body: Body, point: Array) -> float:
    """Return the signed distance of a body from a point in the frame of its solid [m]."""
    kind, sizes = kind_and_sizes(body.solid)
    if kind not in _FORMULAS:
        return _from_hull(body.solid, point)[0]
    (distance,), _ = _FORMULAS[kind](point[None], np.array([sizes]))
    return float(distance)


def _from_round(points: Array, sizes: Array) -> tuple[Array, Array]:
    """Return the distance of points from spheres and capsules, and its gradient."""
    radius, half_length = sizes[:, 0], sizes[:, 1]
    way = points.copy()
    way[:, 2] -= np.minimum(np.maximum(points[:, 2], -half_length), half_length)
    length = np.sqrt(np.einsum("ri,ri->r", way, way))
    out = way / np.maximum(length, NO_DIRECTION)[:, None]
    out[length < NO_DIRECTION] = [1.0, 0.0, 0.0]
    return length - radius, out


def _from_boxes(points: Array, sizes: Array) -> tuple[Array, Array]:
    """Return the distance of points from boxes, and its gradient."""
    distance, out = _beyond_corner(np.abs(points), sizes)
    return distance, np.copysign(out, points)


def _from_cylinders(points: Array, sizes: Array) -> tuple[Array, Array]:
    """Return the distance of points from cylinders about z, and its gradient."""
    across = np.hypot(points[:, 0], points[:, 1])
    seen = np.column_stack([across, np.abs(points[:, 2])])
    distance, out = _beyond_corner(seen, sizes[:, :2])
    radial = points[:, :2] / np.maximum(across, NO_DIRECTION)[:, None]
    radial[across < NO_DIRECTION] = [1.0, 0.0]
    return distance, np.column_stack([out[:, :1] * radial, np.copysign(out[:, 1], points[:, 2])])


def _beyond_corner(points: Array, corners: Array) -> tuple[Array, Array]:
    """Return the distance from a box around the origin, of points and corners without a sign."""
    beyond = points - corners
    outside = np.maximum(beyond, 0.0)
    length = np.sqrt(np.einsum("ri,ri->r", outside, outside))
    out = outside / np.maximum(length, NO_DIRECTION)[:, None]
    inside = np.flatnonzero(length < NO_DIRECTION)
    nearest = beyond[inside].argmax(axis=1)
    out[inside] = np.eye(points.shape[1])[nearest]
    length[inside] = beyond[inside, nearest]
    return length, out


_FORMULAS = {
    Kind.ROUND: _from_round,
    Kind.BOX: _from_boxes,
    Kind.CYLINDER: _from_cylinders,
}


def _from_hull(solid: coal.CollisionGeometry, point: Array) -> tuple[float, Array]:
    """Return the distance of a point from any solid, and its gradient."""
    small = coal.Sphere(0.0)
    request, result = coal_request(), coal.DistanceResult()
    here, there = coal.Transform3s(), coal.Transform3s(np.eye(3), point)
    distance = coal.distance(solid, here, small, there, request, result)
    return float(distance), np.array(result.normal)


def pair_gradients(
    robot: Robot, placed: Placed, found: Distances, rows: tuple[Indices, ...]
) -> Array:
    """Return the derivatives of `pair_distances` by the joint angles. Shape (rows, joints).

    Only the joints between two bodies move one against the other.
    """
    first, second = (carriers(robot)[side][rows[1]] for side in pairs(robot))
    turned = _turned(placed, found, rows[0])
    return turned * (_carries(robot, second) - _carries(robot, first))


def sphere_gradients(
    robot: Robot, placed: Placed, found: Distances, rows: tuple[Indices, ...]
) -> Array:
    """Return the derivatives of `sphere_distances` by base and joints. Shape (rows, 6 + joints).

    Those by the base are by its tangent, linear part first, in base axes.
    """
    by_joints = -_turned(placed, found, rows[0]) * _carries(robot, carriers(robot)[rows[1]])
    # Seen from a base that moves, a centre moves the other way.
    by_turn = -np.cross(found.point, found.normal)
    return np.hstack([-found.normal, by_turn, by_joints])


def _turned(placed: Placed, found: Distances, configurations: Indices) -> Array:
    """Return how fast each joint moves what it carries along the normal. Shape (rows, joints)."""
    lever = found.point[:, None] - placed.origins[configurations]
    moved = np.cross(placed.axes[configurations], lever) + placed.slides[configurations]
    along: Array = np.einsum("rji,ri->rj", moved, found.normal)
    return along


def _carries(robot: Robot, joints: Indices) -> Array:
    """Return 1 for each joint that carries a body, else 0. Shape (rows, joints)."""
    return (np.arange(robot.joints) < joints[:, None]).astype(np.float64)
