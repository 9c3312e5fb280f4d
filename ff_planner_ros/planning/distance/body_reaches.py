"""Bounds of the bodies' displacement per motion of a joint or rotation of the base.

They are levers [m per rad] of revolute joints and of the base, and 1 [m per m] of prismatic joints.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.bodies import (
    carriers,
    carries,
    kinds_and_sizes,
    pairs,
    stretching,
)
from ff_planner_ros.robot.collision.lines import slid
from ff_planner_ros.robot.collision.primitives import Kind
from ff_planner_ros.robot.kept_with import kept_with_it
from ff_planner_ros.robot.model import Robot

# A cylinder, or a cone in it, is in the prism around it; one of so many sides is hardly thicker.
_SIDES = 16


@kept_with_it
def pair_reaches(robot: Robot) -> Array:
    """Return how far each joint moves the bodies of each pair relative to each other at most.

    The nearest points of both lie on one line along the normal. A joint between them changes the
    distance equally by whichever body it is said to move: the one with the shorter lever bounds it.

    Shape (all, pairs) [m per rad, m per m].
    """
    first, second = pairs(robot)
    nearer = np.minimum(reaches(robot)[:, first], reaches(robot)[:, second])
    return np.where(carries(robot)[:, first] != carries(robot)[:, second], nearer, 0.0)


@kept_with_it
def reaches(robot: Robot) -> Array:
    """Return how far any point of a body is at most from each joint, as the next two have it."""
    return np.where(carries(robot) == 1.0, body_reaches(robot), reaches_back(robot))


@kept_with_it
def body_reaches(robot: Robot) -> Array:
    """Return bounds of the distance of a body's points from each joint that moves the body.

    For the last that carries it it is the distance from the axis. 1 for prismatic joints, zero for
    joints that do not move the body. Shape (all, bodies) [m per rad, m per m].
    """
    along, found = _stretched(robot), np.zeros((robot.tree.joints, len(robot.bodies)))
    for number, body in enumerate(_outlines(robot)):
        carried = carriers(robot)[number]
        moving = np.flatnonzero(robot.tree.moves[:, carried])
        if carried:
            found[moving, number] = along[carried] - along[1 + moving] + body.farthest()
            found[carried - 1, number] = body.farthest(axis=robot.tree.axes[carried - 1])
            found[moving, number] = np.where(slid(robot)[moving] > 0.0, 1.0, found[moving, number])
        if robot.bodies[number].stretches:
            found[stretching(robot)[number], number] = 1.0
    return found


@kept_with_it
def base_reaches(robot: Robot) -> Array:
    """Return how far any point of a body is at most from the base. Shape (bodies,) [m]."""
    farthest = [body.farthest() for body in _outlines(robot)]
    return np.asarray(_stretched(robot)[carriers(robot)] + farthest, np.float64)


@kept_with_it
def reaches_back(robot: Robot) -> Array:
    """Return how far any point of a body is at most from each joint that does not carry it.

    Of the first of those that the body carries it is the distance from the axis. 1 for prismatic
    joints, zero for joints that carry the body. Shape (all, bodies) [m per rad, m per m].
    """
    tree, along, slides = robot.tree, _stretched(robot), slid(robot)
    found = np.zeros((tree.joints, len(robot.bodies)))
    for number, body in enumerate(_outlines(robot)):
        carried = carriers(robot)[number]
        for k in np.flatnonzero(~tree.moves[:, carried]).tolist():
            own = np.flatnonzero(tree.moves[:, k + 1] & ~tree.moves[:, carried]).tolist()[0]
            first = tree.before[own]  # the body that carries both
            if slides[k] > 0.0:
                found[k, number] = 1.0
            elif first != carried:
                aside = along[k + 1] + along[carried] - 2.0 * along[first]
                found[k, number] = aside + body.farthest()
            else:
                joint = robot.model.jointPlacements[2 + own]
                farthest = body.farthest(joint.translation)
                farthest += slides[own]
                found[k, number] = along[k + 1] - along[own + 1] + farthest
                if k == own:
                    axis = joint.rotation @ tree.axes[k]
                    found[k, number] = body.farthest(joint.translation, axis)
    return found


def _stretched(robot: Robot) -> Array:
    """Return the distances of base and joints along the stretched arm. Shape (all + 1,) [m].

    Prismatic joints are at their furthest.
    """
    found, slides = np.zeros(robot.tree.joints + 1), slid(robot)
    for k, placement in enumerate(robot.model.jointPlacements[2:]):
        length = float(np.linalg.norm(placement.translation)) + slides[k]
        found[k + 1] = found[robot.tree.before[k]] + length
    return found


class _Outline:
    """Points that have a body in their hull, in the frame of the joint that carries it."""

    def __init__(self, points: Array, radius: float) -> None:
        self._points, self._radius = points, radius  # the body may be thicker by the radius [m]

    def farthest(self, origin: Array | None = None, axis: Array | None = None) -> float:
        """Return how far a point is at most from an origin, or from an axis through it [m].

        Args:
            origin: None: that of the frame.
        """
        seen = self._points if origin is None else self._points - origin
        away = seen if axis is None else np.cross(seen, axis)
        return float(np.linalg.norm(away, axis=1).max()) + self._radius


@kept_with_it
def _outlines(robot: Robot) -> tuple[_Outline, ...]:
    found = []
    each = zip(robot.bodies, *kinds_and_sizes(robot), strict=True)
    for number, (body, kind, sizes) in enumerate(each):
        if body.stretches:
            end, furthest = 2 * body.center_in_joint, slid(robot)[stretching(robot)[number]]
            way = furthest * body.slide_in_joint
            ends = np.array([np.zeros(3), end + way, end - way])
            found.append(_Outline(ends, 0.0))
            continue
        if kind == Kind.HULL:
            points = np.asarray(body.solid.points())
        elif kind not in (Kind.ROUND, Kind.CYLINDER, Kind.CONE):
            points = sizes * list(product((1.0, -1.0), repeat=3))
        else:
            radius, half_length, _ = sizes
            has_rim = kind in (Kind.CYLINDER, Kind.CONE)
            thick = radius / np.cos(np.pi / _SIDES) if has_rim else 0.0
            angles = 2 * np.pi / _SIDES * np.arange(_SIDES)
            ring = thick * np.column_stack([np.cos(angles), np.sin(angles)])
            points = np.array([(*at, end) for at in ring for end in (half_length, -half_length)])
        at = body.placement_in_joint
        radius = sizes[0] if kind == Kind.ROUND else 0.0
        found.append(_Outline(points @ at.rotation.T + at.translation, float(radius)))
    return tuple(found)
