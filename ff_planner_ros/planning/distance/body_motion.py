"""How bodies move along a motion: where they are, and how far and how sharply they move at most.

Between two points joints and base are cubics in the part s of the interval. A chain of axes moves a
body: axis k turns or slides, at the rate u_k, what is behind it. As axis j turns axis k behind it,
too, a point behind all of them, with the lever r_k at axis k, has a second derivative of at most

    sum_k r_k (|u_k'| + u_k^2) + 2 sum_{j<k} u_j u_k r_k,    j of the axes that turn,

without the square, and with 1 for the lever, where axis k slides.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.distance.bodies import (
    Placed,
    carries,
    movers,
    pairs,
    placed_bodies,
    radii,
)
from ff_planner_ros.planning.distance.body_reaches import (
    base_reaches,
    body_reaches,
    pair_reaches,
    reaches,
)
from ff_planner_ros.planning.distance.surroundings import Surroundings
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.robot.model import Robot


@lru_cache(maxsize=4)
def cubics_of(robot: Robot, motion: FollowedMotion) -> Array:
    """Return the cubics between the points of a motion; see `cubics_between`."""
    return cubics_between(robot, motion.q, motion.v, np.diff(motion.time))


def cubics_between(robot: Robot, q: Array, v: Array, steps: Array) -> Array:
    """Return the tangent-space cubics through consecutive configurations and velocities.

    There is none where one configuration is left of a motion.

    Returns:
        Coefficients of s, s^2, s^3 from one to the next, s from 0 to 1. Shape
        (points - 1, 3, 6 + joints).
    """
    model, to_end, size = robot.model, pin.ArgumentPosition.ARG1, robot.model.nv
    ways = [pin.difference(model, *pair) for pair in pairwise(q)]
    slopes = [pin.dDifference(model, *pair, to_end) for pair in pairwise(q)]
    whole, by_end = np.reshape(ways, (-1, size)), np.reshape(slopes, (-1, size, size))
    first = steps[:, None] * v[:-1]
    last = steps[:, None] * (by_end @ v[1:, :, None])[:, :, 0]
    return np.stack([first, 3 * whole - 2 * first - last, first + last - 2 * whole], axis=1)


def slides(robot: Robot) -> Array:
    """Return 1 for each prismatic joint and 0 for each revolute one. Shape (all,)."""
    return np.asarray(robot.tree.slides.any(axis=1), np.float64)


class Seen(NamedTuple):
    """Where the robot is at some steps, each once."""

    q: Array  # shape (configurations, 7 + joints)
    times: Array  # shape (configurations,) [s]
    placed: Placed
    rows: Indices  # the configuration of each step

    def poses(self, bodies: Indices) -> tuple[Array, Array]:
        """Return rotations and positions of bodies, one at each step."""
        return self.placed.rotations[self.rows, bodies], self.placed.positions[self.rows, bodies]


def seen_at(robot: Robot, motion: FollowedMotion, steps: Array) -> Seen:
    """Return where the robot is at steps, points or parts of the way between two."""
    different, rows = np.unique(steps, return_inverse=True)
    if not (different % 1.0).any():
        placed, which = _placed_at_points(robot, motion), different.astype(np.intp)
        return Seen(
            motion.q[which], motion.time[which], Placed(*(each[which] for each in placed)), rows
        )
    q = _between(robot, motion.q, cubics_of(robot, motion), different)
    return Seen(q, times_at(motion, different), placed_bodies(robot, q[:, 7:]), rows)


@lru_cache(maxsize=4)
def _placed_at_points(robot: Robot, motion: FollowedMotion) -> Placed:
    return placed_bodies(robot, motion.q[:, 7:])


def times_at(motion: FollowedMotion, steps: Array) -> Array:
    """Return the times of steps, points or parts of the way between two [s]."""
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


def pair_ways(robot: Robot, motion: FollowedMotion) -> Array:
    """Return bounds of pairs' relative displacement in each interval. (points - 1, pairs) [m]."""
    return np.asarray(_axes(robot, motion).rates[:, 2:] @ pair_reaches(robot), np.float64)


def body_ways(robot: Robot, motion: FollowedMotion) -> Array:
    """Return bounds of the bodies' displacement in each interval. (points - 1, bodies) [m]."""
    moving, turning, joints = np.split(_axes(robot, motion).rates, [1, 2], axis=1)
    of_base = moving + turning * base_reaches(robot)
    return np.asarray(of_base + joints @ body_reaches(robot), np.float64)


def pair_bends(
    robot: Robot, motion: FollowedMotion, which: Indices, begin: Array, end: Array
) -> Array:
    """Return bounds of the second derivative of bodies' points, seen from a pair's other body.

    It is by the part of the way from begin to end.

    Args:
        which: Number of each row's pair. Shape (rows,).
        begin: First step of each row. Shape (rows,).
        end: Last step of each row, in the same interval. Shape (rows,).

    Returns:
        Of the second body seen from the first, then of the first from the second. (2, rows) [m].
    """
    first, second = (side[which] for side in pairs(robot))
    axes, turns = _axes_between(robot, motion, begin, end), 1.0 - slides(robot)
    found, joint = [], np.arange(robot.tree.joints)
    for seen_from, seen in ((first, second), (second, first)):
        inwards, outwards = (carries(robot)[:, side].T for side in (seen_from, seen))
        between = inwards != outwards
        rates, changes = (each[:, 2:] * between for each in axes)
        # From one body to the base as far as need be, then to the other.
        way_in = np.where(between & (outwards == 1.0), len(joint) + joint, -joint)
        only_out = ~(between & (inwards == 1.0)).any(axis=1)[:, None]
        order = np.argsort(np.where(only_out, joint, way_in), axis=1)
        levers = reaches(robot)[:, seen].T
        rates, changes, levers = (
            np.take_along_axis(one, order, axis=1) for one in (rates, changes, levers)
        )
        found.append(_bends(rates, changes, levers, turns[order]))
    return np.array(found)


