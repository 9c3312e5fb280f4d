"""A lower bound of the distances of bodies along a whole motion, between its points too.

Between two points the motion is the cubic through both configurations and velocities, as for the
arm's lines. While it goes on, no point of a body moves further than the joints' turns times what
lies between the joint and the farthest point of the body. Two bodies of the robot are moved against
each other by the joints between them alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from ff_planner_ros.arrays import Array, Indices
from ff_planner_ros.planning.bodies import (
    Placed,
    base_reaches,
    body_reaches,
    pair_bounds,
    pair_distances,
    pair_reaches,
    placed_bodies,
    sphere_bounds,
    sphere_distances,
)
from ff_planner_ros.planning.certificate import CERTIFICATE_GAP, cubics_between
from ff_planner_ros.planning.clearance import centers_at
from ff_planner_ros.planning.followed import FollowedMotion
from ff_planner_ros.planning.problem import Sphere
from ff_planner_ros.robot.model import Robot

# What is far apart need not be known to half a millimetre, but to this part of the distance.
EXACT_PART = 0.02
# The motion is first looked at in so many steps at once: most pairs stay far apart for long.
_STRIDE = 8


class Least(NamedTuple):
    """The least distance along a motion."""

    # The least there is, or below it by at most `CERTIFICATE_GAP` or a part of it [m]
    certified: float
    found: float  # the least that was met [m]
    pair: int  # whose: number of the pair, or body times spheres plus sphere; -1: of none
    time: float  # when [s]


NOTHING = Least(np.inf, np.inf, -1, np.inf)


def lesser(one: Least, other: Least) -> Least:
    """Return the least of both."""
    nearer = min(one, other, key=lambda least: least.found)
    return nearer._replace(certified=min(one.certified, other.certified))


@dataclass(frozen=True, eq=False)
class _Kind:
    """What is measured: the pairs of bodies, or each body with each sphere."""

    # Lower bounds at steps for all pairs, (steps, pairs); distances of pairs, each at its own step
    bounds: Callable[[Array], Array]
    distances: Callable[[Array, Indices], Array]
    ways: Array  # of a pair against each other, from the first point on; shape (points, pairs) [m]


def least_pair_distance(
    robot: Robot, motion: FollowedMotion, chosen: Indices, last: int, part: float = EXACT_PART
) -> Least:
    """Return the least distance of chosen pairs from the first point to the last.

    Args:
        part: Of a distance, to which it is certified.
    """
    if not len(chosen) or last < 0:
        return NOTHING
    cubics = cubics_between(robot, motion.q, motion.v, np.diff(motion.time))

    def placed(steps: Array) -> Placed:
        return placed_bodies(robot, _between(robot, motion.q, cubics, steps)[:, 7:])

    def bounds(steps: Array) -> Array:
        return pair_bounds(robot, placed(steps))

    def distances(steps: Array, which: Indices) -> Array:
        different, configurations = np.unique(steps, return_inverse=True)
        return pair_distances(robot, placed(different), (configurations, which)).distance

    kind = _Kind(bounds, distances, _ways(_joint_rates(cubics) @ pair_reaches(robot)))
    return _least(kind, chosen, last, motion.time, part)


def least_sphere_distance(
    robot: Robot,
    motion: FollowedMotion,
    spheres: Sequence[Sphere],
    chosen: Indices,
    last: int,
    part: float = EXACT_PART,
) -> Least:
    """Return the least distance of chosen bodies and spheres from the first point to the last.

    Args:
        chosen: Body times the number of spheres, plus sphere.
        part: Of a distance, to which it is certified.
    """
    if not len(chosen) or last < 0:
        return NOTHING
    steps_in_time = np.diff(motion.time)
    cubics = cubics_between(robot, motion.q, motion.v, steps_in_time)
    radius = np.array([sphere.radius for sphere in spheres])

    def seen(steps: Array) -> tuple[Placed, Array]:
        q = _between(robot, motion.q, cubics, steps)
        times = np.interp(steps, np.arange(len(motion.time)), motion.time)
        return placed_bodies(robot, q[:, 7:]), centers_in_base(q, centers_at(times, spheres))

    def bounds(steps: Array) -> Array:
        return sphere_bounds(robot, *seen(steps), radius).reshape(len(steps), -1)

    def distances(steps: Array, which: Indices) -> Array:
        different, configurations = np.unique(steps, return_inverse=True)
        rows = configurations, *np.divmod(which, len(spheres))
        return sphere_distances(robot, *seen(different), radius, rows).distance

    rates = np.array([1.0, 2.0, 3.0]) @ np.abs(cubics)
    # The base's linear rate belongs to an axis that turns on the way, by at most `way`.
    way = np.linalg.norm(np.abs(cubics[:, :, :3]).sum(axis=1), axis=1)
    moving, turning = (np.linalg.norm(part, axis=1) for part in np.split(rates[:, :6], 2, axis=1))
    of_base = moving[:, None] + turning[:, None] * (base_reaches(robot) + way[:, None] / 2)
    of_bodies = of_base + rates[:, 6:] @ body_reaches(robot)
    speeds = np.array([sphere.highest_speed for sphere in spheres])
    together = of_bodies[:, :, None] + (steps_in_time[:, None] * speeds)[:, None]
    kind = _Kind(bounds, distances, _ways(together.reshape(len(together), -1)))
    return _least(kind, chosen, last, motion.time, part)


def centers_in_base(q: Array, centers: Array) -> Array:
    """Return points as the chaser sees them. Shape (configurations, points, 3)."""
    turns = Rotation.from_quat(q[:, 3:7]).as_matrix()
    return np.asarray((centers - q[:, None, :3]) @ turns, np.float64)


def _least(kind: _Kind, chosen: Indices, last: int, time: Array, part: float) -> Least:
    """Halve pieces of the motion until the least distance is known."""
    steps = np.append(np.arange(0.0, last, _STRIDE), float(last))
    bounds = kind.bounds(steps)[:, chosen]
    # What is met where two may be nearest tells which others need not be looked at.
    first_look = bounds.argmin(axis=0)
    candidate = int(bounds.min(axis=0).argmin())
    met = kind.distances(steps[first_look[[candidate]]], chosen[[candidate]])[0]
    ways = np.diff(kind.ways[steps.astype(np.intp)][:, chosen], axis=0)
    lowest = (bounds[:-1] + bounds[1:] - ways) / 2
    within = np.flatnonzero(lowest.min(axis=0, initial=np.inf) <= met)
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
    while True:
        way = _way(kind.ways, end, pair_of) - _way(kind.ways, begin, pair_of)
        bound = (at_begin + at_end - way) / 2
        open_ = bound < found - max(CERTIFICATE_GAP, part * found)
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


def _ways(between: Array) -> Array:
    """Return the ways up to each point of those between two points."""
    return np.vstack([np.zeros(between.shape[1]), between.cumsum(axis=0)])


def _way(ways: Array, steps: Array, pair: Indices) -> Array:
    """Return the ways up to steps, points or parts of the way between two."""
    whole = np.minimum(steps.astype(np.intp), len(ways) - 2)
    before, after = ways[whole, pair], ways[whole + 1, pair]
    reached: Array = before + (steps - whole) * (after - before)
    return reached


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


def _joint_rates(cubics: Array) -> Array:
    """Return bounds of the joints' turns between points. Shape (points - 1, joints)."""
    rates: Array = np.array([1.0, 2.0, 3.0]) @ np.abs(cubics[:, :, 6:])
    return rates
