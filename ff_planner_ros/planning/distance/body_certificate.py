"""Lower bounds of the distances of bodies along a whole motion, between its points too.

Between two points the motion is the cubic through both configurations and velocities, as for the
centre lines. Along it a point of a body moves at most by s = sum |dq_i| r_i, with r_i the distance
of joint i from the body's farthest point. So a distance is at least the mean of both ends' less
s / 2; intervals are halved until the bound is tight. Between two bodies of the robot only the
joints between them count; between body and obstacle the motions of base and obstacle do, too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.distance.bodies import Placed, centers_in_base, placed_bodies
from ff_planner_ros.planning.distance.body_distances import (
    pair_bounds,
    pair_distances,
    sphere_bounds,
    sphere_distances,
)
from ff_planner_ros.planning.distance.body_reaches import base_reaches, body_reaches, pair_reaches
from ff_planner_ros.planning.distance.certificate import CERTIFICATE_GAP, cubics_between
from ff_planner_ros.planning.distance.clearance import centers_at
from ff_planner_ros.planning.distance.obstacle_distances import (
    obstacle_bounds,
    obstacle_distances,
    seen_from_chaser,
)
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.problem.problem import Obstacle, ObstacleBody, Sphere
from ff_planner_ros.robot.model import Robot

# Large distances need not be known to half a millimetre, but to this fraction of themselves.
EXACT_PART = 0.02
# Number of steps in the first intervals: most pairs stay far apart for long.
_STRIDE = 8
# Relative to a pair's whole displacement: its distance is not known more closely than this.
_ROUNDING = 1e-14


class Least(NamedTuple):
    """The least distance along a motion."""

    # Lower bound of the true minimum, below it by at most `CERTIFICATE_GAP` or a fraction of it [m]
    certified: float
    found: float  # the least that was evaluated [m]
    pair: int  # its number, or body times obstacles plus obstacle; -1: there is none
    time: float  # when [s]


NOTHING = Least(np.inf, np.inf, -1, np.inf)


def least_of(*every: Least) -> Least:
    """Return the nearest of several, with the lowest bound of all."""
    nearest = min(every, key=lambda least: least.found)
    return nearest._replace(certified=min(least.certified for least in every))


@dataclass(frozen=True, eq=False)
class _Kind:
    """What is measured: the pairs of bodies, or each body with each obstacle."""

    # Lower bounds at steps for all pairs, (steps, pairs); distances of pairs, each at its own step
    bounds: Callable[[Array], Array]
    distances: Callable[[Array, Indices], Array]
    # How far pairs have moved against each other at most, each at its own step
    ways: Callable[[Array, Indices], Array]


def least_pair_distance(
    robot: Robot, motion: FollowedMotion, chosen: Indices, last: int, part: float = EXACT_PART
) -> Least:
    """Return the least distance of chosen pairs along a motion.

    Args:
        chosen: Numbers of pairs.
        last: Index of the last time that counts.
        part: Relative accuracy of the bound; `CERTIFICATE_GAP` counts if that is more.
    """
    if not len(chosen) or last < 0:
        return NOTHING

    def bounds(steps: Array) -> Array:
        return pair_bounds(robot, _seen_at(robot, motion, steps).placed)

    def distances(steps: Array, which: Indices) -> Array:
        at = _seen_at(robot, motion, steps)
        return pair_distances(robot, at.placed, (at.rows, which)).distance

    sums = _sums(pair_ways(robot, motion))

    def ways(steps: Array, which: Indices) -> Array:
        return _reached(sums, steps, which)

    return _least(_Kind(bounds, distances, ways), chosen, last, motion.time, part)


def least_sphere_distance(
    robot: Robot,
    motion: FollowedMotion,
    spheres: Sequence[Sphere],
    chosen: Indices,
    last: int,
    part: float = EXACT_PART,
    gap: float = CERTIFICATE_GAP,
) -> Least:
    """Return the least distance of chosen bodies from spheres along a motion.

    Args:
        chosen: Body times the number of spheres, plus sphere.
        last: Index of the last time that counts.
        part: Relative accuracy of the bound.
        gap: Absolute accuracy of the bound, if that is more and nothing touches [m].
    """
    if not len(chosen) or last < 0:
        return NOTHING
    radius = np.array([sphere.radius for sphere in spheres])

    def bounds(steps: Array) -> Array:
        at = _seen_at(robot, motion, steps)
        centers = centers_in_base(at.q, centers_at(at.times, spheres))
        return sphere_bounds(robot, at.placed, centers, radius).reshape(len(steps), -1)

    def distances(steps: Array, which: Indices) -> Array:
        at = _seen_at(robot, motion, steps)
        bodies, sphere = np.divmod(which, len(spheres))
        few, column = np.unique(sphere, return_inverse=True)
        centers = centers_in_base(at.q, centers_at(at.times, [spheres[k] for k in few]))
        rows = at.rows, bodies, column
        return sphere_distances(robot, at.placed, centers, radius[few], rows).distance

    kind = _Kind(bounds, distances, _ways_beside(robot, motion, spheres))
    return _least(kind, chosen, last, motion.time, part, gap)


def least_obstacle_distance(
    robot: Robot,
    motion: FollowedMotion,
    obstacles: Sequence[ObstacleBody],
    chosen: Indices,
    last: int,
    part: float = EXACT_PART,
    gap: float = CERTIFICATE_GAP,
) -> Least:
    """Return the least distance of chosen bodies from obstacles; see `least_sphere_distance`.

    Args:
        chosen: Body times the number of obstacles, plus obstacle.
    """
    if not len(chosen) or last < 0:
        return NOTHING

    def bounds(steps: Array) -> Array:
        at = _seen_at(robot, motion, steps)
        found = obstacle_bounds(robot, at.placed, at.q, at.times, obstacles)
        return found.reshape(len(steps), -1)

    def distances(steps: Array, which: Indices) -> Array:
        at = _seen_at(robot, motion, steps)
        bodies, obstacle = np.divmod(which, len(obstacles))
        few, column = np.unique(obstacle, return_inverse=True)
        chosen_ones = [obstacles[k] for k in few]
        poses, rows = seen_from_chaser(at.q, at.times, chosen_ones), (at.rows, bodies, column)
        return obstacle_distances(robot, at.placed, poses, chosen_ones, rows).distance

    kind = _Kind(bounds, distances, _ways_beside(robot, motion, obstacles))
    return _least(kind, chosen, last, motion.time, part, gap)


def _ways_beside(
    robot: Robot, motion: FollowedMotion, obstacles: Sequence[Obstacle]
) -> Callable[[Array, Indices], Array]:
    """Return how far bodies and obstacles have moved against each other at most, for `_Kind`."""
    speeds = np.array([one.highest_speed for one in obstacles])
    of_bodies = _sums(body_ways(robot, motion))

    def ways(steps: Array, which: Indices) -> Array:
        body, obstacle = np.divmod(which, len(obstacles))
        moved: Array = _reached(of_bodies, steps, body) + _times(motion, steps) * speeds[obstacle]
        return moved

    return ways


@lru_cache(maxsize=4)
def cubics_of(robot: Robot, motion: FollowedMotion) -> Array:
    """Return the cubics between the points of a motion; see `cubics_between`."""
    return cubics_between(robot, motion.q, motion.v, np.diff(motion.time))


def pair_ways(robot: Robot, motion: FollowedMotion) -> Array:
    """Return bounds of pairs' relative displacement in each interval. (points - 1, pairs) [m]."""
    rates = np.array([1.0, 2.0, 3.0]) @ np.abs(cubics_of(robot, motion)[:, :, 6:])
    return np.asarray(rates @ pair_reaches(robot), np.float64)


