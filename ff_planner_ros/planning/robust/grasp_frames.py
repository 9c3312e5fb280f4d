"""The grasp frame of a scene at given times up to the capture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.robot.model import Base
from ff_planner_ros.robot.quaternion import (
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_from_quaternion,
)


class GraspFrames(NamedTuple):
    """The grasp frame in the inertial frame, at times up to the capture."""

    positions: Array  # shape (times, 3) [m]
    rotations: Array  # to inertial axes; on a table with a z row of zeros; shape (times, 3, 3)

    @property
    def until(self) -> int:
        """Number of times."""
        return len(self.positions)

    def sees(self, points: Array) -> Array:
        """Return points of the inertial frame in the grasp frame. Shape (times, ..., 3) [m]."""
        positions = self.positions.reshape(len(points), *[1] * (points.ndim - 2), 3)
        seen: Array = np.einsum("tji,t...j->t...i", self.rotations, points - positions)
        return seen


def grasp_frames(scene: Scene, base: Base, times: Array) -> GraspFrames | None:
    """Return the grasp frames of a scene; None: the scene has no target.

    Args:
        times: Two or more, from the plan's first point on; those after the capture are left out.
            Shape (times,) [s].
    """
    captured = scene.capture_time if scene.capture_time is not None else float(times[-1])
    # The last one is that at the capture, but for rounding.
    times = times[: int(np.searchsorted(times, captured + np.diff(times).min() / 2))]
    counts = np.isin(range(3), base.rows).astype(np.float64)[:, None]
    if scene.target_body is not None:
        grasp = scene.target_body.grasp(times)
        return GraspFrames(grasp.positions, counts * grasp.rotations)
    target = scene.target
    if target is None:
        return None
    later = times - captured
    turned = quaternion_from_rotation_vector(np.outer(later, target.angular_velocity))
    rotations = rotation_from_quaternion(quaternion_product(turned, target.quaternion_xyzw))
    positions = target.position + np.outer(later, target.linear_velocity)
    return GraspFrames(positions, counts * rotations)
