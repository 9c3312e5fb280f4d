"""The rigid parts of a stage as surfaces, with their poses at every point."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ff_planner_ros.analysis.drawing.obstacle_surfaces import obstacle_surface
from ff_planner_ros.analysis.drawing.solids import Triangles, box, robot_surface
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.console.stages import Stage
from ff_planner_ros.planning.distance.surroundings import obstacle_poses
from ff_planner_ros.robot.collision.box import uniform_box
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.quaternion import quaternion_from_rotation

CHASER, ARM, OBSTACLE, TARGET = "chaser", "arm", "obstacle", "target"
# More obstacles than the first number are drawn with the coarser circles.
_FEW, _AROUND, _COARSE = 20, 32, 12


@dataclass(frozen=True, eq=False)
class Part:
    """A surface that moves as one."""

    name: str  # of a joint, or an obstacle's id
    kind: str  # CHASER, ARM, OBSTACLE, or TARGET: fixed to a body that is captured
    corners: Array  # in its own frame; shape (corners, 3) [m]
    triangles: Triangles  # shape (triangles, 3)
    positions: Array  # in the inertial frame; shape (points, 3) [m]
    quaternions_wxyz: Array  # own axes to inertial axes, as the browser takes it; (points, 4)

    @cached_property
    def moves(self) -> bool:
        """Whether its frame is not in one place at all points."""
        return bool((self.positions != self.positions[0]).any())

    @cached_property
    def turns(self) -> bool:
        """Whether its axes have another direction at some point."""
        return bool((self.quaternions_wxyz != self.quaternions_wxyz[0]).any())


def robot_parts(robot: Robot, q: Array) -> Iterator[Part]:
    """Yield the part that each joint moves, the chaser first; a box stands for one without shapes.

    Args:
        q: Configurations. Shape (points, 7 + joints).
    """
    surface = robot_surface(robot)
    of_triangle = surface.joints[surface.triangles[:, 0]]
    positions, quaternions = joint_places(robot, q)
    for joint in range(1, robot.model.njoints):
        triangles = surface.triangles[of_triangle == joint]
        used, numbers = np.unique(triangles, return_inverse=True)
        corners, faces = surface.corners[used], numbers.reshape(-1, 3)
        if joint == 1 and not len(faces):
            stands_for = uniform_box(robot)
            corners, faces = box(tuple(stands_for.edges.tolist()))
            corners = corners @ stands_for.rotation_box_to_chaser.T
        if len(faces):
            kind = CHASER if joint == 1 else ARM
            at, turned = positions[:, joint], quaternions[:, joint]
            yield Part(robot.model.names[joint], kind, corners, faces, at, turned)


def obstacle_parts(stage: Stage) -> Iterator[Part]:
    """Yield a part for each obstacle of a stage."""
    obstacles = stage.problem.obstacles
    for one in obstacles:
        corners, triangles = obstacle_surface(one, _AROUND if len(obstacles) <= _FEW else _COARSE)
        rotations, origins = obstacle_poses(one, stage.times)
        kind = OBSTACLE if one.body is None else TARGET
        yield Part(one.id, kind, corners, triangles, origins, wxyz(rotations))


def joined(points: Array) -> NDArray[np.float32]:
    """Return the lines between points that follow each other. Shape (points - 1, 2, 3)."""
    return np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)


def wxyz(rotations: NDArray[np.float64]) -> Array:
    """Return rotation matrices, shape (points, 3, 3), as quaternions, shape (points, 4)."""
    return np.roll(quaternion_from_rotation(rotations), 1, axis=-1)


def joint_places(robot: Robot, q: Array) -> tuple[Array, Array]:
    """Return positions and quaternions of the frames of all joints of the model.

    Returns:
        Shape (points, joints of the model, 3) [m], and (points, joints of the model, 4), w x y z.
    """
    model = robot.model
    data = model.createData()
    positions = np.empty((len(q), model.njoints, 3))
    rotations = np.empty((len(q), model.njoints, 3, 3))
    for row, one in enumerate(q):
        pin.forwardKinematics(model, data, one)
        for joint, place in enumerate(data.oMi):
            positions[row, joint], rotations[row, joint] = place.translation, place.rotation
    flat = wxyz(rotations.reshape(-1, 3, 3))
    return positions, flat.reshape(len(q), model.njoints, 4)
