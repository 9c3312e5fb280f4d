"""Of distances, what rows are asked for and what margins they have, by Python."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.distance.allowed_contact import (
    Split,
    after_contact,
    before_contact,
    split_obstacles,
    split_pairs,
)
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.distance.start_room import (
    room_of_obstacles,
)
from ff_planner_ros.planning.paths.path_family import Motion
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.requirements.body_rows import (
    FEW_POINTS,
    margins_of_pairs,
    times_looked_at,
)
from ff_planner_ros.planning.requirements.requirement import Rows

_WITHIN = 0.9
_SHORT, _GAINED = 0.5, 0.25


def clear_of_itself(problem: PlanningProblem, motion: Motion, near: Rows, margin: float) -> Rows:
    """Return distances of near pairs of bodies less the margin, at points and half-way [m].

    Args:
        near: Distances, of which nothing is left out.
    """
    count = len(problem.robot.pairs)
    kept = without_allowed(problem, motion, near, count, split_pairs(problem))
    margins = margins_of_pairs(problem, margin)
    return kept._replace(values=kept.values - margins[kept.names % count])


def clear_of_obstacles(problem: PlanningProblem, motion: Motion, near: Rows, margin: float) -> Rows:
    """Return likewise those of bodies, or lines, from obstacles."""
    return without_margins(
        problem, motion, near, margin, room_of_obstacles(problem), split_obstacles(problem)
    )


def without_margins(
    problem: PlanningProblem, motion: Motion, near: Rows, margin: float, room: Array, split: Split
) -> Rows:
    """Return distances less the margins of pairs with some room."""
    kept = without_allowed(problem, motion, near, room.size, split)
    times = times_looked_at(problem.duration, len(motion.q))
    return kept._replace(values=kept.values - margins_of_rows(margin, room, kept.names, times))


def without_allowed(
    problem: PlanningProblem, motion: Motion, found: Rows, count: int, split: Split
) -> Rows:
    """Leave out pairs that are allowed to touch, near the goal and near the start.

    Args:
        found: Rows whose names are configuration times `count` plus pair.
        count: Number of pairs: of bodies, or of body and obstacle.
        split: The pairs by whether they may touch.
    """
    if not problem.allowed_collisions:
        return found
    times, q = looked_at(problem, motion)
    tips = arm_points(problem.robot, q)[:, -1]
    is_apart = np.zeros(count, np.bool_)
    is_apart[split.apart] = True
    configurations, numbers = np.divmod(found.names, count)
    nearer = replace(problem, contact_distance=_WITHIN * problem.contact_distance)
    kept = is_apart[numbers] | (configurations <= before_contact(nearer, times, tips))
    for obstacle, touching in split.at_start:
        first = after_contact(nearer, obstacle, times, q)
        kept &= (configurations >= first) | ~np.isin(numbers, touching)
    return Rows(found.values[kept], found.jacobian[kept], found.names[kept])


def looked_at(problem: PlanningProblem, motion: Motion) -> tuple[Array, Array]:
    """Return when distances of bodies are evaluated, in order, and the configurations then."""
    times, has_quarters = times_looked_at(problem.duration, len(motion.q)), quarters(motion)
    return times, in_order(np.concatenate([motion.q[1:], motion.q_half_way]), has_quarters)


def quarters(motion: Motion) -> bool:
    """Tell whether distances are also evaluated at a quarter and three quarters of intervals."""
    return len(motion.q) < FEW_POINTS


def in_order(q: Array, quarter_way: bool) -> Array:
    """Return configurations in the order of time.

    Args:
        q: At all points but the first, then half-way. Shape (configurations, 7 + joints).
        quarter_way: Add those at quarters of all intervals but the first, by parabolas.
    """
    at = np.arange(len(q) / 2)
    order = np.argsort(np.append(at + 0.5, at))
    if not quarter_way:
        return q[order]
    # Quaternions of one sign: what lies between two is between their entries.
    given = q[order]
    turns_over = np.sum(given[:-1, 3:7] * given[1:, 3:7], axis=1) < 0.0
    given[1:, 3:7] *= np.where(turns_over, -1.0, 1.0).cumprod()[:, None]
    given = with_quarters(given)
    given[:, 3:7] /= np.linalg.norm(given[:, 3:7], axis=1)[:, None]
    return given


def with_quarters(rows: Array) -> Array:
    """Return rows in order of time with those at quarters of all intervals but the first.

    Args:
        rows: Half-way to each point but the first, and at it. Shape (configurations, ...).
    """
    begin, middle, end = rows[1:-2:2], rows[2::2], rows[3::2]
    parts = (
        (3.0 * begin + 6.0 * middle - end) / 8.0,
        middle,
        (3.0 * end + 6.0 * middle - begin) / 8.0,
        end,
    )
    return np.concatenate([rows[:2], np.stack(parts, axis=1).reshape(-1, *rows.shape[1:])])


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