def bends_beside(
    robot: Robot,
    motion: FollowedMotion,
    around: Surroundings,
    which: Indices,
    begin: Array,
    end: Array,
    apart: Array,
) -> Array:
    """Return bounds of the second derivative of bodies' and obstacles' points; see `pair_bends`.

    From the body, an obstacle's point is at most as far from each joint as the body's farthest
    point, the distance of both and the obstacle's size together.

    Args:
        which: Body times the number of obstacles, plus obstacle, of each row. Shape (rows,).
        begin: First step of each row. Shape (rows,).
        end: Last step of each row, in the same interval. Shape (rows,).
        apart: Largest distance of both on the way, not negative. Shape (rows,) [m].

    Returns:
        Of the obstacle seen from the body, then of the body from the obstacle. (2, rows) [m].
    """
    body, obstacle = np.divmod(which, len(around.obstacles))
    speed, acceleration, turn, reach, size = around.bounds[:, obstacle]
    step = times_at(motion, end) - times_at(motion, begin)
    one = np.ones(len(which))
    before, through = turn * step, np.column_stack([one, one, movers(robot)[:, body].T])
    rates, changes = (each * through for each in _axes_between(robot, motion, begin, end))
    rates[:, 0] += speed * step
    changes[:, 0] += acceleration * step**2
    turns = np.array([0.0, 1.0, *(1.0 - slides(robot))])
    levers = np.column_stack([one, base_reaches(robot)[body], body_reaches(robot)[:, body].T])
    back = _bends_back(rates, changes, levers + (apart + size)[:, None] * turns, turns)
    # The obstacle's own rotation is the first axis that is seen from it.
    beside = reach + apart + 2 * radii(robot)[body]
    out = _bends(
        np.column_stack([before, rates]),
        np.column_stack([before**2, changes]),
        np.column_stack([beside, levers]),
        np.array([1.0, *turns]),
    )
    return np.array([back, out])


class _Axes(NamedTuple):
    """Bounds of the rates of all axes by s and of their derivatives, each (points - 1, axes).

    The axes are the base's displacement [m], its rotation and all joints [rad, m]; s is the part of
    an interval.
    """

    rates: Array
    changes: Array


def _axes_between(robot: Robot, motion: FollowedMotion, begin: Array, end: Array) -> _Axes:
    """Return the bounds by the part of the way from begin to end of each row. (rows, axes)."""
    rates, changes = (each[begin.astype(np.intp)] for each in _axes(robot, motion))
    part = (end - begin)[:, None]
    return _Axes(part * rates, part**2 * changes)


@lru_cache(maxsize=4)
def _axes(robot: Robot, motion: FollowedMotion) -> _Axes:
    """Return the bounds; the base's place is R_0 V(phi) nu, its twist (nu, phi)."""
    cubics = cubics_of(robot, motion)
    rates = np.array([1.0, 2.0, 3.0]) @ np.abs(cubics)
    # Linear in s, and so largest at an end.
    changes = np.abs([2.0 * cubics[:, 1], 2.0 * cubics[:, 1] + 6.0 * cubics[:, 2]]).max(axis=0)
    way = np.linalg.norm(np.abs(cubics[:, :, :3]).sum(axis=1), axis=1)
    moving, turning, faster, tumbling = np.linalg.norm(
        np.hstack([rates[:, :6], changes[:, :6]]).reshape(-1, 4, 3), axis=2
    ).T
    # V changes by half the rate of the angle, and what turns by an axis that turns, too.
    changed = faster + turning * moving + (tumbling + turning**2) / 2 * way
    return _Axes(
        np.column_stack([moving + turning * way / 2, turning, robot.tree.sizes(rates[:, 6:])]),
        np.column_stack([changed, tumbling + turning**2 / 2, robot.tree.sizes(changes[:, 6:])]),
    )


def _bends(rates: Array, changes: Array, levers: Array, turns: Array) -> Array:
    """Return the bound of this file's first lines. Shape (rows,) [m].

    Args:
        rates: Shape (rows, axes).
        changes: Of the rates, by s. Shape (rows, axes).
        levers: 1 for an axis that slides. Shape (rows, axes) [m].
        turns: 1 for an axis that turns, 0 for one that slides. Shape (axes,), or as of rates.
    """
    turning = rates * turns
    before = np.cumsum(turning, axis=1) - turning
    bends: Array = (levers * (changes + rates * (turning + 2 * before))).sum(axis=1)
    return bends


def _bends_back(rates: Array, changes: Array, levers: Array, turns: Array) -> Array:
    """Return the bound for a chain that begins with the last of the axes; see `_bends`."""
    return _bends(rates[:, ::-1], changes[:, ::-1], levers[:, ::-1], turns[::-1])
