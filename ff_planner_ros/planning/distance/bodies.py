"""Poses of the robot's bodies at given joint positions, and their kinds and sizes.

Everything here is in the base frame, that of the free-flyer joint: there, poses depend on the
joints alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.robot.collision.primitives import kind_and_sizes
from ff_planner_ros.robot.kept_with import kept_with_it
from ff_planner_ros.robot.kinematics import joint_rotations
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.quaternion import rotation_from_quaternion


class Placed(NamedTuple):
    """Poses of bodies and joints at each configuration, in the base frame."""

    rotations: Array  # of the solids; shape (configurations, bodies, 3, 3)
    positions: Array  # of the solids' own frames; shape (configurations, bodies, 3) [m]
    centers: Array  # of the bounding spheres of the bodies; likewise
    origins: Array  # of all joints; shape (configurations, all, 3) [m]
    axes: Array  # of revolute joints, unit length, zero for prismatic ones; likewise
    slides: Array  # axes of prismatic joints, unit length, zero for revolute ones; likewise
    # Of lines that end at a joint that slides, from begin to end; zero of all else; likewise [m]
    stretches: Array


def placed_bodies(robot: Robot, angles: Array) -> Placed:
    """Return the poses at joint positions; angles: shape (configurations, joints) [rad, m]."""
    count, tree = len(angles), robot.tree
    moved = tree.positions(angles)
    steps = joint_rotations(robot, moved)
    rotations = np.empty((count, tree.joints + 1, 3, 3))
    positions = np.empty((count, tree.joints + 1, 3))
    rotations[:, 0], positions[:, 0] = np.eye(3), 0.0
    for k, before in enumerate(tree.before.tolist()):
        np.matmul(rotations[:, before], steps[:, k], out=rotations[:, k + 1])
    before_joints, of_joints = rotations[:, tree.before], _joints_in_bodies(robot)
    placed, axes, slides = ((before_joints @ each[:, :, None])[..., 0] for each in of_joints)
    slid = moved[..., None] * slides
    for k, before in enumerate(tree.before.tolist()):
        positions[:, k + 1] = positions[:, before] + placed[:, k] + slid[:, k]
    carriers, placements, offsets, centers = _in_joints(robot)
    carried = rotations[:, carriers]
    stretches = np.zeros((count, len(carriers), 3))
    for number in stretched(robot):
        end, begin = stretching(robot)[number] + 1, carriers[number]
        stretches[:, number] = positions[:, end] - positions[:, begin]
    return Placed(
        rotations=carried @ placements,
        positions=positions[:, carriers] + np.einsum("cbij,bj->cbi", carried, offsets),
        centers=positions[:, carriers]
        + np.einsum("cbij,bj->cbi", carried, centers)
        + stretches / 2,
        origins=positions[:, 1:],
        axes=axes,
        slides=slides,
        stretches=stretches,
    )


def centers_in_base(q: Array, centers: Array) -> Array:
    """Return points of the inertial frame in the base frame. (configurations, points, 3) [m]."""
    turns = rotation_from_quaternion(q[:, 3:7])
    return np.asarray((centers - q[:, None, :3]) @ turns, np.float64)


@kept_with_it
def _joints_in_bodies(robot: Robot) -> tuple[Array, Array, Array]:
    """Return each joint's place [m], axis and slide in the body before it. Each of (all, 3)."""
    tree, places = robot.tree, robot.model.jointPlacements[2:]
    turns = [place.rotation for place in places]
    return (
        np.array([place.translation for place in places]),
        np.array([turn @ axis for turn, axis in zip(turns, tree.axes, strict=True)]),
        np.array([turn @ slide for turn, slide in zip(turns, tree.slides, strict=True)]),
    )


@kept_with_it
def _in_joints(robot: Robot) -> tuple[Indices, Array, Array, Array]:
    """Return the tree's body that carries each body, and its placement and centre in that."""
    bodies, at_joint = robot.bodies, pin.SE3.Identity()
    places = [at_joint if body.stretches else body.placement_in_joint for body in bodies]
    centers = [np.zeros(3) if body.stretches else body.center_in_joint for body in bodies]
    return (
        np.array([body.joint - 1 for body in bodies], np.intp),
        np.array([place.rotation for place in places]).reshape(-1, 3, 3),
        np.array([place.translation for place in places]).reshape(-1, 3),
        np.array(centers).reshape(-1, 3),
    )


def stretched(robot: Robot) -> list[int]:
    """Return the numbers of the bodies that are stretched by the joint behind them."""
    return [number for number, body in enumerate(robot.bodies) if body.stretches]


def stretching(robot: Robot) -> Indices:
    """Return the joint on the way to the tip behind each body that is on that way. (bodies,)."""
    tree = robot.tree
    behind = dict(zip(tree.before[tree.to_tip].tolist(), tree.to_tip, strict=True))
    return np.array([behind.get(one, -1) for one in carriers(robot).tolist()], np.intp)


@kept_with_it
def movers(robot: Robot) -> Array:
    """Return 1 for each joint that moves a point of a body, else 0. Shape (all, bodies)."""
    found = carries(robot).copy()
    for number in stretched(robot):
        found[stretching(robot)[number], number] = 1.0
    return found


@kept_with_it
def carries(robot: Robot) -> Array:
    """Return 1 for each joint that carries a body, else 0. Shape (all, bodies)."""
    return robot.tree.moves[:, carriers(robot)].astype(np.float64)


def carriers(robot: Robot) -> Indices:
    """Return the number of the tree's body that carries each body. Shape (bodies,)."""
    return _in_joints(robot)[0]


def radii(robot: Robot) -> Array:
    """Return the radii of the bodies' bounding spheres. Shape (bodies,) [m]."""
    return np.array([body.radius for body in robot.bodies])


def pairs(robot: Robot) -> tuple[Indices, Indices]:
    """Return the first and the second body of every pair. Shape (pairs,) each."""
    first, second = np.array(robot.pairs, np.intp).reshape(-1, 2).T
    return first, second


@kept_with_it
def kinds_and_sizes(robot: Robot) -> tuple[Indices, Array]:
    """Return kind and sizes of every body, of stretched ones those of their begin.

    Shapes (bodies,) and (bodies, 3) [m].
    """
    kinds, sizes = zip(*(kind_and_sizes(body.solid) for body in robot.bodies), strict=True)
    found = np.array(sizes)
    found[stretched(robot)] = 0.0
    return np.array(kinds, np.intp), found
