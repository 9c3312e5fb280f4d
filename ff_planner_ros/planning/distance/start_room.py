"""The clearances that a motion must keep near its start: parts of those that the start has."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ff_planner_ros.common.arrays import Array, frozen
from ff_planner_ros.core.conversions import sphere_arrays
from ff_planner_ros.planning.distance.bodies import centers_in_base, placed_bodies
from ff_planner_ros.planning.distance.body_distances import pair_distances, sphere_distances
from ff_planner_ros.planning.distance.clearance import arm_points, clearances
from ff_planner_ros.planning.distance.obstacle_distances import (
    obstacle_bounds,
    obstacle_distances,
    seen_from_chaser,
)
from ff_planner_ros.planning.problem.problem import Obstacle, PlanningProblem
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState

# The clearance from every obstacle that a start needs [m], ten times the solver's tolerance; and
# that a plan needs at its last point, where another may start: planning frames round positions.
LEAST_CLEARANCE, CLEARANCE_AT_END = 1e-5, 1.2e-5
# Fraction of the distance at the start that a motion keeps.
KEPT = 0.5
# Distances that bounding spheres show to be larger are not measured: half of this [m] is the
# largest margin that a parameter allows.
_FAR = 2.0


def lines_from_spheres(problem: PlanningProblem) -> Array:
    """Return the distances of lines from spheres at the start. Shape (joints, spheres) [m].

    A line has the number of the joint that it starts at: one that has no length yet may slide out.
    """
    return _lines_from_spheres(problem.robot, problem.start, problem.spheres)


def room_of_lines(problem: PlanningProblem) -> Array:
    """Return half the start distances of lines from spheres. Shape (joints, spheres) [m]."""
    return _room(lines_from_spheres(problem))


def room_of_pairs(problem: PlanningProblem) -> Array:
    """Return half the start distance of each pair. Shape (pairs,) [m]."""
    return _room_of_pairs(problem.robot, problem.start)


def room_of_bodies(problem: PlanningProblem) -> Array:
    """Return half the start distances of bodies from spheres. Shape (bodies, spheres) [m]."""
    return _room_of_bodies(problem.robot, problem.start, problem.spheres)


def room_of_obstacles(problem: PlanningProblem) -> Array:
    """Return half the start distances of bodies from other obstacles. (bodies, obstacles) [m]."""
    return _room_of_obstacles(problem.robot, problem.start, problem.obstacle_bodies)


# Problems that differ in something else, as those of other durations do, have the same.


@lru_cache(maxsize=4)
def _lines_from_spheres(robot: Robot, start: SystemState, spheres: tuple[Obstacle, ...]) -> Array:
    q, _ = configuration(robot, start)
    every = np.arange(robot.joints)
    return frozen(clearances(arm_points(robot, q[None]), np.zeros(1), every, spheres).distance[0])


@lru_cache(maxsize=4)
def _room_of_pairs(robot: Robot, start: SystemState) -> Array:
    q, _ = configuration(robot, start)
    rows = np.zeros(len(robot.pairs), np.intp), np.arange(len(robot.pairs))
    return _room(pair_distances(robot, placed_bodies(robot, q[None, 7:]), rows).distance)


@lru_cache(maxsize=4)
def _room_of_bodies(robot: Robot, start: SystemState, obstacles: tuple[Obstacle, ...]) -> Array:
    q, _ = configuration(robot, start)
    centers, _, radius = sphere_arrays(obstacles)
    shape = len(robot.bodies), len(radius)
    bodies, spheres = (number.ravel() for number in np.indices(shape))
    rows = np.zeros(len(bodies), np.intp), bodies, spheres
    placed, seen = placed_bodies(robot, q[None, 7:]), centers_in_base(q[None], centers[None])
    return _room(sphere_distances(robot, placed, seen, radius, rows).distance).reshape(shape)


@lru_cache(maxsize=4)
def _room_of_obstacles(robot: Robot, start: SystemState, obstacles: tuple[Obstacle, ...]) -> Array:
    q, _ = configuration(robot, start)
    robot = with_bodies(robot)
    shape = len(robot.bodies), len(obstacles)
    if not shape[1]:
        return np.empty(shape)
    placed, now = placed_bodies(robot, q[None, 7:]), np.zeros(1)
    distances = obstacle_bounds(robot, placed, q[None], now, obstacles)[0]
    near = np.nonzero(distances < _FAR)
    rows = np.zeros(len(near[0]), np.intp), *near
    poses = seen_from_chaser(q[None], now, obstacles)
    distances[near] = obstacle_distances(robot, placed, poses, obstacles, rows).distance
    return _room(distances)


def _room(distances: Array) -> Array:
    """Return what a motion keeps of distances at the start [m]."""
    return frozen(np.maximum(distances, 0.0) * KEPT)
