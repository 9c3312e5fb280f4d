"""A lower bound of the clearance along a whole motion, between its points too."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pinocchio as pin

from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.problem import Sphere
from ff_planner_ros.robot.model import Robot

# The certified clearance is below the true one by at most this [m]: thinner than paint, and a
# quarter of the default margin.
CERTIFICATE_GAP = 5e-4
# Part of the way between two points that is not halved further: rounding is all that is left.
SHORTEST_PIECE = 1e-12


def certified_clearance(
    robot: Robot, q: Array, v: Array, times: Array, spheres: Sequence[Sphere]
) -> float:
    """Return a lower bound of the clearance along the whole motion, between the points too.

    Between two points the motion is the cubic through both configurations and velocities. In a
    piece of it no point of the arm moves further than its speed allows, nor does a sphere, so the
    distance of both is at least the mean of both ends' less half both ways. Pieces whose bound is
    too low to tell are halved. The bound is within `CERTIFICATE_GAP` of the truth.

    Args:
        q: Configurations. Shape (points, 7 + joints).
        v: Tangent velocities. Shape (points, 6 + joints).
        times: Of the points, from the plan's first on. Shape (points,) [s].

    Returns:
        Clearance [m]; infinite without spheres.
    """
    if not spheres:
        return np.inf
    steps = np.diff(times)
    positions = arm_points(robot, q)
    starts = segments(positions)
    by_sphere = clearances(positions, times, starts, spheres).distance.min(axis=1)
    cubics = cubics_between(robot, q, v, steps)
    speeds = np.array([sphere.highest_speed for sphere in spheres])
    # Of arm and sphere together, from each point to the next. Shape (points - 1, spheres).
    ways = way_bounds(positions[0], q[0], cubics)[:, None] + steps[:, None] * speeds
    index, begin, end = np.arange(len(cubics)), np.zeros(len(cubics)), np.ones(len(cubics))
    lowest = certified = float(by_sphere.min())
    # What no step can bring nearer than the nearest point need not be looked at again.
    reachable = by_sphere.min(axis=0) <= lowest + ways.max(axis=0)
    spheres = [sphere for sphere, keep in zip(spheres, reachable, strict=True) if keep]
    # Each of shape (pieces, spheres): a fast one that is far away is not looked at closely.
    ways, at_begin, at_end = ways[:, reachable], by_sphere[:-1, reachable], by_sphere[1:, reachable]
    while True:
        part = end - begin
        bound = ((at_begin + at_end - ways[index] * part[:, None]) / 2).min(axis=1)
        open_ = (bound < lowest - CERTIFICATE_GAP) & (part > SHORTEST_PIECE)
        certified = min(certified, float(bound[~open_].min(initial=np.inf)))
        if not open_.any():
            return certified
        index, begin, end = index[open_], begin[open_], end[open_]
        middle = (begin + end) / 2
        powers = middle[:, None] ** np.array([1, 2, 3])
        moved = np.einsum("ip,ipj->ij", powers, cubics[index])
        between = np.array(
            [pin.integrate(robot.model, *at) for at in zip(q[index], moved, strict=True)]
        )
        then = times[index] + middle * steps[index]
        at_middle = clearances(arm_points(robot, between), then, starts, spheres).distance
        at_middle = at_middle.min(axis=1)
        lowest = min(lowest, float(at_middle.min()))
        index = np.concatenate([index, index])
        begin, end = np.concatenate([begin, middle]), np.concatenate([middle, end])
        at_begin = np.concatenate([at_begin[open_], at_middle])
        at_end = np.concatenate([at_middle, at_end[open_]])


def cubics_between(robot: Robot, q: Array, v: Array, steps: Array) -> Array:
    """Return the tangent-space cubics through consecutive configurations and velocities.

    Returns:
        Coefficients of s, s^2, s^3 from one to the next, s from 0 to 1. Shape
        (points - 1, 3, 6 + joints).
    """
    whole = np.array([pin.difference(robot.model, *pair) for pair in pairwise(q)])
    first, last = steps[:, None] * v[:-1], steps[:, None] * v[1:]
    turned = np.array([pin.Jexp6(pin.Motion(way[:6])) for way in whole])
    last[:, :6] = np.linalg.solve(turned, last[:, :6, None])[:, :, 0]
    return np.stack([first, 3 * whole - 2 * first - last, first + last - 2 * whole], axis=1)


def way_bounds(positions: Array, q: Array, cubics: Array) -> Array:
    """Return a speed for each cubic that no point of the arm exceeds along it [m per unit of s].

    Each joint, and the base's turn, move a point at most at their rate times the stretched
    length of what lies beyond them.
    """
    lengths = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    beyond = np.cumsum(lengths[::-1])[::-1]
    reach = np.linalg.norm(positions[0] - q[:3]) + beyond[0]
    rates = np.array([1.0, 2.0, 3.0]) @ np.abs(cubics)
    # The base's linear rate belongs to an axis that turns on the way, by at most `way`.
    way = np.linalg.norm(np.abs(cubics[:, :, :3]).sum(axis=1), axis=1)
    moving, turning = (np.linalg.norm(part, axis=1) for part in np.split(rates[:, :6], 2, axis=1))
    bounds: Array = moving + turning * (reach + way / 2) + rates[:, 6:] @ beyond
    return bounds
