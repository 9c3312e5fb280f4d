"""Signed distances of the robot's bodies from convex obstacles, by Coal.

`with_bodies` makes bodies of the centre lines of a robot that has no others.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, Indices, frozen
from ff_planner_ros.planning.distance.bodies import Placed, centers_in_base
from ff_planner_ros.planning.distance.body_distances import (
    Distances,
    PlacedSolid,
    between_spheres,
    coal_request,
    has_failed,
    line_from,
    measured_otherwise,
    sphere_bounds,
)
from ff_planner_ros.planning.distance.clearance import centers_at
from ff_planner_ros.planning.problem.obstacles import Obstacle
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.quaternion import rotation_from_quaternion


def obstacle_poses(one: Obstacle, times: Array) -> tuple[Array, Array]:
    """Return an obstacle's axes to inertial axes, (times, 3, 3), and origin, (times, 3) [m].

    Args:
        times: From the plan's first point on. Shape (times,) [s].
    """
    if one.is_sphere:
        return np.broadcast_to(np.eye(3), (len(times), 3, 3)), centers_at(times, [one])[:, 0]
    return one.motion.poses(times)


def obstacle_place(one: Obstacle, time: float) -> pin.SE3:
    """Return an obstacle's pose in the inertial frame at a time from the plan's first point [s]."""
    rotations, origins = obstacle_poses(one, np.array([time]))
    return pin.SE3(rotations[0], origins[0])


def around_obstacles(obstacles: Sequence[Obstacle], times: Array) -> tuple[Array, Array]:
    """Return centres, (times, obstacles, 3), and radii of obstacles' bounding spheres [m].

    Args:
        times: From the plan's first point on. Shape (times,) [s].
    """
    centers, radii = np.empty((len(times), len(obstacles), 3)), np.empty(len(obstacles))
    for number, one in enumerate(obstacles):
        rotations, centers[:, number] = obstacle_poses(one, times)
        centers[:, number] += rotations @ one.solid.center
        radii[number] = one.radius
    return centers, radii


class Poses(NamedTuple):
    """Poses of obstacles at each configuration, in the base frame."""

    rotations: Array  # of their axes; shape (configurations, obstacles, 3, 3)
    positions: Array  # of their origins; shape (configurations, obstacles, 3) [m]


def seen_from_chaser(q: Array, times: Array, obstacles: Sequence[Obstacle]) -> Poses:
    """Return the poses of obstacles in the base frame.

    Args:
        q: Shape (configurations, 7 + joints).
        times: From the plan's first point on. Shape (configurations,) [s].
    """
    rotations, positions = poses_at(times, obstacles)
    to_inertial = rotation_from_quaternion(q[:, 3:7])
    return Poses(
        np.einsum("cji,cojk->coik", to_inertial, rotations),
        centers_in_base(q, positions),
    )


def body_centers(obstacles: Sequence[Obstacle], times: Array) -> Array:
    """Return the centres of obstacles' bounding spheres. Shape (times, obstacles, 3) [m].

    Args:
        times: From the plan's first point on. Shape (times,) [s].
    """
    begins, velocities, turning = _uniform_centers(tuple(obstacles))
    centers: Array = begins + times[:, None, None] * velocities
    if turning:
        few = [obstacles[number] for number in turning]
        rotations, positions = poses_at(times, few)
        offsets = np.array([one.solid.center for one in few])
        centers[:, turning] = positions + np.einsum("toij,oj->toi", rotations, offsets)
    return centers


@lru_cache(maxsize=8)
def _uniform_centers(obstacles: tuple[Obstacle, ...]) -> tuple[Array, Array, list[int]]:
    """Return centres at the plan's first point, their velocities, and who rotates."""
    moved = [one.motion for one in obstacles]
    begins = [
        motion.position + motion.rotation @ one.solid.center
        for motion, one in zip(moved, obstacles, strict=True)
    ]
    velocities = [motion.velocity for motion in moved]
    turning = [number for number, motion in enumerate(moved) if motion.turns]
    return frozen(np.reshape(begins, (-1, 3))), frozen(np.reshape(velocities, (-1, 3))), turning


