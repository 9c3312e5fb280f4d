"""Lower bounds of the distances of bodies along a whole motion, between its points too.

Between two points the motion is the cubic through both configurations and velocities, as for the
centre lines. Along it a point of a body moves at most by s = sum |dq_i| r_i, with r_i the distance
of joint i from the body's farthest point. So a distance is at least the mean of both ends' less
s / 2. Where that is too low between two points, accelerations bound it, too: see `body_gaps`.
Intervals are halved until the better bound is tight. Between two bodies of the robot only the
joints between them count; between body and obstacle the motions of base and obstacle do, too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import coal
import numpy as np
from numpy.typing import NDArray

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.distance.bodies import centers_in_base, pairs
from ff_planner_ros.planning.distance.body_distances import (
    pair_bounds,
    pair_distances,
    sphere_bounds,
    sphere_distances,
)
from ff_planner_ros.planning.distance.body_gaps import Measured, Solids, gap_bounds, measured
from ff_planner_ros.planning.distance.body_motion import (
    bends_beside,
    body_ways,
    pair_bends,
    pair_ways,
    seen_at,
    times_at,
)
from ff_planner_ros.planning.distance.certificate import CERTIFICATE_GAP
from ff_planner_ros.planning.distance.clearance import centers_at
from ff_planner_ros.planning.distance.obstacle_distances import (
    obstacle_bounds,
    obstacle_distances,
    obstacle_geometry,
    seen_from_chaser,
)
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.problem.problem import Obstacle, ObstacleBody, Sphere
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.quaternion import rotation_from_quaternion

# Large distances need not be known to half a millimetre, but to this fraction of themselves.
EXACT_PART = 0.02
# Number of steps in the first intervals: most pairs stay far apart for long.
_STRIDE = 8
# Pieces that are looked at: a motion that needs more, no joint makes, and the bound is lower.
_MOST_PIECES = 1 << 16
# Relative to a pair's whole displacement: its distance is not known more closely than this.
_ROUNDING = 1e-14


class Least(NamedTuple):
    """The least distance along a motion."""

    # Lower bound of the true minimum, below it by at most `CERTIFICATE_GAP` or a fraction of it
    # unless the motion is too fast to tell [m]
    certified: float
    found: float  # the least that was evaluated [m]
    pair: int  # its number, or body times obstacles plus obstacle; -1: there is none
    time: float  # when [s]


NOTHING = Least(np.inf, np.inf, -1, np.inf)


def least_of(*every: Least) -> Least:
    """Return the nearest of several, with the lowest bound of all."""
    nearest = min(every, key=lambda least: least.found)
    return nearest._replace(certified=min(least.certified for least in every))


class _Pieces(NamedTuple):
    """Pieces of the motion, each of one pair."""

    pair: Indices  # shape (pieces,)
    begin: Array  # first step; shape (pieces,)
    end: Array
    at_begin: Measured
    at_end: Measured

    def rows(self, which: Indices | NDArray[np.bool_]) -> _Pieces:
        """Return some of the pieces."""
        ends = self.at_begin.rows(which), self.at_end.rows(which)
        return _Pieces(self.pair[which], self.begin[which], self.end[which], *ends)

    def halved(self, middle: Array, at_middle: Measured) -> _Pieces:
        """Return the first part of each piece, then the second parts."""
        return _Pieces(
            np.concatenate([self.pair, self.pair]),
            np.concatenate([self.begin, middle]),
            np.concatenate([middle, self.end]),
            self.at_begin.followed_by(at_middle),
            at_middle.followed_by(self.at_end),
        )


@dataclass(frozen=True, eq=False)
class _Kind:
    """What is measured: the pairs of bodies, or each body with each obstacle."""

    # Lower bounds at steps for all pairs, (steps, pairs); pairs measured, each at its own step
    bounds: Callable[[Array], Array]
    measure: Callable[[Array, Indices], Measured]
    # How far pairs have moved against each other at most, each at its own step
    ways: Callable[[Array, Indices], Array]
    # Lower bounds of distances by `gap_bounds`, of pieces between two points
    gaps: Callable[[_Pieces], Array]


def least_pair_distance(robot: Robot, motion: FollowedMotion, chosen: Indices, last: int) -> Least:
    """Return the least distance of chosen pairs along a motion.

    Args:
        chosen: Numbers of pairs.
        last: Index of the last time that counts.
    """
    if not len(chosen) or last < 0:
        return NOTHING

    def bounds(steps: Array) -> Array:
        return pair_bounds(robot, seen_at(robot, motion, steps).placed)

    def measure(steps: Array, which: Indices) -> Measured:
        at = seen_at(robot, motion, steps)
        found = pair_distances(robot, at.placed, (at.rows, which))
        return measured(found, *(at.poses(side[which]) for side in pairs(robot)))

    sums = _sums(pair_ways(robot, motion))

    def ways(steps: Array, which: Indices) -> Array:
        return _reached(sums, steps, which)

    def gaps(pieces: _Pieces) -> Array:
        first, second = (Solids(_solids(robot), side[pieces.pair]) for side in pairs(robot))
        bends = pair_bends(robot, motion, pieces.pair, pieces.begin, pieces.end)
        return gap_bounds(first, second, pieces.at_begin, pieces.at_end, bends)

    kind = _Kind(bounds, measure, ways, gaps)
    return _least(kind, chosen, last, motion.time)


def least_sphere_distance(
    robot: Robot,
    motion: FollowedMotion,
    spheres: Sequence[Sphere],
    chosen: Indices,
    last: int,
    gap: float = CERTIFICATE_GAP,
) -> Least:
    """Return the least distance of chosen bodies from spheres along a motion.

    Args:
        chosen: Body times the number of spheres, plus sphere.
        last: Index of the last time that counts.
        gap: Absolute accuracy of the bound, if that is more and nothing touches [m].
    """
    if not len(chosen) or last < 0:
        return NOTHING
    radius = np.array([sphere.radius for sphere in spheres])

    def bounds(steps: Array) -> Array:
        at = seen_at(robot, motion, steps)
        centers = centers_in_base(at.q, centers_at(at.times, spheres))
        return sphere_bounds(robot, at.placed, centers, radius).reshape(len(steps), -1)

    def measure(steps: Array, which: Indices) -> Measured:
        at = seen_at(robot, motion, steps)
        bodies, sphere = np.divmod(which, len(spheres))
        few, column = np.unique(sphere, return_inverse=True)
        centers = centers_in_base(at.q, centers_at(at.times, [spheres[k] for k in few]))
        rows = at.rows, bodies, column
        found = sphere_distances(robot, at.placed, centers, radius[few], rows)
        axes = rotation_from_quaternion(at.q[:, 3:7]).swapaxes(1, 2)
        return measured(found, at.poses(bodies), (axes[at.rows], centers[at.rows, column]))

    kind = _beside(robot, motion, spheres, bounds, measure)
    return _least(kind, chosen, last, motion.time, gap)


def least_obstacle_distance(
    robot: Robot,
    motion: FollowedMotion,
    obstacles: Sequence[ObstacleBody],
    chosen: Indices,
    last: int,
    gap: float = CERTIFICATE_GAP,
) -> Least:
    """Return the least distance of chosen bodies from obstacles; see `least_sphere_distance`.

    Args:
        chosen: Body times the number of obstacles, plus obstacle.
    """
    if not len(chosen) or last < 0:
        return NOTHING

    def bounds(steps: Array) -> Array:
        at = seen_at(robot, motion, steps)
        found = obstacle_bounds(robot, at.placed, at.q, at.times, obstacles)
        return found.reshape(len(steps), -1)

    def measure(steps: Array, which: Indices) -> Measured:
        at = seen_at(robot, motion, steps)
        bodies, obstacle = np.divmod(which, len(obstacles))
        few, column = np.unique(obstacle, return_inverse=True)
        chosen_ones = [obstacles[k] for k in few]
        poses, rows = seen_from_chaser(at.q, at.times, chosen_ones), (at.rows, bodies, column)
        found = obstacle_distances(robot, at.placed, poses, chosen_ones, rows)
        there = poses.rotations[at.rows, column], poses.positions[at.rows, column]
        return measured(found, at.poses(bodies), there)

    kind = _beside(robot, motion, obstacles, bounds, measure)
    return _least(kind, chosen, last, motion.time, gap)


def _beside(
    robot: Robot,
    motion: FollowedMotion,
    obstacles: Sequence[Obstacle],
    bounds: Callable[[Array], Array],
    measure: Callable[[Array, Indices], Measured],
) -> _Kind:
    """Return bodies and obstacles as what is measured."""
    speeds = np.array([one.highest_speed for one in obstacles])
    solids, others = _solids(robot), [obstacle_geometry(one) for one in obstacles]
    of_bodies = _sums(body_ways(robot, motion))

    def ways(steps: Array, which: Indices) -> Array:
        body, obstacle = np.divmod(which, len(obstacles))
        moved: Array = _reached(of_bodies, steps, body) + times_at(motion, steps) * speeds[obstacle]
        return moved

    def gaps(pieces: _Pieces) -> Array:
        which, begin, end, at_begin, at_end = pieces
        body, obstacle = np.divmod(which, len(obstacles))
        way = ways(end, which) - ways(begin, which)
        apart = np.maximum((at_begin.distance + at_end.distance + way) / 2, 0.0)
        bends = bends_beside(robot, motion, obstacles, which, begin, end, apart)
        both = Solids(solids, body), Solids(others, obstacle)
        return gap_bounds(*both, at_begin, at_end, bends)

    return _Kind(bounds, measure, ways, gaps)


def _solids(robot: Robot) -> list[coal.CollisionGeometry]:
    return [body.solid for body in robot.bodies]


def _least(
    kind: _Kind, chosen: Indices, last: int, time: Array, gap: float = CERTIFICATE_GAP
) -> Least:
    """Halve pieces of the motion until the least distance is known."""
    steps = np.append(np.arange(0.0, last, _STRIDE), float(last))
    bounds = kind.bounds(steps)[:, chosen]
    # What is met where two may be nearest tells where others need not be looked at.
    at, which = np.divmod(np.array([bounds.argmin()]), len(chosen))
    met = kind.measure(steps[at], chosen[which]).distance[0]
    ways = np.diff(kind.ways(steps[:, None], chosen[None]), axis=0)
    between = (bounds[:-1] + bounds[1:] - ways) / 2
    # A bound that is exact may be above what is met, by rounding.
    most = max(met, float(bounds.min()))
    low, looked_at = between <= most, bounds <= most
    looked_at[:-1] |= low
    looked_at[1:] |= low
    at, which = np.nonzero(looked_at)
    row = np.cumsum(looked_at).reshape(looked_at.shape) - 1
    every = kind.measure(steps[at], chosen[which])
    best = int(every.distance.argmin())
    found = float(every.distance[best])
    pair, step = int(chosen[which[best]]), float(steps[at[best]])
    at, which = np.nonzero(low)
    pieces = _Pieces(
        chosen[which],
        steps[at],
        steps[at + 1],
        every.rows(row[at, which]),
        every.rows(row[at + 1, which]),
    )
    certified, looked = found, 0
    rounding = _ROUNDING * float(ways.sum(axis=0)[which].max(initial=0.0))
    while True:
        finest = max(CERTIFICATE_GAP if found < 0.0 else gap, rounding)
        enough = found - max(finest, EXACT_PART * found)
        way = kind.ways(pieces.end, pieces.pair) - kind.ways(pieces.begin, pieces.pair)
        bound = (pieces.at_begin.distance + pieces.at_end.distance - way) / 2
        short = np.flatnonzero((bound < enough) & (pieces.end - pieces.begin <= 1.0))
        if short.size:
            bound[short] = np.maximum(bound[short], kind.gaps(pieces.rows(short)))
        open_ = (bound < enough) & (looked < _MOST_PIECES)
        looked += len(pieces.pair)
        certified = min(certified, float(bound[~open_].min(initial=np.inf)))
        if not open_.any():
            return Least(certified, found, pair, float(np.interp(step, np.arange(len(time)), time)))
        pieces = pieces.rows(open_)
        middle = (pieces.begin + pieces.end) / 2
        middle = np.where(pieces.end - pieces.begin > 1.0, np.floor(middle), middle)
        at_middle = kind.measure(middle, pieces.pair)
        best = int(at_middle.distance.argmin())
        if (nearest := float(at_middle.distance[best])) < found:
            found, pair, step = nearest, int(pieces.pair[best]), float(middle[best])
            certified = min(certified, found)
        pieces = pieces.halved(middle, at_middle)


def _sums(ways: Array) -> Array:
    """Return the ways up to each point of those between two points."""
    return np.vstack([np.zeros(ways.shape[1]), ways.cumsum(axis=0)])


def _reached(sums: Array, steps: Array, column: Indices) -> Array:
    """Return the sums up to steps, points or parts of the way between two."""
    whole = np.minimum(steps.astype(np.intp), len(sums) - 2)
    before, after = sums[whole, column], sums[whole + 1, column]
    reached: Array = before + (steps - whole) * (after - before)
    return reached
