"""Lower bounds of the clearance of the centre lines along a whole motion, between points too."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.allowed_contact import split_obstacles, split_spheres
from ff_planner_ros.planning.distance.clearance import (
    arm_points,
    centers_at,
    clearances,
    highest_speeds,
    may_be_nearest,
    segments,
)
from ff_planner_ros.planning.distance.start_room import (
    KEPT,
    room_of_bodies,
    room_of_lines,
    room_of_obstacles,
)
from ff_planner_ros.planning.problem.problem import Obstacle, PlanningProblem
from ff_planner_ros.robot.model import Robot

# The search's certificate and those of bodies are below the truth by at most this [m]: thinner than
# paint, and a quarter of the default margin.
CERTIFICATE_GAP = 5e-4
# The check's certified clearance of lines is below the truth by at most this [m].
LINES_GAP = 1e-4
# A certificate may be below the truth by this fraction of the distance at the start.
_GAP = 0.25
# Number of parts that an interval is cut into: one call for several is cheaper than two calls.
_PIECES = 4
_CUTS = np.arange(_PIECES + 1)[:, None] / _PIECES
# Fraction of an interval between points that is not cut further: the rest is rounding.
SHORTEST_PIECE = 1e-12
# Pieces that are looked at: a motion that needs more, no arm makes, and the bound is lower.
_MOST_PIECES = 1 << 20
_TINY = np.finfo(float).tiny


def certificate_gap(problem: PlanningProblem, most: float = CERTIFICATE_GAP) -> float:
    """Return how far certificates may be below the truth for the start to pass [m].

    Args:
        most: The answer if no obstacle is near the start, or one is touched [m].
    """
    near = start_clearance(problem)
    return min(most, _GAP * near) if near > 0.0 else most  # a start in contact is refused


@lru_cache(maxsize=4)
def start_clearance(problem: PlanningProblem) -> float:
    """Return the distance from the nearest obstacle at the start, without allowed contacts [m]."""
    if problem.robot.bodies:
        spheres = room_of_bodies(problem).ravel()[split_spheres(problem).apart]
    else:
        spheres = room_of_lines(problem).ravel()
    others = room_of_obstacles(problem).ravel()[split_obstacles(problem).apart]
    return float(np.concatenate([spheres, others]).min(initial=np.inf)) / KEPT


def certified_clearance(
    robot: Robot,
    q: Array,
    v: Array,
    times: Array,
    spheres: Sequence[Obstacle],
    positions: Array | None = None,
    gap: float = LINES_GAP,
) -> float:
    """Return a lower bound of the clearance along the whole motion, between the points too.

    Between two points the motion is the cubic through both configurations and velocities. On an
    interval of it there are two bounds. Arm and sphere move at most by their speed bounds, so the
    distance is at least the mean of both ends' less half of both displacements. And the distance is
    no more convex than speeds and accelerations allow, so it is at least a parabola through both
    ends. Intervals whose better bound is too low to decide are cut further.

    Args:
        q: Configurations. Shape (points, 7 + joints).
        v: Tangent velocities. Shape (points, 6 + joints).
        times: Of the points, from the plan's first on. Shape (points,) [s].
        positions: Of `arm_points`. None: they are computed.
        gap: How far the bound may be below the truth [m].

    Returns:
        Clearance [m], within the gap of the truth unless the motion is too fast to tell; infinite
        without spheres.
    """
    if not spheres:
        return np.inf
    steps = np.diff(times)
    positions = arm_points(robot, q) if positions is None else positions
    starts = segments(positions)
    cubics = cubics_between(robot, q, v, steps)
    arm = slides(robot), positions[0], q[0], cubics
    way = way_bounds(*arm)
    moved = way.max() + steps.max() * highest_speeds(spheres)
    spheres = may_be_nearest(positions, times, starts, spheres, moved)
    centers = centers_at(times, spheres)
    by_sphere = clearances(positions, times, starts, spheres, centers).distance.min(axis=1)
    speeds = highest_speeds(spheres)
    changes = np.array([sphere.motion.highest_acceleration(0.0) for sphere in spheres])
    # Of arm and sphere together, in each interval. Shape (points - 1, spheres).
    ways = way[:, None] + steps[:, None] * speeds
    bends = bend_bounds(*arm)[:, None] + steps[:, None] ** 2 * changes
    # Nothing is faster than on the whole way from point to point by more than half of the bend.
    whole = np.diff(positions[:, :, None] - centers[:, None], axis=0)
    ways = np.minimum(ways, np.linalg.norm(whole, axis=-1).max(axis=1) + bends / 2)
    lowest = certified = float(by_sphere.min())
    # What no step can bring nearer than the nearest point need not be looked at again.
    near = by_sphere.min(axis=0) <= lowest + ways.max(axis=0)
    spheres = [sphere for sphere, keep in zip(spheres, near, strict=True) if keep]
    radii = np.array([sphere.radius for sphere in spheres])
    # Each of shape (cubics, spheres): a fast one that is far away is not looked at closely.
    at_begin, at_end = by_sphere[:-1, near], by_sphere[1:, near]
    ways, bends = ways[:, near], bends[:, near]
    index, begin, end = np.arange(len(cubics)), np.zeros(len(cubics)), np.ones(len(cubics))
    looked = 0
    while True:
        part = (end - begin)[:, None]
        bound = _lower_bounds(at_begin, at_end, ways[index] * part, bends[index] * part**2, radii)
        bound = bound.min(axis=1)
        open_ = (bound < lowest - gap) & (end - begin > SHORTEST_PIECE) & (looked < _MOST_PIECES)
        looked += len(index)
        certified = min(certified, float(bound[~open_].min(initial=np.inf)))
        if not open_.any():
            return certified
        index, begin, end = index[open_], begin[open_], end[open_]
        ends = begin + _CUTS * (end - begin)
        inside, which = ends[1:-1].ravel(), np.tile(index, _PIECES - 1)
        moved = np.einsum("ip,ipj->ij", inside[:, None] ** np.array([1, 2, 3]), cubics[which])
        between = np.array(
            [pin.integrate(robot.model, *at) for at in zip(q[which], moved, strict=True)]
        )
        then = times[which] + inside * steps[which]
        found = clearances(arm_points(robot, between), then, starts, spheres).distance.min(axis=1)
        lowest = min(lowest, float(found.min()))
        found = found.reshape(_PIECES - 1, len(index), -1)
        at_ends = np.concatenate([at_begin[None, open_], found, at_end[None, open_]])
        index, begin, end = np.tile(index, _PIECES), ends[:-1].ravel(), ends[1:].ravel()
        at_begin, at_end = (each.reshape(len(index), -1) for each in (at_ends[:-1], at_ends[1:]))


def _lower_bounds(at_begin: Array, at_end: Array, ways: Array, bends: Array, radii: Array) -> Array:
    """Return lower bounds of the distances on intervals.

    For a point at x from a sphere's centre, |x|'' = (|x'|^2 - (x' x / |x|)^2) / |x| + x'' x / |x|,
    which is not above way^2 / |x| + bend. The distance of the arm is the least over its points, and
    thus not below the parabola through both ends that is curved as much as the most curved of them.

    Args:
        at_begin: Distances, each of one piece and sphere. Shape (pieces, spheres) [m].
        at_end: As at_begin.
        ways: How far arm and sphere move at most, together, on a piece. Same shape [m].
        bends: Their second derivative at most, by the part of the piece. Same shape [m].
        radii: Of the spheres. Shape (spheres,) [m].
    """
    first = (at_begin + at_end - ways) / 2
    with np.errstate(over="ignore"):  # infinite where the arm may come to the centre
        curvature = ways**2 / np.maximum(radii + first, _TINY) + bends
    bounds: Array = np.maximum(first, parabola_bounds(at_begin, at_end, curvature))
    return bounds


def parabola_bounds(at_begin: Array, at_end: Array, curvature: Array) -> Array:
    """Return the least values, from begin to end, of parabolas through values at both.

    Args:
        at_begin: Values at the begin. Any shape.
        at_end: As at_begin.
        curvature: Second derivative by the part of the way, not negative. Same shape.
    """
    rise, curvature = at_end - at_begin, curvature + _TINY
    with np.errstate(over="ignore"):
        vertex = (at_begin + at_end) / 2 - curvature / 8 - rise * (rise / curvature) / 2
    return np.where(2 * np.abs(rise) < curvature, vertex, np.minimum(at_begin, at_end))


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
    """Return 1 for each prismatic joint and 0 for each revolute one. Shape (joints,)."""
    return np.asarray(robot.joint_slides.any(axis=1), np.float64)


def way_bounds(slides: Array, positions: Array, q: Array, cubics: Array) -> Array:
    """Return an upper bound of the arm's speed along each cubic [m per unit of s].

    Revolute joints, and the base's rotation, move a point at most at their rate times the stretched
    length beyond them; a prismatic joint moves it at its rate.

    Args:
        slides: As of `slides`.
        positions: Of `arm_points` at the first point. Shape (joints + 1, 3) [m].
        q: Configuration there. Shape (7 + joints,).
        cubics: Of `cubics_between`.
    """
    to_first, *lengths = _lengths(slides, positions, q, cubics)
    beyond = np.cumsum(lengths[::-1])[::-1]
    reach = to_first + beyond[0]
    beyond = np.where(slides > 0.0, 1.0, beyond)
    rates = np.array([1.0, 2.0, 3.0]) @ np.abs(cubics)
    # The base's linear rate belongs to an axis that turns on the way, by at most `way`.
    way = np.linalg.norm(np.abs(cubics[:, :, :3]).sum(axis=1), axis=1)
    moving, turning = np.linalg.norm(rates[:, :6].reshape(-1, 2, 3), axis=2).T
    bounds: Array = moving + turning * (reach + way / 2) + rates[:, 6:] @ beyond
    return bounds


def bend_bounds(slides: Array, positions: Array, q: Array, cubics: Array) -> Array:
    """Return an upper bound of the second derivative by s of the arm's points along each cubic [m].

    With W and S the sums, from the base to a link, of the joints' first and second derivatives, the
    link rotates at W at most, and W changes by S + W^2 / 2 at most, the second term from the
    rotation of the axes. A link of length l adds l (S + 3/2 W^2); one that slides out at u, which
    changes by a, adds 2 W u + a. The base's place is R_0 V(phi) nu, its twist (nu, phi). The
    arguments are those of `way_bounds`.
    """
    lengths = _lengths(slides, positions, q, cubics)
    rates, changes = (np.array(of) @ np.abs(cubics) for of in ([1.0, 2.0, 3.0], [0.0, 2.0, 6.0]))
    way = np.linalg.norm(np.abs(cubics[:, :, :3]).sum(axis=1), axis=1)
    moving, turning, faster, tumbling = np.linalg.norm(
        np.hstack([rates[:, :6], changes[:, :6]]).reshape(-1, 4, 3), axis=2
    ).T
    of_base = faster + turning * moving + (tumbling + turning**2) / 2 * way
    summed, changed = (
        np.cumsum(np.column_stack(each), axis=1)
        for each in (
            (turning, (1.0 - slides) * rates[:, 6:]),
            (tumbling, (1.0 - slides) * changes[:, 6:]),
        )
    )
    sliding = (2.0 * summed[:, :-1] * rates[:, 6:] + changes[:, 6:]) @ slides
    bounds: Array = of_base + (changed + 1.5 * summed**2) @ lengths + sliding
    return bounds


def _lengths(slides: Array, positions: Array, q: Array, cubics: Array) -> Array:
    """Return how long each link is at most: up to each joint, then to the end effector [m].

    One that a joint slides along is longer than at the first point by what it slides from there.
    """
    lengths: Array = np.linalg.norm(np.diff(positions, axis=0, prepend=q[None, :3]), axis=1)
    if slides.any():
        moved = cubics[:, :, 6:]
        begin = np.cumsum(moved.sum(axis=1), axis=0) - moved.sum(axis=1)
        lengths[:-1] += slides * (np.abs(begin) + np.abs(moved).sum(axis=1)).max(axis=0)
    return lengths
