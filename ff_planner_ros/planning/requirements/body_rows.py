"""Constraint rows for the distances of bodies from each other and from spheres.

Distances are evaluated at all points but the start and half-way between points; with fewer points
than `FEW_POINTS` also at a quarter and three quarters of every interval but the first.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array, frozen
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import bodies_of, chain_of, spheres_of
from ff_planner_ros.planning.distance.allowed_contact import (
    Split,
    after_contact,
    before_contact,
    contacts_in_core,
    split_pairs,
    split_spheres,
)
from ff_planner_ros.planning.distance.start_room import (
    margins_in_core,
    margins_of_rows,
    room_of_bodies,
    room_of_pairs,
)
from ff_planner_ros.planning.paths.path_family import Motion, Sensitivity
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.requirements.requirement import Rows
from ff_planner_ros.robot.collision.lines import with_bodies

# On fewer points than this a body may jump over a corner of another: see `looked_at`.
FEW_POINTS = 40
# Bodies that are further from each other or from a sphere than this [m] do not meet in one step of
# the solver that the linearisation still describes.
OF_INTEREST = 0.1
# The search lets allowed pairs touch within this fraction of the contact distance: the check finds
# where the end effector enters it between the points, too.
_WITHIN = 0.9


class LookedAt(NamedTuple):
    """The configurations of a path at which distances of bodies are evaluated, in order of time."""

    bodies: compiled.BodiesAlong
    times: Array  # shape (configurations,) [s]
    times_by_last: Array  # by the last variable, the duration; empty if that is given
    until: int  # the first configuration at which pairs that are allowed to touch may do so


def pair_rows(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows:
    """Return rows for pairs of bodies nearer than `OF_INTEREST`: distance less margin [m]."""
    robot, at = problem.robot, looked_at(problem, motion, sensitivity)
    near, split = Rows(*compiled.pair_rows(at.bodies, OF_INTEREST)), split_pairs(problem)
    distances, jacobian, names = without_allowed(problem, at, near, len(robot.pairs), split)
    margins = margins_of_pairs(problem, margin)
    return Rows(distances - margins[names % len(robot.pairs)], jacobian, names)


def margins_of_pairs(problem: PlanningProblem, margin: float) -> Array:
    """Return the margin that each pair of bodies must keep. Shape (pairs,) [m]."""
    # Some pairs are built closer together than the margin: they keep half their start distance.
    margins = np.minimum(margin, room_of_pairs(problem))
    for _, touching in split_pairs(problem).at_start:
        margins[touching] = margin
    return margins


def sphere_rows(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows:
    """Return rows for bodies nearer to spheres than `OF_INTEREST`: distance less margin [m]."""
    robot, at = problem.robot, looked_at(problem, motion, sensitivity)
    near = compiled.sphere_rows(
        at.bodies,
        at.times,
        spheres=spheres_of(problem.spheres, float(at.times[-1])),
        interest=OF_INTEREST,
        times_by_last=at.times_by_last,
    )
    count, split = len(robot.bodies) * len(problem.spheres), split_spheres(problem)
    distances, jacobian, names = without_allowed(problem, at, Rows(*near), count, split)
    margins = margins_of_rows(margin, room_of_bodies(problem), names, at.times)
    return Rows(distances - margins, jacobian, names)


def pairs_in_core(problem: PlanningProblem, points: int, margin: float) -> compiled.PathRequirement:
    """Return what makes `pair_rows` in the core."""
    times = np.sort(times_looked_at(problem.duration, points))
    return compiled.pairs_apart(
        bodies_of(problem.robot),
        margins_of_pairs(problem, margin),
        OF_INTEREST,
        points < FEW_POINTS,
        contacts_in_core(problem, split_pairs(problem), times, _WITHIN),
    )


def asked_of_core(
    problem: PlanningProblem, points: int, margin: float, room: Array, split: Split
) -> tuple[compiled.Margins, Array, float, bool, compiled.AllowedContacts | None]:
    """Return how the core is asked for distances of bodies from what is not the robot.

    Margins, times of the configurations, interest, whether those include quarters, and the contacts
    that are allowed.
    """
    times = np.sort(times_looked_at(problem.duration, points))
    allowed = contacts_in_core(problem, split, times, _WITHIN)
    return margins_in_core(margin, room), times, OF_INTEREST, points < FEW_POINTS, allowed


def without_allowed(
    problem: PlanningProblem, at: LookedAt, found: Rows, count: int, split: Split
) -> Rows:
    """Leave out pairs that are allowed to touch, near the goal and near the start.

    Args:
        found: Rows whose names are configuration times `count` plus pair.
        count: Number of pairs: of bodies, or of body and obstacle.
        split: The pairs by whether they may touch.
    """
    if not problem.allowed_collisions:
        return found
    is_apart = np.zeros(count, np.bool_)
    is_apart[split.apart] = True
    configurations, numbers = np.divmod(found.names, count)
    kept = is_apart[numbers] | (configurations < at.until)
    for obstacle, touching in split.at_start:
        first = after_contact(problem, obstacle, at.times, at.bodies.q, _WITHIN)
        kept &= (configurations >= first) | ~np.isin(numbers, touching)
    return Rows(found.values[kept], found.jacobian[kept], found.names[kept])


@lru_cache(maxsize=2)
def looked_at(problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity) -> LookedAt:
    """Return where distances of bodies are evaluated; cached, as all kinds of rows need it.

    A robot without bodies has its centre lines.
    """
    robot, points = with_bodies(problem.robot), len(motion.q)
    bodies = compiled.BodiesAlong(
        chain_of(robot),
        bodies_of(robot),
        motion.q[1:],
        sensitivity.q[1:],
        motion.q_half_way,
        sensitivity.q_half_way,
        quarter_way=points < FEW_POINTS,
    )
    times = np.sort(times_looked_at(problem.duration, points))
    by_last = sensitivity.times_by_last(times, problem.duration)
    until = len(times)
    if problem.allowed_collisions:
        until = before_contact(problem, times, bodies.tips, _WITHIN) + 1
    return LookedAt(bodies, times, by_last, until)


@lru_cache(maxsize=32)
def times_looked_at(duration: float, points: int) -> Array:
    """Return the times of all points but the first, then half-way, then of quarters, if any [s]."""
    times = np.linspace(0.0, duration, points)
    half_way = (times[:-1] + times[1:]) / 2
    found = [times[1:], half_way]
    if points < FEW_POINTS:
        begin, middle, end = times[1:-1], half_way[1:], times[2:]
        found += [_quarter_way(begin, middle, end), _quarter_way(end, middle, begin)]
    return frozen(np.concatenate(found))


def _quarter_way(begin: Array, middle: Array, end: Array) -> Array:
    """Return values at quarters of intervals as the core does it, by parabolas."""
    return (3.0 * begin + 6.0 * middle - end) / 8.0
