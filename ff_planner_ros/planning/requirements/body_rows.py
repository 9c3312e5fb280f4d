"""What the core is asked for: distances of bodies from each other and from what is in the way.

Distances are evaluated at all points but the start and half-way between points; with fewer points
than `FEW_POINTS` also at a quarter and three quarters of every interval but the first.
"""

from __future__ import annotations

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import bodies_of, obstacles_of
from ff_planner_ros.planning.distance.allowed_contact import (
    contacts_in_core,
    split_obstacles,
    split_pairs,
)
from ff_planner_ros.planning.distance.start_room import room_of_obstacles, room_of_pairs
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.collision.lines import with_bodies

# On fewer points than this a body may jump over a corner of another.
FEW_POINTS = 40
# Bodies that are further from each other or from a sphere than this [m] do not meet in one step of
# the solver that the linearisation still describes.
OF_INTEREST = 0.1
# The search lets allowed pairs touch within this fraction of the contact distance: the check finds
# where the end effector enters it between the points, too.
_WITHIN = 0.9


def margins_of_pairs(problem: PlanningProblem, margin: float) -> Array:
    """Return the margin that each pair of bodies must keep. Shape (pairs,) [m]."""
    # Some pairs are built closer together than the margin: they keep half their start distance.
    margins = np.minimum(margin, room_of_pairs(problem))
    for _, touching in split_pairs(problem).at_start:
        margins[touching] = margin
    return margins


def pairs_in_core(problem: PlanningProblem, points: int, margin: float) -> compiled.PathRequirement:
    """Return what makes the rows of pairs of bodies."""
    times = times_looked_at(problem.duration, points)
    return compiled.pairs_apart(
        bodies_of(problem.robot),
        margins_of_pairs(problem, margin),
        OF_INTEREST,
        points < FEW_POINTS,
        contacts_in_core(problem, split_pairs(problem), times, _WITHIN),
    )


def obstacles_in_core(
    problem: PlanningProblem, points: int, margin: float
) -> compiled.PathRequirement:
    """Return what makes the rows of bodies, or centre lines, and obstacles."""
    times = times_looked_at(problem.duration, points)
    return compiled.bodies_clear(
        bodies_of(with_bodies(problem.robot)),
        obstacles_of(problem.obstacles, problem.duration),
        margin,
        room_of_obstacles(problem).ravel(),
        times,
        OF_INTEREST,
        points < FEW_POINTS,
        contacts_in_core(problem, split_obstacles(problem), times, _WITHIN),
    )


def times_looked_at(duration: float, points: int) -> Array:
    """Return the times at which distances are evaluated, ascending [s]."""
    times = np.linspace(0.0, duration, points)
    half_way = (times[:-1] + times[1:]) / 2
    found = [times[1:], half_way]
    if points < FEW_POINTS:
        begin, middle, end = times[1:-1], half_way[1:], times[2:]
        found += [_quarter_way(begin, middle, end), _quarter_way(end, middle, begin)]
    return np.sort(np.concatenate(found))


def _quarter_way(begin: Array, middle: Array, end: Array) -> Array:
    """Return values at quarters of intervals as the core does it, by parabolas."""
    return (3.0 * begin + 6.0 * middle - end) / 8.0
