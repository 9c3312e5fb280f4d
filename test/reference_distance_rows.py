"""Rows of distances, by Python; the core tells the distances themselves."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import bodies_of, chain_of, obstacles_of, spheres_of
from ff_planner_ros.planning.distance.allowed_contact import (
    Split,
    after_contact,
    before_contact,
    split_obstacles,
    split_pairs,
    split_spheres,
)
from ff_planner_ros.planning.distance.start_room import (
    room_of_bodies,
    room_of_lines,
    room_of_obstacles,
)
from ff_planner_ros.planning.paths.path_family import Motion, Sensitivity
from ff_planner_ros.planning.problem.problem import PlanningProblem, Sphere
from ff_planner_ros.planning.requirements.body_rows import (
    FEW_POINTS,
    OF_INTEREST,
    margins_of_pairs,
    times_looked_at,
)
from ff_planner_ros.planning.requirements.requirement import OF_INTEREST as LINES_OF_INTEREST
from ff_planner_ros.planning.requirements.requirement import Rows
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.model import Robot

_WITHIN = 0.9
_SHORT, _GAINED = 0.5, 0.25


def clearance(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows | None:
    """Return distances of near lines less the margin, at points and half-way between [m]."""
    looked_at = times_looked_at(problem.duration, len(motion.q))
    distances, jacobian, names = clearance_rows(
        problem.robot,
        np.concatenate([motion.q[1:], motion.q_half_way]),
        np.concatenate([sensitivity.q[1:], sensitivity.q_half_way]),
        looked_at,
        problem.spheres,
        LINES_OF_INTEREST,
        quarter_way=len(motion.q) < FEW_POINTS,
        times_by_last=times_by_last(sensitivity, looked_at, problem.duration),
    )
    margins = margins_of_rows(margin, room_of_lines(problem), names, looked_at)
    return Rows(distances - margins, jacobian, names)


def clearance_rows(
    robot: Robot,
    q: Array,
    q_sensitivity: Array,
    times: Array,
    spheres: Sequence[Sphere],
    interest: float,
    quarter_way: bool,
    times_by_last: Array | None = None,
) -> tuple[Array, Array, Indices]:
    """Return distances of segments from spheres below `interest` [m], and their derivatives.

    Args:
        q: At all points but the first, then half-way in every interval.
        q_sensitivity: As for `arm_points_with_derivatives`.
        times: Of all configurations that are evaluated.
        quarter_way: Also evaluate at a quarter and three quarters of all intervals but the first,
            by the parabola through both ends and the middle.
        times_by_last: Derivatives of the times by the last variable. None, empty: there are none.

    Returns:
        Shapes (rows,), (rows, columns) and (rows,): the last says which point, joint that a segment
        starts at, and sphere.
    """
    return compiled.clearances(
        chain=chain_of(robot),
        q=q,
        q_sensitivity=q_sensitivity,
        times=times,
        spheres=spheres_of(spheres, float(times.max())),
        interest=interest,
        quarter_way=quarter_way,
        times_by_last=times[:0] if times_by_last is None else times_by_last,
    )


def body_clearance(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows | None:
    """Return the distances of bodies near spheres, less the margin [m]."""
    return sphere_rows(problem, motion, sensitivity, margin)


def self_clearance(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows | None:
    """Return the distances of near pairs of bodies, less the margin [m]."""
    return pair_rows(problem, motion, sensitivity, margin)


def obstacle_clearance(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows | None:
    """Return the distances of bodies near obstacles, less the margin [m]."""
    return obstacle_rows(problem, motion, sensitivity, margin)


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


def obstacle_rows(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows:
    """Return rows for bodies nearer to obstacles than `OF_INTEREST`: distance less margin [m]."""
    robot, at = with_bodies(problem.robot), looked_at(problem, motion, sensitivity)
    obstacles = problem.obstacle_bodies
    near = compiled.obstacle_rows(
        at.bodies,
        at.times,
        obstacles=obstacles_of(obstacles, float(at.times[-1])),
        interest=OF_INTEREST,
        times_by_last=at.times_by_last,
    )
    count, split = len(robot.bodies) * len(obstacles), split_obstacles(problem)
    distances, jacobian, names = without_allowed(problem, at, Rows(*near), count, split)
    margins = margins_of_rows(margin, room_of_obstacles(problem), names, at.times)
    return Rows(distances - margins, jacobian, names)


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
    by_last = times_by_last(sensitivity, times, problem.duration)
    until = len(times)
    if problem.allowed_collisions:
        until = before_contact(problem, times, bodies.tips, _WITHIN) + 1
    return LookedAt(bodies, times, by_last, until)


def margins_of_rows(margin: float, room: Array, names: Indices, times: Array) -> Array:
    """Return the margin that each distance must keep [m]: no more than the room at the start.

    A much smaller room grows to the margin as the cube of the time, as displacements from rest do:
    without a margin later on, nothing would keep the arm clear between the points.

    Args:
        margin: The largest margin [m].
        room: Of each pair, by its number [m].
        names: Configuration times the number of pairs, plus pair. Shape (rows,).
        times: Of the configurations, the last one at the end [s].
    """
    configurations, numbers = np.divmod(names, room.size)
    least = room.ravel()[numbers]
    short = least < _SHORT * margin
    if short.any():
        gained = margin * np.minimum(times / (_GAINED * times.max()), 1.0) ** 3
        least[short] += gained[configurations[short]]
    margins: Array = np.minimum(margin, least)
    return margins


def times_by_last(sensitivity: Sensitivity, times: Array, duration: float) -> Array:
    """Return derivatives of times [s] by the duration; empty if that is given."""
    return times[:0] if sensitivity.goal_motion is None else times / duration
