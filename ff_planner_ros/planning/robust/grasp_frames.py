"""The grasp frame of a scene at given times up to the capture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.scene import Scene, grasp_frame
from ff_planner_ros.robot.model import Base


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
    goal = scene.target_body or scene.target
    if goal is None:
        return None
    grasp = grasp_frame(goal, captured, times)
    return GraspFrames(grasp.positions, counts * grasp.rotations)
