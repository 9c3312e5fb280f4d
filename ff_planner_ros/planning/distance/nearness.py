"""How near every part of the robot is to every obstacle, where its base may be elsewhere.

Where the joints are controlled the robot is the same seen from its base, and the obstacles move. No
distance changes by more than a centre does, so that of many runs few distances need be measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.distance.bodies import Placed, placed_bodies
from ff_planner_ros.planning.distance.body_distances import sphere_distances
from ff_planner_ros.planning.distance.clearance import arm_points, centers_at, segments
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.problem.settings import MOST_SIGMAS
from ff_planner_ros.robot.kinematics import rotation_base_to_inertial
from ff_planner_ros.robot.model import Robot

# Further than this from an obstacle [deviations] beside the nearest, a part is never the nearest;
# as many as a plan may be asked to keep.
_FAR = MOST_SIGMAS
_SAME_POINT = 1e-12  # [m]


@dataclass(frozen=True, eq=False)
class Nearness:
    """Distances of parts from spheres at some times, the base as modelled."""

    robot: Robot
    base_q: Array  # shape (times, 7 + joints)
    radius: Array  # of the spheres; shape (spheres,) [m]
    centers: Array  # of the spheres, inertial axes; shape (times, spheres, 3) [m]
    distance: Array  # infinite where they may touch; shape (times, parts, spheres) [m]
    normal: Array  # from part to sphere, inertial axes; shape (times, parts, spheres, 3)
    placed: Placed | None  # of the bodies; None: parts are the arm's lines
    ends: Array  # of the lines, seen from the base; shape (times, joints + 1, 3) [m]
    starts: Indices  # of the lines

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to be near to."""
        return not np.isfinite(self.distance).any()

    def by_errors(self, spread: Array, rows: tuple[Indices, ...]) -> Array:
        """Return the derivatives of some distances by the errors of `base_spread`.

        A part moves by zeta_v + zeta_w x p towards the sphere, and the distance's normal goes
        through the sphere's centre: p is as good there.

        Args:
            spread: Shape (times, 6, errors).
            rows: Times, parts and spheres.

        Returns:
            Shape (rows, errors).
        """
        normals, places = self.normal[rows], self.centers[rows[0], rows[2]]
        wrench = np.concatenate([normals, np.cross(places, normals)], axis=1)
        found: Array = -np.einsum("ri,rie->re", wrench, spread[rows[0]])
        return found

    def sigmas(self, spread: Array) -> Array:
        """Return the deviation of every distance. Shape (times, parts, spheres) [m]."""
        rows = np.nonzero(np.ones_like(self.distance, bool))
        deviations = np.linalg.norm(self.by_errors(spread, rows), axis=1)
        return np.asarray(deviations.reshape(self.distance.shape), np.float64)

    def rows_near(self, spread: Array) -> tuple[Indices, ...]:
        """Return what may be the nearest where errors are not far beyond their deviations."""
        sigmas = self.sigmas(spread)
        highest = (self.distance + _FAR * sigmas).min(initial=np.inf)
        return np.nonzero(self.distance - _FAR * sigmas <= highest)

    def least(self, rotations: Array, positions: Array) -> Array:
        """Return the least distance of each run [m].

        Args:
            rotations: Base to inertial. Shape (times, runs, 3, 3).
            positions: Of the base. Shape (times, runs, 3) [m].
        """
        runs = positions.shape[1]
        if self.is_empty:
            return np.full(runs, np.inf)
        seen = np.einsum(
            "trji,trsj->trsi", rotations, self.centers[:, None] - positions[:, :, None]
        )
        base = rotation_base_to_inertial(self.base_q)
        modelled = np.einsum("tji,tsj->tsi", base, self.centers - self.base_q[:, None, :3])
        moved = np.linalg.norm(seen - modelled[:, None], axis=-1)  # (times, runs, spheres)
        nearest = self.distance.min(axis=1)  # (times, spheres)
        highest = (nearest[:, None] + moved).min(axis=(0, 2))
        furthest = moved.max(axis=1)  # (times, spheres)
        rows = np.nonzero(self.distance - furthest[:, None] <= highest.max())
        time, part, sphere = rows
        runs_of, index = np.nonzero(
            (self.distance[rows] - moved[time, :, sphere].T) <= highest[:, None]
        )
        which = time[index], part[index], sphere[index]
        distances = self._measured(which, seen[which[0], runs_of, which[2]])
        least = np.full(runs, np.inf)
        np.minimum.at(least, runs_of, distances)
        return least

    def _measured(self, rows: tuple[Indices, ...], centers: Array) -> Array:
        return measured(
            self.robot, self.placed, self.ends, self.starts, rows, centers, self.radius
        )[0]


