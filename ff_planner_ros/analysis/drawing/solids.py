"""Surfaces of triangles: of spheres, boxes, cylinders, capsules, cones, hulls, and a whole robot.

Corners have shape (corners, 3) [m], triangles shape (triangles, 3) with the numbers of corners.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import TypeAlias

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.collision.primitives import PRIMITIVES
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.shapes import link_shapes

Triangles: TypeAlias = NDArray[np.intp]

# Corners of a circle: of a link, many of which are drawn at many times.
_AROUND_LINK = 12

# The chaser's colour, and those of what the joints carry, in turn.
_CHASER = "#8c8c8c"
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")


@dataclass(frozen=True, eq=False)
class RobotSurface:
    """A robot's surface, each corner in the frame of the joint that carries it."""

    corners: Array
    triangles: Triangles
    joints: NDArray[np.intp]  # Pinocchio's number of the joint of each corner; shape (corners,)


def sphere(meridians: int) -> tuple[Array, Triangles]:
    """Return the unit sphere."""
    parallels = meridians // 2
    polar, azimuth = np.meshgrid(
        np.linspace(0.0, np.pi, parallels + 1),
        np.linspace(0.0, 2 * np.pi, meridians, endpoint=False),
        indexing="ij",
    )
    unit = [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
    corners = np.stack(unit, axis=-1).reshape(-1, 3)
    row, column = np.divmod(np.arange(parallels * meridians), meridians)
    here, right = row * meridians + column, row * meridians + (column + 1) % meridians
    below, below_right = here + meridians, right + meridians
    upper, lower = np.stack([here, below, right], 1), np.stack([right, below, below_right], 1)
    return corners, np.concatenate([upper, lower])


def box(edges: tuple[float, ...]) -> tuple[Array, Triangles]:
    """Return a box about the origin."""
    corners = np.array(list(product((-0.5, 0.5), repeat=3))) * edges
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    halves = [half for a, b, c, d in faces for half in ((a, b, c), (a, c, d))]
    return corners, np.array(halves)


def cylinder(radius: float, length: float, around: int) -> tuple[Array, Triangles]:
    """Return a cylinder about the z axis, its middle in the origin."""
    angle = np.linspace(0.0, 2 * np.pi, around, endpoint=False)
    rim = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * angle], axis=1)
    half = np.array([0.0, 0.0, length / 2])
    here = np.arange(around)
    right, above, above_right = (here + 1) % around, here + around, (here + 1) % around + around
    bottom, top = 0 * here + 2 * around, 0 * here + 2 * around + 1
    triangles = [
        *((here, right, above_right), (here, above_right, above)),
        *((bottom, right, here), (top, above, above_right)),
    ]
    corners = np.concatenate([rim - half, rim + half, [-half, half]])
    return corners, np.concatenate([np.stack(three, axis=1) for three in triangles])


def capsule(radius: float, length: float, around: int) -> tuple[Array, Triangles]:
    """Return a capsule about the z axis; length: between the centres of its ends."""
    corners, triangles = sphere(2 * around)
    ends = np.where(corners[:, 2:] > 1e-9, 1.0, -1.0) * [0.0, 0.0, length / 2]
    return radius * corners + ends, triangles


def cone(radius: float, length: float, around: int) -> tuple[Array, Triangles]:
    """Return a cone about the z axis, its middle in the origin and its apex at +z."""
    corners, triangles = cylinder(radius, length, around)
    corners[around : 2 * around] = corners[-1]
    # The upper rim is the apex: what had two corners there is none.
    apex = (triangles >= around) & (triangles != 2 * around)
    return corners, triangles[apex.sum(axis=1) < 2]


def hull(solid: coal.Convex) -> tuple[Array, Triangles]:
    """Return the surface of a convex solid, its triangles oriented outwards."""
    corners = np.array(solid.points())
    triangles = np.array(
        [[solid.polygons(k)[i] for i in range(3)] for k in range(solid.num_polygons)], np.intp
    )
    a, b, c = (corners[triangles[:, k]] for k in range(3))
    inwards = np.einsum("tx,tx->t", np.cross(b - a, c - a), a - corners.mean(axis=0)) < 0.0
    triangles[inwards] = triangles[inwards][:, ::-1]
    return corners, triangles


def drawn_posture(robot: Robot) -> Array:
    """Return the configuration that a robot alone is drawn in: at zero, or the nearest limits."""
    q: Array = pin.neutral(robot.model)
    q[7:] = np.clip(q[7:], robot.lower_position_limits, robot.upper_position_limits)
    return q


def part_colour(joint: int) -> str:
    """Return the colour of what one of Pinocchio's joints carries; 1: the chaser."""
    return _CHASER if joint == 1 else _COLOURS[joint % len(_COLOURS)]


def robot_surface(robot: Robot) -> RobotSurface:
    """Return the surface of the robot's bodies, or else of its URDF's shapes; it may be empty."""
    corners, triangles, joints, count = [np.empty((0, 3))], [np.empty((0, 3), int)], [], 0
    for (surface, faces), placement, joint in robot_solids(robot):
        corners.append(surface @ placement.rotation.T + placement.translation)
        triangles.append(faces + count)
        joints += [joint] * len(surface)
        count += len(surface)
    return RobotSurface(
        np.concatenate(corners), np.concatenate(triangles), np.array(joints, np.intp)
    )


def robot_solids(robot: Robot) -> Iterator[tuple[tuple[Array, Triangles], pin.SE3, int]]:
    """Yield surfaces, their places in the joints that carry them, and these joints."""
    for body in robot.bodies:
        yield surface_of(body.solid), body.placement_in_joint, body.joint
    for shape in () if robot.bodies else link_shapes(robot.drawn_urdf):
        frame = robot.model.frames[robot.model.getFrameId(shape.link, pin.FrameType.BODY)]
        in_link = pin.SE3(np.array(shape.rotation_to_link), np.array(shape.position_in_link))
        solid = PRIMITIVES[shape.kind].made(*shape.sizes)
        yield surface_of(solid), frame.placement * in_link, frame.parentJoint


def surface_at(robot: Robot, surface: RobotSurface, q: Array) -> Array:
    """Return the corners at each configuration, in the inertial frame.

    Args:
        q: Shape (points, 7 + joints).

    Returns:
        Shape (points, corners, 3) [m].
    """
    data, placed = robot.model.createData(), np.empty((len(q), *surface.corners.shape))
    for i, q_i in enumerate(q):
        pin.forwardKinematics(robot.model, data, q_i)
        rotations = np.array([placement.rotation for placement in data.oMi])[surface.joints]
        origins = np.array([placement.translation for placement in data.oMi])[surface.joints]
        placed[i] = np.einsum("cij,cj->ci", rotations, surface.corners) + origins
    return placed


def surface_of(
    solid: coal.CollisionGeometry, around: int = _AROUND_LINK
) -> tuple[Array, Triangles]:
    """Return the surface of a solid in its own frame; a circle has `around` corners."""
    if isinstance(solid, coal.Box):
        return box(tuple((2.0 * np.asarray(solid.halfSide)).tolist()))
    if isinstance(solid, coal.Cylinder):
        return cylinder(solid.radius, 2.0 * solid.halfLength, around)
    if isinstance(solid, coal.Capsule):
        return capsule(solid.radius, 2.0 * solid.halfLength, around)
    if isinstance(solid, coal.Cone):
        return cone(solid.radius, 2.0 * solid.halfLength, around)
    if isinstance(solid, coal.Sphere):
        corners, triangles = sphere(around)
        return solid.radius * corners, triangles
    return hull(solid)
