"""Distances of the robot's parts from obstacles when its base deviates from the plan.

With controlled joints the robot keeps its shape in the base frame, and the obstacles move in it. A
distance changes by no more than the obstacle's farthest point moves, so that few distances of many
runs need be measured. A part is a body or a centre line.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.distance.allowed_contact import kept_apart
from ff_planner_ros.planning.distance.bodies import Placed, centers_in_base, placed_bodies
from ff_planner_ros.planning.distance.body_distances import obstacle_bounds, obstacle_distances
from ff_planner_ros.planning.distance.solids_apart import Distances
from ff_planner_ros.planning.distance.surroundings import (
    Poses,
    Surroundings,
    obstacle_poses,
    surroundings,
)
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.problem.settings import MOST_SIGMAS
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.kinematics import rotation_base_to_inertial
from ff_planner_ros.robot.model import Robot

# A part that is further by this many standard deviations than the nearest is never the nearest; a
# plan cannot be asked to keep more.
_FAR = MOST_SIGMAS
_SAME_POINT = 1e-12  # [m]
# Distances from other obstacles than spheres that exceed a measured one by so much [m] are bounded
# below by bounding spheres instead.
_NOT_MEASURED = 0.5
_AT_ONCE = 20_000  # distances whose derivatives are in memory


@dataclass(frozen=True, eq=False)
class Nearness:
    """Distances of parts from obstacles along the planned motion.

    Centres of obstacles are those of their bounding spheres.
    """

    robot: Robot  # its bodies are the parts
    base_q: Array  # shape (times, 7 + joints)
    around: Surroundings
    rotations: Array  # of the obstacles' axes to inertial axes; shape (times, obstacles, 3, 3)
    origins: Array  # of the obstacles, inertial frame; shape (times, obstacles, 3) [m]
    centers: Array  # likewise
    distance: Array  # infinite where they may touch; shape (times, parts, obstacles) [m]
    normal: Array  # from part to obstacle, inertial axes; shape (times, parts, obstacles, 3)
    places: Array  # on the line through both nearest points, inertial frame; likewise [m]
    placed: Placed

    @property
    def is_empty(self) -> bool:
        """Whether there is no distance to keep."""
        return not np.isfinite(self.distance).any()

    def by_errors(self, spread: Array, rows: tuple[Indices, ...]) -> Array:
        """Return the derivatives of some distances by the errors of `base_spread`.

        A part moves by zeta_v + zeta_w x p towards the obstacle, with p anywhere on the line
        through both nearest points: a sphere's centre is on it.

        Args:
            spread: Shape (times, 6, errors).
            rows: Times, parts and obstacles.

        Returns:
            Shape (rows, errors).
        """
        normals, places = self.normal[rows], self.places[rows]
        wrench = np.concatenate([normals, np.cross(places, normals)], axis=1)
        found: Array = -np.einsum("ri,rie->re", wrench, spread[rows[0]])
        return found

    def sigmas(self, spread: Array) -> Array:
        """Return the standard deviation of each distance. Shape (times, parts, obstacles) [m]."""
        every, found = np.nonzero(np.ones_like(self.distance, bool)), np.empty(self.distance.size)
        for first in range(0, found.size, _AT_ONCE):
            some = slice(first, first + _AT_ONCE)
            rows = tuple(each[some] for each in every)
            found[some] = np.linalg.norm(self.by_errors(spread, rows), axis=1)
        return found.reshape(self.distance.shape)

    def rows_near(self, spread: Array) -> tuple[Indices, ...]:
        """Return times, parts and obstacles that may be nearest within `_FAR` deviations."""
        sigmas = self.sigmas(spread)
        highest = (self.distance + _FAR * sigmas).min(initial=np.inf)
        return np.nonzero(self.distance - _FAR * sigmas <= highest)

    def least(self, rotations: Array, positions: Array) -> Array:
        """Return the least distance of each run [m].

        Args:
            rotations: Base to inertial axes. Shape (times, runs, 3, 3).
            positions: Of the base, inertial frame. Shape (times, runs, 3) [m].
        """
        runs = positions.shape[1]
        if self.is_empty:
            return np.full(runs, np.inf)
        seen = np.einsum(
            "trji,trsj->trsi", rotations, self.centers[:, None] - positions[:, :, None]
        )
        base = rotation_base_to_inertial(self.base_q)
        modelled = np.einsum("tji,tsj->tsi", base, self.centers - self.base_q[:, None, :3])
        moved = np.linalg.norm(seen - modelled[:, None], axis=-1)  # (times, runs, obstacles)
        # One that is turned about its centre moves by its radius times this.
        turned = np.linalg.norm(rotations - base[:, None], axis=(-2, -1)) / np.sqrt(2.0)
        radii = np.where(self.around.are_spheres, 0.0, self.around.radii)
        moved += turned[:, :, None] * radii
        nearest = self.distance.min(axis=1)  # (times, obstacles)
        highest = (nearest[:, None] + moved).min(axis=(0, 2))
        furthest = moved.max(axis=1)  # (times, obstacles)
        rows = np.nonzero(self.distance - furthest[:, None] <= highest.max())
        time, part, obstacle = rows
        runs_of, index = np.nonzero(
            (self.distance[rows] - moved[time, :, obstacle].T) <= highest[:, None]
        )
        which = time[index], part[index], obstacle[index]
        distances = self._as_seen(which, rotations[which[0], runs_of], positions[which[0], runs_of])
        least = np.full(runs, np.inf)
        np.minimum.at(least, runs_of, distances)
        return least

    def _as_seen(self, rows: tuple[Indices, ...], rotations: Array, positions: Array) -> Array:
        """Return distances where the base is elsewhere. Shape (rows,) [m].

        Args:
            rows: Times, parts and obstacles.
            rotations: Base to inertial axes. Shape (rows, 3, 3).
            positions: Of the base, inertial frame. Shape (rows, 3) [m].
        """
        time, _, obstacle = rows
        to_base = rotations.swapaxes(-1, -2)
        away = self.origins[time, obstacle] - positions
        there = Poses(
            to_base @ self.rotations[time, obstacle], np.einsum("rij,rj->ri", to_base, away)
        )
        return obstacle_distances(self.robot, self.placed, there, self.around, rows).distance


def nearness(robot: Robot, q: Array, times: Array, scene: Scene) -> Nearness:
    """Measure all parts against all obstacles of a scene, but for allowed contacts.

    Args:
        q: Shape (times, 7 + joints).
        times: Shape (times,) [s].
        scene: In the frame of q.
    """
    obstacles = tuple(scene.obstacles)
    around, counts = surroundings(obstacles), kept_apart(robot, obstacles, scene, q, times)
    robot, base = with_bodies(robot), rotation_base_to_inertial(q)
    placed, has_to = placed_bodies(robot, q[:, 7:]), counts.at(np.arange(len(q)))
    found = _distances(robot, placed, q, times, around, has_to)
    poses = [obstacle_poses(one, times) for one in obstacles]
    return Nearness(
        robot=robot,
        base_q=q,
        around=around,
        rotations=np.reshape([turned for turned, _ in poses], (-1, len(q), 3, 3)).swapaxes(0, 1),
        origins=np.reshape([moved for _, moved in poses], (-1, len(q), 3)).swapaxes(0, 1),
        centers=around.centers(times),
        distance=np.where(has_to, found.distance, np.inf),
        normal=np.einsum("tij,tpoj->tpoi", base, found.normal),
        places=q[:, None, None, :3] + np.einsum("tij,tpoj->tpoi", base, found.point),
        placed=placed,
    )


def _distances(
    robot: Robot,
    placed: Placed,
    q: Array,
    times: Array,
    around: Surroundings,
    has_to: NDArray[np.bool_],
) -> Distances:
    """Return distances of parts from obstacles, each of shape (times, parts, obstacles, ...).

    Large ones of other obstacles than spheres are lower bounds, by bounding spheres.

    Args:
        has_to: What must not touch. Shape (times, parts, obstacles).

    Returns:
        Points and normals are seen from the base.
    """
    centers = centers_in_base(q, around.centers(times))
    way = centers[:, None] - placed.centers[:, :, None]
    normal = way / np.maximum(np.linalg.norm(way, axis=-1), _SAME_POINT)[..., None]
    point = np.broadcast_to(centers[:, None], way.shape).copy()
    distance = obstacle_bounds(robot, placed, q, times, around)
    lowest = np.where(has_to, distance, np.inf)

    def measure(rows: tuple[Indices, ...]) -> Distances:
        there = around.seen_from_base(q, times, rows[0], rows[2])
        return obstacle_distances(robot, placed, there, around, rows)

    if lowest.size:
        first = np.unravel_index(lowest.argmin(), lowest.shape)
        met = measure(tuple(np.atleast_1d(at) for at in first)).distance[0]
        rows = np.nonzero((lowest <= met + _NOT_MEASURED) | around.are_spheres)
        distance[rows], point[rows], normal[rows] = measure(rows)
    return Distances(distance, point, normal)