def poses_at(times: Array, obstacles: Sequence[Obstacle]) -> tuple[Array, Array]:
    """Return axes to inertial axes, (times, obstacles, 3, 3), and origins, (..., 3) [m].

    The motion of a target body is computed once for all that is fixed to it.

    Args:
        times: From the plan's first point on. Shape (times,) [s].
    """
    rotations = np.empty((len(times), len(obstacles), 3, 3))
    positions = np.empty((len(times), len(obstacles), 3))
    fixed: dict[int, tuple[TargetBody, list[int]]] = {}
    for number, one in enumerate(obstacles):
        if one.body is None:
            rotations[:, number], positions[:, number] = one.motion.poses(times)
        else:
            fixed.setdefault(id(one.body), (one.body, []))[1].append(number)
    for body, held in fixed.values():
        every = [obstacles[number].motion.place_in_body for number in held]
        places, turned = (
            [place for place in every if place is not None],
            body.motion(np.zeros(3), times),
        )
        offsets = np.array([place.translation for place in places])
        positions[:, held] = turned.positions[:, None] + np.einsum(
            "tij,oj->toi", turned.rotations, offsets
        )
        axes = np.array([place.rotation for place in places])
        rotations[:, held] = turned.rotations[:, None] @ axes
    return rotations, positions


def obstacle_bounds(
    robot: Robot, placed: Placed, q: Array, times: Array, obstacles: Sequence[Obstacle]
) -> Array:
    """Return lower bounds of the distances of bodies from obstacles, by bounding spheres.

    Args:
        q: Shape (configurations, 7 + joints).
        times: From the plan's first point on. Shape (configurations,) [s].

    Returns:
        Shape (configurations, bodies, obstacles) [m].
    """
    around = np.array([one.solid.radius for one in obstacles])
    centers = centers_in_base(q, body_centers(obstacles, times))
    return sphere_bounds(robot, placed, centers, around)


def obstacle_distances(
    robot: Robot,
    placed: Placed,
    poses: Poses,
    obstacles: Sequence[Obstacle],
    rows: tuple[Indices, ...],
) -> Distances:
    """Measure bodies against obstacles; places and axes are in the base frame.

    Args:
        rows: Configurations, bodies and obstacles, each of shape (rows,).
    """
    request, result, count = coal_request(), coal.DistanceResult(), len(rows[0])
    distance, point, normal = np.empty(count), np.empty((count, 3)), np.empty((count, 3))
    here, there = coal.Transform3s(), coal.Transform3s()
    at, bodies, numbers = rows
    places = zip(
        *(placed.rotations[at, bodies], placed.positions[at, bodies]),
        *(poses.rotations[at, numbers], poses.positions[at, numbers]),
        *(bodies.tolist(), numbers.tolist()),
        strict=True,
    )
    for row, (turned, moved, other_turned, other_moved, body, number) in enumerate(places):
        here.setTransform(turned, moved)
        there.setTransform(other_turned, other_moved)
        result.clear()
        if not robot.bodies[body].stretches:
            measure = _measure(robot, body, obstacles[number])
            distance[row] = measure(here, there, request, result)
        else:
            line = line_from(moved, placed.stretches[at[row], body])
            other = obstacles[number].solid.geometry
            distance[row] = coal.distance(*line, other, there, request, result)
        point[row] = result.getNearestPoint2()
        normal[row] = result.normal
    for row in np.flatnonzero(has_failed(distance, normal) | (distance < 0.0)).tolist():
        time, body, number = (int(each[row]) for each in rows)
        here.setTransform(placed.rotations[time, body], placed.positions[time, body])
        there.setTransform(poses.rotations[time, number], poses.positions[time, number])
        first = PlacedSolid(robot.bodies[body].solid, here)
        if robot.bodies[body].stretches:
            first = line_from(placed.positions[time, body], placed.stretches[time, body])
        second = PlacedSolid(obstacles[number].solid.geometry, there)
        found = measured_otherwise(first, second, distance[row], normal[row])
        if found is not None:
            distance[row], point[row], normal[row] = found
    for row in np.flatnonzero(has_failed(distance, normal)).tolist():
        time, body, number = (int(each[row]) for each in rows)
        solid = obstacles[number].solid
        center = poses.positions[time, number] + poses.rotations[time, number] @ solid.center
        distance[row], point[row], normal[row] = between_spheres(
            placed.centers[time, body], center, robot.bodies[body].radius, solid.radius
        )
    return Distances(distance, point, normal)


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


@lru_cache(maxsize=4096)
def _measure(robot: Robot, body: int, obstacle: Obstacle) -> coal.ComputeDistance:
    # Coal keeps no reference to the solids: the cache keeps those that it is asked for.
    return coal.ComputeDistance(robot.bodies[body].solid, obstacle.solid.geometry)
