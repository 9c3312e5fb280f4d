"""Distances of the robot's parts from obstacles when its base deviates from the plan.

With controlled joints the robot keeps its shape in the base frame, and the obstacles move in it. A
distance changes by no more than the obstacle's farthest point moves, so that few distances of many
runs need be measured. A part is a body or a centre line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.distance.allowed_contact import kept_apart
from ff_planner_ros.planning.distance.bodies import Placed, centers_in_base, placed_bodies
from ff_planner_ros.planning.distance.body_distances import Distances, sphere_distances
from ff_planner_ros.planning.distance.clearance import arm_points, centers_at, segments
from ff_planner_ros.planning.distance.obstacle_distances import (
    Poses,
    around_obstacles,
    obstacle_bounds,
    obstacle_distances,
    poses_at,
    seen_from_chaser,
)
from ff_planner_ros.planning.problem.obstacles import Obstacle
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
    """Distances of parts from obstacles along the planned motion; spheres are the first obstacles.

    Centre and radius of an obstacle are those of its bounding sphere.
    """

    robot: Robot
    base_q: Array  # shape (times, 7 + joints)
    others: tuple[Obstacle, ...]  # the obstacles that are no spheres
    rotations: Array  # of their axes to inertial axes; shape (times, others, 3, 3)
    radius: Array  # of the obstacles; shape (obstacles,) [m]
    centers: Array  # of the obstacles, inertial frame; shape (times, obstacles, 3) [m]
    distance: Array  # infinite where they may touch; shape (times, parts, obstacles) [m]
    normal: Array  # from part to obstacle, inertial axes; shape (times, parts, obstacles, 3)
    places: Array  # on the line through both nearest points, inertial frame; likewise [m]
    placed: Placed | None  # of the bodies; None: parts are the arm's lines
    ends: Array  # of the lines, base frame; shape (times, joints + 1, 3) [m]
    starts: Indices  # of the lines

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
        others = slice(len(self.radius) - len(self.others), None)
        if self.others:  # one that is turned about its centre moves by its radius times this
            turned = np.linalg.norm(rotations - base[:, None], axis=(-2, -1)) / np.sqrt(2.0)
            moved[:, :, others] += turned[:, :, None] * self.radius[others]
        nearest = self.distance.min(axis=1)  # (times, obstacles)
        highest = (nearest[:, None] + moved).min(axis=(0, 2))
        furthest = moved.max(axis=1)  # (times, obstacles)
        rows = np.nonzero(self.distance - furthest[:, None] <= highest.max())
        time, part, obstacle = rows
        runs_of, index = np.nonzero(
            (self.distance[rows] - moved[time, :, obstacle].T) <= highest[:, None]
        )
        which = time[index], part[index], obstacle[index]
        distances = np.empty(len(index))
        of_spheres = which[2] < others.start
        some = tuple(each[of_spheres] for each in which)
        distances[of_spheres] = self._from_spheres(
            some, seen[some[0], runs_of[of_spheres], some[2]]
        )
        distances[~of_spheres] = self._from_others(
            tuple(each[~of_spheres] for each in which), runs_of[~of_spheres], rotations, seen
        )
        least = np.full(runs, np.inf)
        np.minimum.at(least, runs_of, distances)
        return least

    def _from_spheres(self, rows: tuple[Indices, ...], centers: Array) -> Array:
        return measured(
            self.robot, self.placed, self.ends, self.starts, rows, centers, self.radius
        )[0]

    def _from_others(
        self, rows: tuple[Indices, ...], runs: Indices, rotations: Array, seen: Array
    ) -> Array:
        """Return the distances from obstacles that are no spheres, as runs see them.

        Args:
            rows: Times, parts and obstacles.
            runs: The run of each row.
            rotations: As in `least`.
            seen: Centres of the obstacles, from the base. Shape (times, runs, obstacles, 3) [m].
        """
        time, part, obstacle = rows
        robot, number = with_bodies(self.robot), obstacle - (len(self.radius) - len(self.others))
        to_base = rotations[time, runs].swapaxes(-1, -2)
        axes = to_base @ self.rotations[time, number]
        offsets = np.array([one.solid.center for one in self.others]).reshape(-1, 3)[number]
        origins = seen[time, runs, obstacle] - np.einsum("rij,rj->ri", axes, offsets)
        placed = placed_bodies(robot, self.base_q[:, 7:])
        found, none = np.empty(len(time)), np.zeros(len(time), np.intp)
        for k in np.unique(number).tolist():
            of = np.flatnonzero(number == k)
            poses = Poses(axes[of][:, None], origins[of][:, None])
            here = Placed(*(each[time[of]] for each in placed))
            which = np.arange(len(of)), part[of], none[of]
            found[of] = obstacle_distances(robot, here, poses, self.others[k : k + 1], which)[0]
        return found


def nearness(robot: Robot, q: Array, times: Array, scene: Scene) -> Nearness:
    """Measure all parts against all obstacles of a scene, but for allowed contacts.

    Args:
        q: Shape (times, 7 + joints).
        times: Shape (times,) [s].
        scene: In the frame of q.
    """
    spheres, others = scene.spheres, scene.obstacle_bodies
    centers = centers_at(times, spheres)
    at_origin = q.copy()
    at_origin[:, :7] = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    ends = arm_points(robot, at_origin)
    placed = placed_bodies(robot, q[:, 7:]) if robot.bodies else None
    starts = segments(ends)
    base = rotation_base_to_inertial(q)
    seen = np.einsum("tji,tsj->tsi", base, centers - q[:, None, :3])
    shape = (len(q), len(robot.bodies) or len(starts), len(spheres))
    rows = np.nonzero(np.ones(shape, bool))
    radius = np.array([sphere.radius for sphere in spheres])
    distance, normal = measured(robot, placed, ends, starts, rows, seen[rows[0], rows[2]], radius)
    distance, normal = distance.reshape(shape), normal.reshape(*shape, 3)
    places = np.broadcast_to(centers[:, None], normal.shape)
    counts = kept_apart(robot, (*spheres, *others), scene, q, times).at(np.arange(len(q)))
    if others:
        around, radii = around_obstacles(others, times)
        found = _to_others(robot, q, times, others, counts[:, :, len(spheres) :])
        distance = np.concatenate([distance, found.distance], axis=2)
        places = np.concatenate([places, found.point], axis=2)
        normal = np.concatenate([normal, found.normal], axis=2)
        centers, radius = np.concatenate([centers, around], axis=1), np.append(radius, radii)
    every = np.nonzero(np.ones(distance.shape, bool))
    return Nearness(
        robot=robot,
        base_q=q,
        others=others,
        rotations=poses_at(times, others)[0],
        radius=radius,
        centers=centers,
        distance=np.where(counts, distance, np.inf),
        normal=np.einsum("rij,rj->ri", base[every[0]], normal[every]).reshape(normal.shape),
        places=places,
        placed=placed,
        ends=ends,
        starts=starts,
    )


def _to_others(
    robot: Robot,
    q: Array,
    times: Array,
    others: Sequence[Obstacle],
    counts: NDArray[np.bool_],
) -> Distances:
    """Return distances of parts from obstacles that are no spheres, each (times, parts, others).

    Large ones are lower bounds, by bounding spheres.

    Args:
        counts: What must not touch. Shape (times, parts, others).

    Returns:
        Points in inertial axes, normals seen from the base.
    """
    robot, base = with_bodies(robot), rotation_base_to_inertial(q)
    placed, poses = placed_bodies(robot, q[:, 7:]), seen_from_chaser(q, times, others)
    centers = centers_in_base(q, around_obstacles(others, times)[0])
    way = centers[:, None] - placed.centers[:, :, None]
    normal = way / np.maximum(np.linalg.norm(way, axis=-1), _SAME_POINT)[..., None]
    point = np.broadcast_to(centers[:, None], way.shape).copy()
    distance = obstacle_bounds(robot, placed, q, times, others)
    lowest = np.where(counts, distance, np.inf)
    nearest = np.unravel_index(lowest.argmin(), lowest.shape)
    met = obstacle_distances(robot, placed, poses, others, tuple(at.reshape(1) for at in nearest))
    rows = np.nonzero(lowest <= met.distance[0] + _NOT_MEASURED)
    distance[rows], point[rows], normal[rows] = obstacle_distances(
        robot, placed, poses, others, rows
    )
    to_inertial = np.einsum("tij,tpoj->tpoi", base, point)
    return Distances(distance, q[:, None, None, :3] + to_inertial, normal)


def measured(
    robot: Robot,
    placed: Placed | None,
    ends: Array,
    starts: Indices,
    rows: tuple[Indices, ...],
    centers: Array,
    radius: Array,
) -> tuple[Array, Array]:
    """Return distances [m] of parts from spheres, and the unit vectors to these, in base axes.

    Args:
        placed: Bodies at all times; None: lines count.
        ends: As in `Nearness`.
        starts: As in `Nearness`.
        rows: Times, parts and spheres, each of shape (rows,).
        centers: Of the spheres, base frame. Shape (rows, 3) [m].
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
