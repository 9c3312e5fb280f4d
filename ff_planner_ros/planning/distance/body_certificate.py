"""Lower bounds of the distances of bodies along a whole motion, between its points too.

Between two points the motion is the cubic through both configurations and velocities, as for the
centre lines. Along it a point of a body moves at most by s = sum |dq_i| r_i, with r_i the distance
of joint i from the body's farthest point. Where that does not tell enough between two points,
accelerations do: see `body_gaps`. Between two bodies of the robot only the joints between them
count; between body and obstacle the motions of base and obstacle do, too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import coal
import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.distance.bodies import pairs
from ff_planner_ros.planning.distance.body_distances import (
    obstacle_bounds,
    obstacle_distances,
    pair_bounds,
    pair_distances,
)
from ff_planner_ros.planning.distance.body_gaps import Solids, arcs_of, measured
from ff_planner_ros.planning.distance.body_motion import (
    bends_beside,
    body_ways,
    pair_bends,
    pair_ways,
    seen_at,
    times_at,
)
from ff_planner_ros.planning.distance.surroundings import Surroundings
from ff_planner_ros.planning.motion.certified_least import (
    NOTHING,
    Arcs,
    Known,
    Least,
    Pieces,
    certified_least,
)
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.robot.model import Robot

# The check's certificates are below the truth by at most this [m].
CHECK_GAP = 2e-4
# Between two points the robot is off its cubic by less than this [m], and Coal by far less.
_OFF = 2e-6
# Number of steps in the first intervals: most pairs stay far apart for long.
_STRIDE = 4


@dataclass(frozen=True, eq=False)
class _Kind:
    """What is measured: the pairs of bodies, or each body with each obstacle."""

    # Lower bounds at steps for all pairs, (steps, pairs); pairs measured, each at its own step
    bounds: Callable[[Array], Array]
    measure: Callable[[Array, Indices], Known]
    # How far pairs have moved against each other since the first point at most, each at its step
    moved: Callable[[Array, Indices], Array]
    # Gaps on pieces between two points
    arcs: Callable[[Pieces], Arcs]


def least_pair_distance(robot: Robot, motion: FollowedMotion, chosen: Indices, last: int) -> Least:
    """Return the least distance of chosen pairs along a motion.

    Args:
        chosen: Numbers of pairs.
        last: Index of the last time that counts.
    """
    if not len(chosen) or last < 0:
        return NOTHING

    def bounds(steps: Array) -> Array:
        at = seen_at(robot, motion, steps)
        return pair_bounds(robot, at.placed)[at.rows]

    def measure(steps: Array, which: Indices) -> Known:
        at = seen_at(robot, motion, steps)
        found = pair_distances(robot, at.placed, (at.rows, which))
        first, second = (at.poses(side[which]) for side in pairs(robot))
        return measured(found, first, second)

    sums = _sums(pair_ways(robot, motion))

    def moved(steps: Array, which: Indices) -> Array:
        return _reached(sums, steps, which)

    def arcs(pieces: Pieces) -> Arcs:
        first, second = (Solids(_solids(robot), side[pieces.which]) for side in pairs(robot))
        bends = pair_bends(robot, motion, pieces.which, pieces.begin, pieces.end)
        return arcs_of(first, second, pieces, bends)

    kind = _Kind(bounds, measure, moved, arcs)
    return _least(kind, chosen, last, motion.time, CHECK_GAP)


def least_obstacle_distance(
    robot: Robot,
    motion: FollowedMotion,
    around: Surroundings,
    chosen: Indices,
    last: int,
    gap: float = CHECK_GAP,
) -> Least:
    """Return the least distance of chosen bodies from obstacles along a motion.

    Args:
        around: The obstacles.
        chosen: Body times the number of obstacles, plus obstacle.
        last: Index of the last time that counts.
        gap: The bound is below the truth by this at most [m].
    """
    if not len(chosen) or last < 0:
        return NOTHING
    count, speeds = len(around.obstacles), around.bounds[0]
    of_bodies, solids = _sums(body_ways(robot, motion)), _solids(robot)

    def bounds(steps: Array) -> Array:
        at = seen_at(robot, motion, steps)
        found = obstacle_bounds(robot, at.placed, at.q, at.times, around)
        return found.reshape(len(at.times), -1)[at.rows]

    def measure(steps: Array, which: Indices) -> Known:
        at = seen_at(robot, motion, steps)
        body, obstacle = np.divmod(which, count)
        there = around.seen_from_base(at.q, at.times, at.rows, obstacle)
        found = obstacle_distances(robot, at.placed, there, around, (at.rows, body, obstacle))
        return measured(found, at.poses(body), there, at.placed.stretches[at.rows, body])

    def moved(steps: Array, which: Indices) -> Array:
        body, obstacle = np.divmod(which, count)
        both: Array = _reached(of_bodies, steps, body) + times_at(motion, steps) * speeds[obstacle]
        return both

    def arcs(pieces: Pieces) -> Arcs:
        which, begin, end, at_begin, at_end = pieces
        body, obstacle = np.divmod(which, count)
        way = moved(end, which) - moved(begin, which)
        apart = np.maximum((at_begin.value + at_end.value + way) / 2, 0.0)
        bends = bends_beside(robot, motion, around, which, begin, end, apart)
        few, column = np.unique(obstacle, return_inverse=True)
        others = [around.obstacles[number].solid.geometry for number in few.tolist()]
        return arcs_of(Solids(solids, body), Solids(others, column), pieces, bends)

    return _least(_Kind(bounds, measure, moved, arcs), chosen, last, motion.time, gap)


def _solids(robot: Robot) -> list[coal.CollisionGeometry]:
    """Return the solids of bodies; of those that are stretched, their begin."""
    return [coal.Sphere(0.0) if body.stretches else body.solid for body in robot.bodies]


def _least(kind: _Kind, chosen: Indices, last: int, time: Array, gap: float) -> Least:
    """Return the least distance of what may be nearest on some pieces of the motion."""
    steps = np.append(np.arange(0.0, max(last, 1), _STRIDE), float(last))
    bounds = kind.bounds(steps)[:, chosen]
    # What is met where two may be nearest tells where others need not be looked at.
    at, which = np.divmod(np.array([bounds.argmin()]), len(chosen))
    met = float(kind.measure(steps[at], chosen[which]).value[0])
    ways = np.diff(kind.moved(steps[:, None], chosen[None]), axis=0)
    between = (bounds[:-1] + bounds[1:] - ways) / 2
    # A bound that is exact may be above what is met, by rounding.
    low = between <= max(met, float(bounds.min()), float(between.min()))
    looked_at = np.zeros(bounds.shape, bool)
    looked_at[:-1] |= low
    looked_at[1:] |= low
    at, which = np.nonzero(looked_at)
    row = np.cumsum(looked_at).reshape(looked_at.shape) - 1
    every = kind.measure(steps[at], chosen[which])
    at, which = np.nonzero(low)
    ends = every.rows(row[at, which]), every.rows(row[at + 1, which])
    pieces = Pieces(chosen[which], steps[at], steps[at + 1], *ends)

    def moved_on(pieces: Pieces) -> Array:
        way: Array = kind.moved(pieces.end, pieces.which) - kind.moved(pieces.begin, pieces.which)
        return way

    off = min(_OFF, gap / 2)
    least = certified_least(time, pieces, kind.measure, moved_on, kind.arcs, gap - off)
    return least._replace(certified=least.certified - off)


def _sums(ways: Array) -> Array:
    """Return the ways up to each point of those between two points."""
    return np.vstack([np.zeros(ways.shape[1]), ways.cumsum(axis=0)])


def _reached(sums: Array, steps: Array, column: Indices) -> Array:
    """Return the sums up to steps, points or parts of the way between two."""
    whole = np.minimum(steps.astype(np.intp), len(sums) - 2)
    before, after = sums[whole, column], sums[whole + 1, column]
    reached: Array = before + (steps - whole) * (after - before)
    return reached
