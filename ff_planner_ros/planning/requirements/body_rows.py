"""Constraint rows for the distances of bodies from each other and from spheres.

Distances are evaluated at all points but the start and half-way between points; with fewer points
than `FEW_POINTS` also at a quarter and three quarters of every interval but the first.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ff_planner_ros.common.arrays import Array, Indices
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

    times: Array  # shape (configurations,) [s]
    times_by_last: Array  # by the last variable, the duration; empty if that is given
    q: Array  # shape (configurations, 7 + joints)
    sensitivity: Array  # of q in its tangent space; shape (configurations, 6 + joints, variables)
    until: int  # the first configuration at which pairs that are allowed to touch may do so


def pair_rows(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows:
    """Return rows for pairs of bodies nearer than `OF_INTEREST`: distance less margin [m]."""
    robot, at = problem.robot, looked_at(problem, motion, sensitivity)
    distances, jacobian, names, deep = compiled.pair_rows(
        chain_of(robot), bodies_of(robot), at.q, at.sensitivity, OF_INTEREST
    )
    shape, split = (len(at.q), len(robot.pairs)), split_pairs(problem)
    near = Rows(distances, jacobian, names)
    distances, jacobian, names, deep = without_allowed(problem, at, near, deep, shape[1], split)
    if deep.size:  # Coal knows how deep they are in each other
        rows = np.unravel_index(deep, shape)
        placed = placed_bodies(robot, at.q[:, 7:])
        found = pair_distances(robot, placed, rows)
        gradients = pair_gradients(robot, placed, found, rows)
        deeper = along_variables(gradients, at.sensitivity[:, 6:], rows[0])
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
        chain_of(robot),
        bodies_of(robot),
        at.q,
        at.sensitivity,
        at.times,
        spheres=spheres_of(problem.spheres, float(at.times[-1])),
        interest=OF_INTEREST,
        times_by_last=at.times_by_last,
    )
    shape = len(at.q), len(robot.bodies), len(problem.spheres)
    near, of_pairs = Rows(distances, jacobian, names), (shape[1] * shape[2], split_spheres(problem))
    distances, jacobian, names, deep = without_allowed(problem, at, near, deep, *of_pairs)
    if deep.size:
        rows = np.unravel_index(deep, shape)
        placed = placed_bodies(robot, at.q[:, 7:])
        seen = centers_in_base(at.q, centers_at(at.times, problem.spheres))
        _, _, radius = sphere_arrays(problem.spheres)
        found = sphere_distances(robot, placed, seen, radius, rows)
        gradients = sphere_gradients(robot, placed, found, rows)
        distances, names = np.append(distances, found.distance), np.append(names, deep)
        deeper = along_variables(gradients, at.sensitivity, rows[0])
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

    def counts(names: Indices) -> NDArray[np.bool_]:
        configurations, numbers = np.divmod(names, count)
        kept = np.isin(numbers, split.apart) | (configurations < at.until)
        for obstacle, touching in split.at_start:
            first = after_contact(problem, obstacle, at.times, at.q, _WITHIN)
            kept &= (configurations >= first) | ~np.isin(numbers, touching)
        return kept

    kept = counts(found.names)
    return found.values[kept], found.jacobian[kept], found.names[kept], deep[counts(deep)]


@lru_cache(maxsize=2)
def looked_at(problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity) -> LookedAt:
    """Return where distances of bodies are evaluated; cached, as all kinds of rows need it."""
    at_points = np.linspace(0.0, problem.duration, len(motion.q))
    times = _in_order(at_points[1:], (at_points[:-1] + at_points[1:]) / 2)
    q = _in_order(motion.q[1:], motion.q_half_way)
    by_x = _in_order(sensitivity.q[1:], sensitivity.q_half_way)
    if len(motion.q) < FEW_POINTS:
        # Quaternions of one sign: what lies between two is between their entries.
        turns_over = np.sum(q[:-1, 3:7] * q[1:, 3:7], axis=1) < 0.0
        q[1:, 3:7] *= np.where(turns_over, -1.0, 1.0).cumprod()[:, None]
        order = np.argsort(np.concatenate([times, quarter_way(_out_of_order(times))]))
        q, by_x, times = (
            np.concatenate([at, quarter_way(_out_of_order(at))])[order] for at in (q, by_x, times)
        )
        q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1)[:, None]
    until = before_contact(problem, times, q, _WITHIN) + 1 if problem.allowed_collisions else len(q)
    times_by_last = sensitivity.times_by_last(times, problem.duration)
    return LookedAt(times, times_by_last, q, by_x, until)


def _in_order(at_points: Array, half_way: Array) -> Array:
    """Return values at all points but the first, each behind that half-way to it."""
    return np.stack([half_way, at_points], axis=1).reshape(-1, *at_points.shape[1:])


def _out_of_order(values: Array) -> Array:
    """Return values at points, then those half-way; see `_in_order`."""
    return np.concatenate([values[1::2], values[::2]])


def quarter_way(values: Array) -> Array:
    """Return values at a quarter, then at three quarters of all intervals but the first.

    They are on the parabola through both ends and the middle of an interval.

    Args:
        values: At all points but the first, then half-way in every interval.
    """
    at_points, half_way = np.split(values, 2)
    begin, middle, end = at_points[:-1], half_way[1:], at_points[1:]
    first = (3.0 * begin + 6.0 * middle - end) / 8.0
    return np.concatenate([first, (3.0 * end + 6.0 * middle - begin) / 8.0])


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
    in_base = np.einsum("rji,rj->ri", rotation_base_to_inertial(at.q[configurations]), velocities)
    growing: Array = -np.sum(gradients[:, :3] * in_base, axis=1)
    return growing


def along_variables(gradients: Array, sensitivity: Array, configurations: Indices) -> Array:
    """Return gradients by the tangent of q as those by x (chain rule). Shape (rows, variables)."""
    jacobian: Array = np.einsum("rj,rjx->rx", gradients, sensitivity[configurations])
    return jacobian
