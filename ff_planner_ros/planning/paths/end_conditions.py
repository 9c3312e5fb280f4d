"""What a motion misses of its goal: pose, twist and acceleration of the end effector, or a part.

Where the target leaves the orientation free, or free about an axis, only the other conditions are
left; where the base is planar, only those in the plane. Pose first, then twist and acceleration:
lengths [m] and angles [rad], those of the last two being the way that they make in a quarter of the
duration. The compiled core computes them.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ff_planner_ros.core import compiled
from ff_planner_ros.planning.problem.problem import Target


def compiled_target(target: Target) -> compiled.Target:
    """Return a target as the compiled core knows it."""
    axis = np.zeros(3) if target.free_axis_in_ee is None else target.free_axis_in_ee
    _, _, axes = np.linalg.svd(axis[None])
    return compiled.Target(
        target.position,
        pin.Quaternion(target.quaternion_xyzw).toRotationMatrix(),
        np.append(target.linear_velocity, target.angular_velocity),
        np.append(target.linear_acceleration, target.angular_acceleration),
        target.orientation,
        axis,
        axes[1:],
    )
