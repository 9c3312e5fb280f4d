"""Obstacles as arrays: where they are, and bounds of how they move.

Of a sphere the centre alone counts: its axes are those of the inertial frame, whatever turns it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.distance.bodies import centers_in_base
from ff_planner_ros.planning.problem.obstacles import Obstacle
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.robot.quaternion import rotation_from_quaternion


class Poses(NamedTuple):
    """Poses of obstacles, one a row."""

    rotations: Array  # of their axes; shape (rows, 3, 3)
    positions: Array  # of their origins; shape (rows, 3) [m]


_ROUNDING = 1e-9  # [m]


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Obstacles, numbered from zero on; times count from the plan's first point on [s]."""

    obstacles: tuple[Obstacle, ...]

    @cached_property
    def are_spheres(self) -> NDArray[np.bool_]:
        """Which of them are. Shape (obstacles,)."""
        return np.array([one.is_sphere for one in self.obstacles], bool)

    @cached_property
    def radii(self) -> Array:
        """Radii of their bounding spheres. Shape (obstacles,) [m]."""
        return np.array([one.radius for one in self.obstacles])

    @cached_property
    def bounds(self) -> Array:
        """Highest speed, acceleration and rate of rotation, reach and size. (5, obstacles).

        Speeds and accelerations are those of all points [m/s, m/s2, rad/s, m, m]. Of a sphere the
        centre counts, which is the radius from the surface.
        """
        _, velocities = self._uniform
        found = np.zeros((5, len(self.obstacles)))
        found[0] = np.linalg.norm(velocities, axis=1)
        found[4] = np.where(self.are_spheres, 1.0, 2.0) * self.radii
        for number in np.flatnonzero(~self.are_spheres).tolist():
            found[2:4, number] = (
                self.obstacles[number].motion.highest_rate,
                self.obstacles[number].reach,
            )
        for number in self._turning:
            one = self.obstacles[number]
            found[:2, number] = one.highest_speed, one.motion.highest_acceleration(one.reach)
        return found

    def centers(self, times: Array) -> Array:
        """Return the centres of their bounding spheres. Shape (times, obstacles, 3) [m]."""
        begins, velocities = self._uniform
        centers: Array = begins + times[:, None, None] * velocities
        for body, held, places in self._on_bodies:
            centers[:, held] = body.places(places, times)
        for number in self._turning:
            if self.obstacles[number].motion.body is not None:
                continue
            rotations, positions = self.obstacles[number].motion.poses(times)
            centers[:, number] = positions + rotations @ self.obstacles[number].solid.center
        return centers

    def near(self, center: Array, radius: float, time: float) -> list[int]:
        """Return the numbers of those whose bounding spheres reach into a sphere at a time.

        Args:
            center: Of the sphere, in the inertial frame. Shape (3,) [m].
            radius: Of the sphere [m].
        """
        away = np.linalg.norm(self.centers(np.array([time]))[0] - center, axis=1)
        # What is measured may be nearer than its bounding sphere, by rounding.
        return np.flatnonzero(away - self.radii - radius <= _ROUNDING).tolist()

    def seen_from_base(self, q: Array, times: Array, rows: Indices, obstacles: Indices) -> Poses:
        """Return the pose of one obstacle at one time in each row, in the base frame.

        Args:
            q: Configurations at the times. Shape (times, 7 + joints).
            times: Shape (times,).
            rows: Number of the time of each row. Shape (rows,).
            obstacles: Number of the obstacle of each row. Shape (rows,).
        """
        few, column = np.unique(obstacles, return_inverse=True)
        turns = rotation_from_quaternion(q[:, 3:7])
        seen = np.repeat(turns.transpose(0, 2, 1)[:, None], len(few), axis=1)
        positions = self.centers(times)[:, few]  # and of others than spheres:
        for k in np.flatnonzero(~self.are_spheres[few]).tolist():
            rotations, positions[:, k] = obstacle_poses(self.obstacles[few[k]], times)
            seen[:, k] = np.einsum("cji,cjk->cik", turns, rotations)
        return Poses(seen[rows, column], centers_in_base(q, positions)[rows, column])

    @cached_property
    def _uniform(self) -> tuple[Array, Array]:
        """Centres at time zero, and their velocities. Each of shape (obstacles, 3)."""
        motions = [one.motion for one in self.obstacles]
        centers = np.reshape([motion.position for motion in motions], (-1, 3))
        for number in np.flatnonzero(~self.are_spheres).tolist():
            centers[number] += motions[number].rotation @ self.obstacles[number].solid.center
        return centers, np.reshape([motion.velocity for motion in motions], (-1, 3))

    @cached_property
    def _on_bodies(self) -> list[tuple[TargetBody, list[int], Array]]:
        """Target bodies, the obstacles that are fixed to each, and their centres in its frame."""
        held: dict[int, tuple[TargetBody, list[int], list[Array]]] = {}
        for number, one in enumerate(self.obstacles):
            body, place = one.motion.body, one.motion.place_in_body
            if body is not None and place is not None:
                _, numbers, places = held.setdefault(id(body), (body, [], []))
                numbers.append(number)
                places.append(place.act(one.solid.center))
        return [(body, numbers, np.array(places)) for body, numbers, places in held.values()]

    @cached_property
    def _turning(self) -> list[int]:
        """Those that turn, but for spheres that turn about their centres."""
        return [
            number
            for number, one in enumerate(self.obstacles)
            if one.motion.body is not None or (one.motion.turns and not one.is_sphere)
        ]


@lru_cache(maxsize=8)
def surroundings(obstacles: tuple[Obstacle, ...]) -> Surroundings:
    """Return obstacles as arrays, which are computed once."""
    return Surroundings(obstacles)


def obstacle_poses(one: Obstacle, times: Array) -> tuple[Array, Array]:
    """Return an obstacle's axes to inertial axes, (times, 3, 3), and origin, (times, 3) [m].

    Args:
        times: From the plan's first point on. Shape (times,) [s].
    """
    rotations, positions = one.motion.poses(times)
    if one.is_sphere:
        rotations = np.broadcast_to(np.eye(3), (len(times), 3, 3))
    return rotations, positions


def obstacle_place(one: Obstacle, time: float) -> pin.SE3:
    """Return an obstacle's pose in the inertial frame at a time from the plan's first point [s]."""
    (rotation,), (origin,) = obstacle_poses(one, np.array([time]))
    return pin.SE3(rotation, origin)
