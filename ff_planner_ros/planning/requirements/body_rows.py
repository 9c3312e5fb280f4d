"""What the solver keeps of the distances of bodies: rows with exact derivatives.

Both pairs of bodies and bodies with spheres are looked at where the arm's lines are: at the points
but the start, half-way between, and on few points a quarter of the way, too.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.arrays import Array, Indices
from ff_planner_ros.planning.allowed_contact import before_contact, split_pairs, split_spheres
from ff_planner_ros.planning.bodies import (
    Distances,
    Placed,
    near_pairs,
    near_spheres,
    pair_distances,
    pair_gradients,
    placed_bodies,
    radii,
    sphere_distances,
    sphere_gradients,
)
from ff_planner_ros.planning.body_certificate import centers_in_base
from ff_planner_ros.planning.clearance import centers_at
from ff_planner_ros.planning.path_family import Motion, Sensitivity
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.requirements.requirement import Rows

# On fewer points than this a body may jump over a corner of another: see `_LookedAt`.
FEW_POINTS = 40
# Bodies that are further from each other or from a sphere than this [m] do not meet in one step of
# the solver that the linearisation still describes.
OF_INTEREST = 0.1
# Of the contact distance, the part in which the search lets allowed pairs touch: between the points
# the check measures it anew.
_WITHIN = 0.9


class _LookedAt(NamedTuple):
    """The configurations of a path at which its bodies are looked at, in the order of time."""

    times: Array  # shape (configurations,) [s]
    q: Array  # shape (configurations, 7 + joints)
    sensitivity: Array  # of q in its tangent space; shape (configurations, 6 + joints, variables)
    placed: Placed
    until: int  # the first configuration at which pairs that are allowed to touch may do so


def pair_rows(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows:
    """Return the distances of pairs of bodies that are of interest, less the margin."""
    robot, at = problem.robot, _looked_at(problem, motion, sensitivity)
    configurations, pairs = near_pairs(robot, at.placed, at.q[:, 7:], OF_INTEREST)
    rows: tuple[Indices, ...] = configurations, pairs
    if problem.allowed_at_goal:
        must = (configurations < at.until) | np.isin(pairs, split_pairs(problem)[0])
        rows = configurations[must], pairs[must]
    found, rows = of_interest(pair_distances(robot, at.placed, rows), rows)
    gradients = pair_gradients(robot, at.placed, found, rows)
    jacobian = _along(gradients, at.sensitivity[:, 6:], rows[0])
    names = np.ravel_multi_index(rows, (len(at.q), len(robot.pairs)))
    return Rows(found.distance - margin, jacobian, names)


def sphere_rows(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows:
    """Return the distances of bodies from spheres that are of interest, less the margin."""
    robot, at = problem.robot, _looked_at(problem, motion, sensitivity)
    kept = _in_reach(problem, at)
    spheres = [problem.obstacles[number] for number in kept.tolist()]
    centers = centers_in_base(at.q, centers_at(at.times, spheres))
    radius = np.array([sphere.radius for sphere in spheres])
    configurations, bodies, near = near_spheres(robot, at.placed, centers, radius, OF_INTEREST)
    rows: tuple[Indices, ...] = configurations, bodies, near
    if problem.allowed_at_goal:
        pairs = bodies * len(problem.obstacles) + kept[near]
        must = (configurations < at.until) | np.isin(pairs, split_spheres(problem)[0])
        rows = configurations[must], bodies[must], near[must]
    found, rows = of_interest(sphere_distances(robot, at.placed, centers, radius, rows), rows)
    gradients = sphere_gradients(robot, at.placed, found, rows)
    jacobian = _along(gradients, at.sensitivity, rows[0])
    shape = len(at.q), len(robot.bodies), len(problem.obstacles)
    names = np.ravel_multi_index((*rows[:2], kept[rows[2]]), shape)
    return Rows(found.distance - margin, jacobian, names)


def _in_reach(problem: PlanningProblem, at: _LookedAt) -> Indices:
    """Return the numbers of the spheres that come near the box around the way of any body."""
    to_inertial = Rotation.from_quat(at.q[:, 3:7]).as_matrix().transpose(0, 2, 1)
    centers = at.placed.centers @ to_inertial + at.q[:, None, :3]
    low, high = centers.min(axis=0), centers.max(axis=0)
    begin, velocity, radius = _spheres(problem)
    ends = begin + at.times[[0, -1], None, None] * velocity
    first, last = ends.min(axis=0), ends.max(axis=0)
    beyond = np.maximum(first - high[:, None], low[:, None] - last)
    to_box = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    around = radii(problem.robot)[:, None] + radius + OF_INTEREST
    return np.flatnonzero((to_box < around).any(axis=0))


@lru_cache(maxsize=4)
def _spheres(problem: PlanningProblem) -> tuple[Array, Array, Array]:
    """Return centres at the first point, velocities and radii of the spheres."""
    spheres = problem.obstacles
    return (
        np.array([sphere.center for sphere in spheres]),
        np.array([sphere.velocity for sphere in spheres]),
        np.array([sphere.radius for sphere in spheres]),
    )


def of_interest(
    found: Distances, rows: tuple[Indices, ...]
) -> tuple[Distances, tuple[Indices, ...]]:
    """Return those of measured distances that the solver wants to know of, and their rows."""
    near = found.distance < OF_INTEREST
    return Distances(*(part[near] for part in found)), tuple(row[near] for row in rows)


@lru_cache(maxsize=2)
def _looked_at(problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity) -> _LookedAt:
    """Return where bodies are looked at: once for both kinds of rows."""
    times = np.linspace(0.0, problem.duration, len(motion.q))
    times = np.concatenate([times[1:], (times[:-1] + times[1:]) / 2])
    q = np.concatenate([motion.q[1:], motion.q_half_way])
    by_x = np.concatenate([sensitivity.q[1:], sensitivity.q_half_way])
    if len(motion.q) < FEW_POINTS:
        # Quaternions of one sign: what lies between two is between their entries.
        order = np.argsort(times)
        along = q[order, 3:7]
        turns_over = np.sum(along[:-1] * along[1:], axis=1) < 0.0
        q[order[1:], 3:7] *= np.where(turns_over, -1.0, 1.0).cumprod()[:, None]
        q, by_x, times = (np.concatenate([at, quarter_way(at)]) for at in (q, by_x, times))
        q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1)[:, None]
    order = np.argsort(times)
    q, by_x, times = q[order], by_x[order], times[order]
    until = before_contact(problem, q, _WITHIN) + 1 if problem.allowed_at_goal else len(q)
    return _LookedAt(times, q, by_x, placed_bodies(problem.robot, q[:, 7:]), until)


def quarter_way(values: Array) -> Array:
    """Return values a quarter of the way between points and three quarters, by parabolas.

    But for the first interval, whose beginning is the start.

    Args:
        values: At all points but the first, then half-way in every interval.
    """
    at_points, half_way = np.split(values, 2)
    begin, middle, end = at_points[:-1], half_way[1:], at_points[1:]
    first = (3.0 * begin + 6.0 * middle - end) / 8.0
    return np.concatenate([first, (3.0 * end + 6.0 * middle - begin) / 8.0])


def _along(gradients: Array, sensitivity: Array, configurations: Indices) -> Array:
    """Return derivatives by the decision variables. Shape (rows, variables)."""
    jacobian: Array = np.einsum("rj,rjx->rx", gradients, sensitivity[configurations])
    return jacobian