def body_ways(robot: Robot, motion: FollowedMotion) -> Array:
    """Return bounds of the bodies' displacement in each interval. (points - 1, bodies) [m]."""
    cubics = cubics_of(robot, motion)
    rates = np.array([1.0, 2.0, 3.0]) @ np.abs(cubics)
    # The base's linear rate belongs to an axis that turns on the way, by at most `way`.
    way = np.linalg.norm(np.abs(cubics[:, :, :3]).sum(axis=1), axis=1)
    moving, turning = (np.linalg.norm(part, axis=1) for part in np.split(rates[:, :6], 2, axis=1))
    of_base = moving[:, None] + turning[:, None] * (base_reaches(robot) + way[:, None] / 2)
    return np.asarray(of_base + rates[:, 6:] @ body_reaches(robot), np.float64)


class _Seen(NamedTuple):
    """Where the robot is at some steps, each once."""

    q: Array  # shape (configurations, 7 + joints)
    times: Array  # shape (configurations,) [s]
    placed: Placed
    rows: Indices  # the configuration of each step


def _seen_at(robot: Robot, motion: FollowedMotion, steps: Array) -> _Seen:
    """Return where the robot is at steps, points or parts of the way between two."""
    different, rows = np.unique(steps, return_inverse=True)
    if not (different % 1.0).any():
        placed, which = _placed_at_points(robot, motion), different.astype(np.intp)
        return _Seen(
            motion.q[which], motion.time[which], Placed(*(each[which] for each in placed)), rows
        )
    q = _between(robot, motion.q, cubics_of(robot, motion), different)
    return _Seen(q, _times(motion, different), placed_bodies(robot, q[:, 7:]), rows)


