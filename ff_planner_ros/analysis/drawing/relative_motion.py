"""Motion of the end effector relative to the grasp frame of a target body."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.analysis.drawing.panels import Quantity
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.target_body import TargetBody


def relative_motion(body: TargetBody) -> tuple[Quantity, Quantity]:
    """Return position and velocity of the end effector relative to the moving grasp frame.

    Args:
        body: The target body in its state at the plans' first point.
    """

    def place(motion: Trajectory) -> Array:
        return _seen(body, motion)[0]

    def velocity(motion: Trajectory) -> Array:
        return _seen(body, motion)[1]

    axes = ("x", "y", "z")
    return (
        Quantity("end effector, as the grasp sees it", tuple(f"{a} [m]" for a in axes), place),
        Quantity(
            "its velocity",
            tuple(f"$v_{axis}$ [m/s]" for axis in axes),
            velocity,
        ),
    )


def _seen(body: TargetBody, motion: Trajectory) -> tuple[Array, Array]:
    """Return relative positions [m] and velocities [m/s] in grasp axes, each (points, 3)."""
    grasp = body.grasp(motion.time)
    way = motion.ee_positions - grasp.positions
    linear, turning = np.hsplit(grasp.twists, 2)
    # Against the body's point where the end effector is.
    speed = motion.ee_linear_velocities - linear - np.cross(turning, way)
    to_grasp = Rotation.from_matrix(grasp.rotations).inv()
    return np.asarray(to_grasp.apply(way)), np.asarray(to_grasp.apply(speed))
