"""Detours around a body that a path runs into: around its outline across the relative motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.bodies import placed_bodies
from ff_planner_ros.planning.distance.body_distances import obstacle_bounds, obstacle_distances
from ff_planner_ros.planning.distance.surroundings import surroundings
from ff_planner_ros.planning.paths.path_family import Motion
from ff_planner_ros.planning.problem.obstacles import Obstacle
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.quaternion import rotation_from_quaternion

# How far beyond the surface of an obstacle a detour passes [m]: the arm's links follow the end
# effector only in part.
BESIDE = 0.1
# A thin plate may be crossed between samples: at a sample, this distance counts as a hit [m].
_NEAR = 0.03
# Directions across the relative motion among which the nearest outline is searched.
_DIRECTIONS = 16


class Hit(NamedTuple):
    """Where a path runs into an obstacle, and displacements of the end effector past it."""

    depth: float  # [m]
    half_step: int  # index of the sample, points and those half-way counted
    ways: tuple[Array, ...]  # displacements of the path there, inertial axes; each (3,) [m]


def around_body(
    robot: Robot, straight: Motion, duration: float, obstacles: Sequence[Obstacle]
) -> Hit | None:
    """Return the detours around the body that a path enters deepest; None: it enters none.

    Displacements across the relative motion: past the nearest outline, to both sides at right
    angles, and past the far outline.
    """
    if not obstacles:
        return None
    robot, q = with_bodies(robot), _with_half_way(straight)
    times = np.linspace(0.0, duration, len(q))
    placed, around = placed_bodies(robot, q[:, 7:]), surroundings(tuple(obstacles))
    rows = np.nonzero(obstacle_bounds(robot, placed, q, times, around) < _NEAR)
    there = around.seen_from_base(q, times, rows[0], rows[2])
    found = obstacle_distances(robot, placed, there, around, rows)
    if found.distance.min(initial=np.inf) >= _NEAR:
        return None
    deepest = int(found.distance.argmin())
    at, body, number = (int(each[deepest]) for each in rows)
    one, to_inertial = obstacles[number], rotation_from_quaternion(q[:, 3:7])
    here = q[at, :3] + to_inertial[at] @ found.point[deepest]
    before, after = max(at - 1, 0), min(at + 1, len(q) - 1)
    centers = q[:, :3] + np.einsum("cij,cj->ci", to_inertial, placed.centers[:, body])
    turned, origins = one.motion.poses(times[[before, at, after]])
    held = turned[1].T @ (here - origins[1])  # of the obstacle, where it is hit
    seen = centers[after] - centers[before] - (turned[2] @ held + origins[2])
    seen += turned[0] @ held + origins[0]
    across = np.linalg.svd(seen[None])[2][1:]
    angles = 2.0 * np.pi / _DIRECTIONS * np.arange(_DIRECTIONS)
    sides = np.column_stack([np.cos(angles), np.sin(angles)]) @ across
    reaches = one.solid.furthest(sides @ turned[1]) - sides @ turned[1] @ held + BESIDE
    quarter = _DIRECTIONS // 4
    chosen = (int(reaches.argmin()) + quarter * np.array([0, 1, 3, 2])) % _DIRECTIONS
    ways = tuple(reaches[k] * sides[k] for k in chosen.tolist())
    return Hit(-float(found.distance[deepest]), at, ways)


def _with_half_way(motion: Motion) -> Array:
    """Return a motion's configurations at the points and half-way between, in order of time."""
    q = np.empty((len(motion.q) + len(motion.q_half_way), motion.q.shape[1]))
    q[::2], q[1::2] = motion.q, motion.q_half_way
    return q
