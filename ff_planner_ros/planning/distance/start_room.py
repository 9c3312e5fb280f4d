"""The clearances that a motion must keep near its start: parts of those that the start has."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ff_planner_ros.common.arrays import Array, frozen
from ff_planner_ros.planning.distance.bodies import placed_bodies
from ff_planner_ros.planning.distance.body_distances import (
    obstacle_bounds,
    obstacle_distances,
    pair_distances,
)
from ff_planner_ros.planning.distance.surroundings import surroundings
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


def room_of_pairs(problem: PlanningProblem) -> Array:
    """Return half the start distance of each pair. Shape (pairs,) [m]."""
    return _room_of_pairs(problem.robot, problem.start)


def room_of_obstacles(problem: PlanningProblem) -> Array:
    """Return half the start distances of bodies from obstacles. Shape (bodies, obstacles) [m]."""
    return _room_of_obstacles(problem.robot, problem.start, problem.obstacles)


# Problems that differ in something else, as those of other durations do, have the same.


@lru_cache(maxsize=4)
def _room_of_pairs(robot: Robot, start: SystemState) -> Array:
    q, _ = configuration(robot, start)
    rows = np.zeros(len(robot.pairs), np.intp), np.arange(len(robot.pairs))
    return _room(pair_distances(robot, placed_bodies(robot, q[None, 7:]), rows).distance)


@lru_cache(maxsize=4)
def _room_of_obstacles(robot: Robot, start: SystemState, obstacles: tuple[Obstacle, ...]) -> Array:
    (q, _), now = configuration(robot, start), np.zeros(1)
    robot, around = with_bodies(robot), surroundings(obstacles)
    placed = placed_bodies(robot, q[None, 7:])
    distances = obstacle_bounds(robot, placed, q[None], now, around)[0]
    bodies, numbers = np.nonzero(distances < _FAR)
    rows = np.zeros(len(bodies), np.intp), bodies, numbers
    there = around.seen_from_base(q[None], now, rows[0], numbers)
    found = obstacle_distances(robot, placed, there, around, rows)
    distances[bodies, numbers] = found.distance
    return _room(distances)


def _room(distances: Array) -> Array:
    """Return what a motion keeps of distances at the start [m]."""
    return frozen(np.maximum(distances, 0.0) * KEPT)
