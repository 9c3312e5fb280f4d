"""Distances of bodies from obstacles as tests ask for them: from lists, and from bare centres."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.distance.bodies import Placed, radii
from ff_planner_ros.planning.distance.body_certificate import CHECK_GAP, least_obstacle_distance
from ff_planner_ros.planning.distance.body_distances import obstacle_bounds, obstacle_distances
from ff_planner_ros.planning.distance.solids_apart import Distances
from ff_planner_ros.planning.distance.surroundings import Poses, Surroundings
from ff_planner_ros.planning.motion.certified_least import Least
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.problem.obstacles import Obstacle
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.model import Robot


def distances_from(
    robot: Robot,
    placed: Placed,
    q: Array,
    times: Array,
    obstacles: Sequence[Obstacle],
    rows: tuple[Indices, ...],
) -> Distances:
    """Return `obstacle_distances`; rows: configurations, bodies and obstacles."""
    around = Surroundings(tuple(obstacles))
    there = around.seen_from_base(q, times, rows[0], rows[2])
    return obstacle_distances(robot, placed, there, around, rows)


def bounds_from(
    robot: Robot, placed: Placed, q: Array, times: Array, obstacles: Sequence[Obstacle]
) -> Array:
    """Return `obstacle_bounds`. Shape (configurations, bodies, obstacles) [m]."""
    return obstacle_bounds(robot, placed, q, times, Surroundings(tuple(obstacles)))


def sphere_distances(
    robot: Robot, placed: Placed, centers: Array, radius: Array, rows: tuple[Indices, ...]
) -> Distances:
    """Return distances from spheres whose centres are told in the base frame.

    Args:
        centers: Shape (configurations, spheres, 3) [m].
        radius: Shape (spheres,) [m].
        rows: Configurations, bodies and spheres.
    """
    around = Surroundings(tuple(Obstacle.sphere("", np.zeros(3), size) for size in radius.tolist()))
    there = Poses(np.tile(np.eye(3), (len(rows[0]), 1, 1)), centers[rows[0], rows[2]])
    return obstacle_distances(robot, placed, there, around, rows)


def sphere_bounds(robot: Robot, placed: Placed, centers: Array, radius: Array) -> Array:
    """Return bounds of distances from such spheres. Shape (configurations, bodies, spheres)."""
    apart = np.linalg.norm(placed.centers[:, :, None] - centers[:, None], axis=-1)
    return np.asarray(apart - radii(robot)[:, None] - radius)


def least_distance(
    robot: Robot,
    motion: FollowedMotion,
    obstacles: Sequence[Obstacle],
    chosen: Indices,
    last: int,
    gap: float = CHECK_GAP,
) -> Least:
    """Return `least_obstacle_distance`."""
    around = Surroundings(tuple(obstacles))
    return least_obstacle_distance(robot, motion, around, chosen, last, gap)


def certified_clearance(
    robot: Robot, q: Array, v: Array, times: Array, obstacles: Sequence[Obstacle]
) -> float:
    """Return what is certified of bodies, or lines, along the cubics between configurations."""
    still = np.zeros((len(times), robot.joints))
    joints = JointMotion(times, q[:, 7:], v[:, 6:], still)
    motion, robot = FollowedMotion(joints, 1, times, q, v, still), with_bodies(robot)
    every = np.arange(len(robot.bodies) * len(obstacles))
    return least_distance(robot, motion, obstacles, every, len(times) - 1).certified
