"""Signed distances of convex solids: by Coal, and of points by formulas where there are any."""

from __future__ import annotations

from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.collision.primitives import Kind

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


class Solids(NamedTuple):
    """Solids in their places, one a row."""

    solids: list[coal.CollisionGeometry]
    rotations: Array  # shape (rows, 3, 3)
    positions: Array  # shape (rows, 3) [m]
    centers: Array  # of their bounding spheres; shape (rows, 3) [m]
    radii: Array  # of these; shape (rows,) [m]

    def placed(self, row: int) -> PlacedSolid:
        """Return that of a row."""
        at = coal.Transform3s(self.rotations[row], self.positions[row])
        return PlacedSolid(self.solids[row], at)


def solids_apart(first: Solids, second: Solids) -> Distances:
    """Return the distances of solids by Coal."""
    request, result, count = coal_request(), coal.DistanceResult(), len(first.solids)
    distance, point, normal = np.empty(count), np.empty((count, 3)), np.empty((count, 3))
    here, there = coal.Transform3s(), coal.Transform3s()
    for row, (one, turned, moved, other, other_turned, other_moved) in enumerate(
        zip(*first[:3], *second[:3], strict=True)
    ):
        here.setTransform(turned, moved)
        there.setTransform(other_turned, other_moved)
        result.clear()
        distance[row] = coal.distance(one, here, other, there, request, result)
        point[row] = result.getNearestPoint2()
        normal[row] = result.normal
    for row in np.flatnonzero(has_failed(distance, normal) | (distance < 0.0)).tolist():
        both = first.placed(row), second.placed(row)
        found = measured_otherwise(*both, distance[row], normal[row])
        if found is not None:
            distance[row], point[row], normal[row] = found
    for row in np.flatnonzero(has_failed(distance, normal)).tolist():
        balls = *(one.centers[row] for one in (first, second)), first.radii[row], second.radii[row]
        distance[row], point[row], normal[row] = between_spheres(*balls)
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


def distance_between(
    first: coal.CollisionGeometry, at: pin.SE3, second: coal.CollisionGeometry, there: pin.SE3
) -> float:
    """Return the signed distance of two solids whose poses are in one frame [m]."""
    return nearest_points(first, at, second, there)[0]


def nearest_points(
    first: coal.CollisionGeometry, at: pin.SE3, second: coal.CollisionGeometry, there: pin.SE3
) -> tuple[float, Array]:
    """Return the signed distance of two solids [m], and where they are nearest, (2, 3) [m]."""
    one, other = (
        PlacedSolid(solid, coal.Transform3s(place.rotation, place.translation))
        for solid, place in ((first, at), (second, there))
    )
    result = coal.DistanceResult()
    distance = float(coal.distance(*one, *other, coal_request(), result))
    found = measured_otherwise(one, other, distance, np.array(result.normal))
    if found is None:
        return distance, np.array([result.getNearestPoint1(), result.getNearestPoint2()])
    distance, point, normal = found
    return distance, np.array([point - distance * normal, point])


def _in_cylinder(tube: PlacedSolid, ball: PlacedSolid) -> tuple[float, Array, Array]:
    """Return the distance of a cylinder from a sphere, with point and normal."""
    rotation, center = tube.at.getRotation(), ball.at.getTranslation()
    seen = rotation.T @ (center - tube.at.getTranslation())
    sizes = np.array([[tube.solid.radius, tube.solid.halfLength]])
    (distance,), (out,) = _from_cylinders(seen[None], sizes)
    grown = tube.solid.getSweptSphereRadius() + ball.solid.getSweptSphereRadius()
    return float(distance) - ball.solid.radius - grown, np.array(center), rotation @ out


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


def coal_request() -> coal.DistanceRequest:
    """Return a request to Coal for signed distances, to `_EXACT`, and depths, to `_EXACT_DEPTH`."""
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    request.gjk_tolerance, request.epa_tolerance = _EXACT, _EXACT_DEPTH
    return request


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


FORMULAS = {
    Kind.ROUND: _from_round,
    Kind.BOX: _from_boxes,
    Kind.CYLINDER: _from_cylinders,
}


def from_hull(solid: coal.CollisionGeometry, point: Array) -> tuple[float, Array]:
    """Return the distance of a point from any solid, and its gradient."""
    small = coal.Sphere(0.0)
    request, result = coal_request(), coal.DistanceResult()
    here, there = coal.Transform3s(), coal.Transform3s(np.eye(3), point)
    distance = coal.distance(solid, here, small, there, request, result)
    return float(distance), np.array(result.normal)
