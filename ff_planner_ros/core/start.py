"""What stays of a system's start, for the compiled core."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.momentum import total_momentum


def start_of(robot: Robot, q: Array, v: Array) -> compiled.Start:
    """Return where a system begins, and its momentum.

    Args:
        q: Configuration. Shape (7 + joints,).
        v: Tangent velocity. Shape (6 + joints,).
    """
    data = robot.model.createData()
    momentum = total_momentum(robot, data, q, v)
    center = np.array(pin.centerOfMass(robot.model, data, q))
    momentum[3:] -= np.cross(center, momentum[:3])
    rotation = pin.Quaternion(q[3:7]).toRotationMatrix()
    return compiled.Start(q[:3], rotation, center, momentum, robot.base is Base.PLANAR)
