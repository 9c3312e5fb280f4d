"""Bounds of the bodies' displacement per motion of a joint or rotation of the base.

They are levers [m per rad] of revolute joints and of the base, and 1 [m per m] of prismatic joints.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.bodies import carriers, kinds_and_sizes, pairs
from ff_planner_ros.robot.collision.lines import BEYOND_LIMITS
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

    Shape (joints, pairs) [m per rad, m per m].
    """
    sides, carried = pairs(robot), carriers(robot)
    inner, outer = np.sort([carried[side] for side in sides], axis=0)
    order = np.argsort([carried[side] for side in sides], axis=0)
    before, behind = np.take_along_axis(np.array(sides), order, axis=0)
    joint = np.arange(robot.joints)[:, None]
    nearer = np.minimum(reaches_back(robot)[:, before], body_reaches(robot)[:, behind])
    return np.where((inner <= joint) & (joint < outer), nearer, 0.0)


@kept_with_it
def body_reaches(robot: Robot) -> Array:
    """Return bounds of the distance of a body's points from each joint that moves the body.

    For the last that carries it it is the distance from the axis. 1 for prismatic joints, zero for
    joints beyond the body. Shape (joints, bodies) [m per rad, m per m].
    """
    along, reaches = _stretched(robot), np.zeros((robot.joints, len(robot.bodies)))
    for number, body in enumerate(_outlines(robot)):
        carried = robot.bodies[number].joint - 1
        if carried:
            reaches[:carried, number] = along[carried] - along[1 : carried + 1] + body.farthest()
            reaches[carried - 1, number] = body.farthest(axis=robot.joint_axes[carried - 1])
            reaches[:carried, number] = np.where(
                _slid(robot)[:carried] > 0.0, 1.0, reaches[:carried, number]
            )
        if robot.bodies[number].stretches:
            reaches[carried, number] = 1.0
    return reaches


@kept_with_it
def base_reaches(robot: Robot) -> Array:
    """Return how far any point of a body is at most from the base. Shape (bodies,) [m]."""
    farthest = [body.farthest() for body in _outlines(robot)]
    return np.asarray(_stretched(robot)[carriers(robot)] + farthest, np.float64)


@kept_with_it
def reaches_back(robot: Robot) -> Array:
    """Return how far any point of a body is at most from each joint beyond it.

    Of the first of them it is the distance from the axis. 1 for prismatic joints, zero for joints
    that carry the body. Shape (joints, bodies) [m per rad, m per m].
    """
    along, reaches = _stretched(robot), np.zeros((robot.joints, len(robot.bodies)))
    for number, body in enumerate(_outlines(robot)):
        carried = robot.bodies[number].joint - 1
        if carried < robot.joints:
            joint = robot.model.jointPlacements[2 + carried]
            farthest = body.farthest(joint.translation)
            farthest += _slid(robot)[carried]
            reaches[carried:, number] = along[carried + 1 :] - along[carried + 1] + farthest
            axis = joint.rotation @ robot.joint_axes[carried]
            reaches[carried, number] = body.farthest(joint.translation, axis)
            reaches[carried:, number] = np.where(
                _slid(robot)[carried:] > 0.0, 1.0, reaches[carried:, number]
            )
    return reaches


def _stretched(robot: Robot) -> Array:
    """Return the distances of base and joints along the stretched arm. Shape (joints + 1,) [m].

    Prismatic joints are at their furthest.
    """
    placements = robot.model.jointPlacements[2:]
    lengths = [float(np.linalg.norm(at.translation)) for at in placements]
    return np.cumsum([0.0, *(lengths + _slid(robot))])


def _slid(robot: Robot) -> Array:
    """Return how far each joint slides from zero at most; zero if it turns. Shape (joints,) [m]."""
    return robot.furthest_slides + BEYOND_LIMITS * robot.joint_slides.any(axis=1)


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
    for body, kind, sizes in zip(robot.bodies, *kinds_and_sizes(robot), strict=True):
        if body.stretches:
            end, furthest = 2 * body.center_in_joint, _slid(robot)[body.joint - 1]
            slid = furthest * body.slide_in_joint
            ends = np.array([np.zeros(3), end + slid, end - slid])
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
