"""Constraint rows for the distances of bodies from each other and from spheres.

Distances are evaluated at all points but the start and half-way between points; with fewer points
than `FEW_POINTS` also at a quarter and three quarters of every interval but the first.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ff_planner_ros.common.arrays import Array, Indices, frozen
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import bodies_of, chain_of, sphere_arrays, spheres_of
from ff_planner_ros.planning.distance.allowed_contact import (
    Split,
    after_contact,
    before_contact,
    split_pairs,
    split_spheres,
)
from ff_planner_ros.planning.distance.bodies import centers_in_base, placed_bodies
from ff_planner_ros.planning.distance.body_distances import (
    pair_distances,
    pair_gradients,
    sphere_distances,
    sphere_gradients,
)
from ff_planner_ros.planning.distance.clearance import centers_at, velocities_at
from ff_planner_ros.planning.distance.start_room import (
    margins_of_rows,
    room_of_bodies,
    room_of_pairs,
)
from ff_planner_ros.planning.paths.path_family import Motion, Sensitivity
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.requirements.requirement import Rows
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.kinematics import rotation_base_to_inertial

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
    distances, jacobian, names, deep = compiled.pair_rows(at.bodies, OF_INTEREST)
    shape, split = (len(at.times), len(robot.pairs)), split_pairs(problem)
    near = Rows(distances, jacobian, names)
    distances, jacobian, names, deep = without_allowed(problem, at, near, deep, shape[1], split)
    if deep.size:  # Coal knows how deep they are in each other
        rows = np.unravel_index(deep, shape)
        placed = placed_bodies(robot, at.bodies.q[:, 7:])
        found = pair_distances(robot, placed, rows)
        gradients = pair_gradients(robot, placed, found, rows)
        deeper = along_variables(gradients, at.bodies.derivatives(rows[0])[:, 6:])
        distances, names = np.append(distances, found.distance), np.append(names, deep)
        jacobian = np.vstack([jacobian, deeper])
    # Some pairs are built closer together than the margin: they keep half their start distance.
    margins = np.minimum(margin, room_of_pairs(problem))
    for _, touching in split.at_start:
        margins[touching] = margin
    return Rows(distances - margins[names % shape[1]], jacobian, names)


def sphere_rows(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows:
    """Return rows for bodies nearer to spheres than `OF_INTEREST`: distance less margin [m]."""
    robot, at = problem.robot, looked_at(problem, motion, sensitivity)
    distances, jacobian, names, deep = compiled.sphere_rows(
        at.bodies,
        at.times,
        spheres=spheres_of(problem.spheres, float(at.times[-1])),
        interest=OF_INTEREST,
        times_by_last=at.times_by_last,
    )
    shape = len(at.times), len(robot.bodies), len(problem.spheres)
    near, of_pairs = Rows(distances, jacobian, names), (shape[1] * shape[2], split_spheres(problem))
    distances, jacobian, names, deep = without_allowed(problem, at, near, deep, *of_pairs)
    if deep.size:
        rows = np.unravel_index(deep, shape)
        q = at.bodies.q
        placed = placed_bodies(robot, q[:, 7:])
        seen = centers_in_base(q, centers_at(at.times, problem.spheres))
        _, _, radius = sphere_arrays(problem.spheres)
        found = sphere_distances(robot, placed, seen, radius, rows)
        gradients = sphere_gradients(robot, placed, found, rows)
        distances, names = np.append(distances, found.distance), np.append(names, deep)
        deeper = along_variables(gradients, at.bodies.derivatives(rows[0]))
        if at.times_by_last.size:
            deeper[:, -1] += at.times_by_last[rows[0]] * _of_moving(
                problem, gradients, at, rows[0], rows[2]
            )
        jacobian = np.vstack([jacobian, deeper])
    margins = margins_of_rows(margin, room_of_bodies(problem), names, at.times)
    return Rows(distances - margins, jacobian, names)


def without_allowed(
    problem: PlanningProblem, at: LookedAt, found: Rows, deep: Indices, count: int, split: Split
) -> tuple[Array, Array, Indices, Indices]:
    """Leave out pairs that are allowed to touch, near the goal and near the start.

    Args:
        found: Rows whose names are configuration times `count` plus pair.
        deep: Names of the pairs that are in each other.
        count: Number of pairs: of bodies, or of body and obstacle.
        split: The pairs by whether they may touch.

    Returns:
        Values, Jacobian and names of the rows that are left, and names of the deep pairs.
    """
    if not problem.allowed_collisions:
        return *found, deep
    is_apart = np.zeros(count, np.bool_)
    is_apart[split.apart] = True

    def counts(names: Indices) -> NDArray[np.bool_]:
        configurations, numbers = np.divmod(names, count)
        kept = is_apart[numbers] | (configurations < at.until)
        for obstacle, touching in split.at_start:
            first = after_contact(problem, obstacle, at.times, at.bodies.q, _WITHIN)
            kept &= (configurations >= first) | ~np.isin(numbers, touching)
        return kept

    kept = counts(found.names)
    return found.values[kept], found.jacobian[kept], found.names[kept], deep[counts(deep)]


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


def _of_moving(
    problem: PlanningProblem,
    gradients: Array,
    at: LookedAt,
    configurations: Indices,
    spheres: Indices,
) -> Array:
    """Return the rates of distances because of the spheres' motion. Shape (rows,) [m/s].

    A sphere's motion changes a distance as the opposite motion of the base does.
    """
    velocities = velocities_at(at.times, problem.spheres)[configurations, spheres]
    turns = rotation_base_to_inertial(at.bodies.q[configurations])
    in_base = np.einsum("rji,rj->ri", turns, velocities)
    growing: Array = -np.sum(gradients[:, :3] * in_base, axis=1)
    return growing


def along_variables(gradients: Array, sensitivity: Array) -> Array:
    """Return gradients by the tangent of q as those by x (chain rule). Shape (rows, variables)."""
    jacobian: Array = np.einsum("rj,rjx->rx", gradients, sensitivity)
    return jacobian