def nearness(robot: Robot, q: Array, times: Array, scene: Scene) -> Nearness:
    """Measure all parts against all spheres of a scene, but where they may touch.

    Args:
        q: Shape (times, 7 + joints).
        times: Shape (times,) [s].
        scene: In the frame of q.

    Raises:
        InvalidInput: There are obstacles of other shapes.
    """
    if scene.obstacle_bodies:
        allowed = "with uncertain start or masses every obstacle must be a sphere"
        told = f"obstacles[{scene.obstacle_bodies[0].id}].shape"
        raise InvalidInput(Status.UNSUPPORTED, told, "no sphere", allowed)
    centers = centers_at(times, scene.spheres)
    at_origin = q.copy()
    at_origin[:, :7] = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    ends = arm_points(robot, at_origin)
    placed = placed_bodies(robot, q[:, 7:]) if robot.bodies else None
    starts = segments(ends)
    base = rotation_base_to_inertial(q)
    seen = np.einsum("tji,tsj->tsi", base, centers - q[:, None, :3])
    shape = (len(q), len(robot.bodies) or len(starts), len(scene.spheres))
    rows = np.nonzero(np.ones(shape, bool))
    radius = np.array([sphere.radius for sphere in scene.spheres])
    distance, normal = measured(robot, placed, ends, starts, rows, seen[rows[0], rows[2]], radius)
    ee_positions = q[:, :3] + np.einsum("tij,tj->ti", base, ends[:, -1])
    counts = np.arange(len(q))[:, None, None] < _touching_from(robot, scene, ee_positions, times)
    return Nearness(
        robot=robot,
        base_q=q,
        radius=radius,
        centers=centers,
        distance=np.where(counts, distance.reshape(shape), np.inf),
        normal=np.einsum("rij,rj->ri", base[rows[0]], normal).reshape(*shape, 3),
        placed=placed,
        ends=ends,
        starts=starts,
    )


def measured(
    robot: Robot,
    placed: Placed | None,
    ends: Array,
    starts: Indices,
    rows: tuple[Indices, ...],
    centers: Array,
    radius: Array,
) -> tuple[Array, Array]:
    """Return distances of parts from spheres, seen from the base, and the unit vectors to them.

    Args:
        placed: Bodies at all times; None: lines count.
        ends: Of lines, at all times.
        starts: Of lines.
        rows: Times, parts and spheres, each of shape (rows,).
        centers: Of the spheres, seen from the base; shape (rows, 3) [m].
        radius: Of all spheres. Shape (spheres,) [m].
    """
    time, part, sphere = rows
    if placed is not None:
        of_rows = Placed(*(each[time] for each in placed))
        none = np.zeros(len(time), np.intp)
        numbers = np.arange(len(time)), part, none
        found = sphere_distances(robot, of_rows, centers[:, None], np.zeros(1), numbers)
        return found.distance - radius[sphere], found.normal
    start, end = ends[time, starts[part]], ends[time, starts[part] + 1]
    along = end - start
    fraction = np.einsum("ri,ri->r", centers - start, along) / np.einsum("ri,ri->r", along, along)
    way = centers - start - np.clip(fraction, 0.0, 1.0)[:, None] * along
    length = np.linalg.norm(way, axis=1)
    return length - radius[sphere], way / np.maximum(length, _SAME_POINT)[:, None]


def _touching_from(robot: Robot, scene: Scene, ee_positions: Array, times: Array) -> Array:
    """Return the first time from which on each part may touch each sphere, by its number.

    Args:
        scene: In the frame of the positions.
        ee_positions: As planned. Shape (times, 3) [m].
        times: Shape (times,) [s].

    Returns:
        As many as there are times: never. Shape (bodies, spheres); (1, spheres) for lines.
    """
    names = [body.link for body in robot.bodies] or [""]
    never = np.full((len(names), len(scene.spheres)), len(times))
    goal = scene.targets(times)
    if not scene.allowed_collisions or goal is None:
        return never
    away = np.linalg.norm(ee_positions - goal, axis=1) > scene.contact_distance
    outside = np.flatnonzero(away)
    first = int(outside[-1]) + 1 if outside.size else 0
    for row, name in enumerate(names):
        for column, sphere in enumerate(scene.spheres):
            if f"{name}/{sphere.id}" in scene.allowed_collisions:
                never[row, column] = first
    return never