@lru_cache(maxsize=4)
def _placed_at_points(robot: Robot, motion: FollowedMotion) -> Placed:
    return placed_bodies(robot, motion.q[:, 7:])


def _least(
    kind: _Kind,
    chosen: Indices,
    last: int,
    time: Array,
    part: float,
    gap: float = CERTIFICATE_GAP,
) -> Least:
    """Halve pieces of the motion until the least distance is known."""
    steps = np.append(np.arange(0.0, last, _STRIDE), float(last))
    bounds = kind.bounds(steps)[:, chosen]
    # What is met where two may be nearest tells which others need not be looked at.
    first_look = bounds.argmin(axis=0)
    candidate = int(bounds.min(axis=0).argmin())
    met = kind.distances(steps[first_look[[candidate]]], chosen[[candidate]])[0]
    ways = np.diff(kind.ways(steps[:, None], chosen[None]), axis=0)
    between = ((bounds[:-1] + bounds[1:] - ways) / 2).min(axis=0, initial=np.inf)
    lowest = np.minimum(bounds.min(axis=0), between)
    # A bound that is exact may be above what is met, by rounding.
    within = np.flatnonzero(lowest <= max(met, float(lowest.min())))
    which = np.repeat(chosen[within], len(steps))
    at = np.tile(steps, len(within))
    distance = kind.distances(at, which)
    best = int(distance.argmin())
    found, pair, step = float(distance[best]), int(which[best]), float(at[best])
    table = distance.reshape(len(within), len(steps))
    pair_of = np.repeat(chosen[within], len(steps) - 1)
    begin, end = np.tile(steps[:-1], len(within)), np.tile(steps[1:], len(within))
    at_begin, at_end = table[:, :-1].ravel(), table[:, 1:].ravel()
    certified = found
    rounding = _ROUNDING * float(ways.sum(axis=0)[within].max(initial=0.0))
    while True:
        finest = max(CERTIFICATE_GAP if found < 0.0 else gap, rounding)
        way = kind.ways(end, pair_of) - kind.ways(begin, pair_of)
        bound = (at_begin + at_end - way) / 2
        open_ = bound < found - max(finest, part * found)
        certified = min(certified, float(bound[~open_].min(initial=np.inf)))
        if not open_.any():
            return Least(certified, found, pair, float(np.interp(step, np.arange(len(time)), time)))
        pair_of, begin, end = pair_of[open_], begin[open_], end[open_]
        middle = (begin + end) / 2
        middle = np.where(end - begin > 1.0, np.floor(middle), middle)
        at_middle = kind.distances(middle, pair_of)
        best = int(at_middle.argmin())
        if at_middle[best] < found:
            found, pair, step = float(at_middle[best]), int(pair_of[best]), float(middle[best])
            certified = min(certified, found)
        pair_of = np.concatenate([pair_of, pair_of])
        begin, end = np.concatenate([begin, middle]), np.concatenate([middle, end])
        at_begin = np.concatenate([at_begin[open_], at_middle])
        at_end = np.concatenate([at_middle, at_end[open_]])


def _sums(ways: Array) -> Array:
    """Return the ways up to each point of those between two points."""
    return np.vstack([np.zeros(ways.shape[1]), ways.cumsum(axis=0)])


def _reached(sums: Array, steps: Array, column: Indices) -> Array:
    """Return the sums up to steps, points or parts of the way between two."""
    whole = np.minimum(steps.astype(np.intp), len(sums) - 2)
    before, after = sums[whole, column], sums[whole + 1, column]
    reached: Array = before + (steps - whole) * (after - before)
    return reached


def _times(motion: FollowedMotion, steps: Array) -> Array:
    return np.interp(steps, np.arange(len(motion.time)), motion.time)


def _between(robot: Robot, q: Array, cubics: Array, steps: Array) -> Array:
    """Return configurations at steps, points or parts of the way between two."""
    whole = np.minimum(steps.astype(np.intp), len(q) - 2)
    part = steps - whole
    at_points = q[np.round(steps).astype(np.intp)]
    rows = np.flatnonzero(part % 1.0)
    if rows.size:
        powers = part[rows, None] ** np.array([1, 2, 3])
        moved = np.einsum("ip,ipj->ij", powers, cubics[whole[rows]])
        begin = q[whole[rows]]
        at_points[rows] = [pin.integrate(robot.model, *at) for at in zip(begin, moved, strict=True)]
    return at_points
