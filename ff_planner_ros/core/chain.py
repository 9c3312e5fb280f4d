"""The robot's model as the arrays that the compiled core computes with."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ff_planner_ros.core import compiled
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.model import Robot


@lru_cache(maxsize=8)
def chain_of(robot: Robot) -> compiled.Chain:
    """Return a robot's placements, axes and inertias, all of them from its Pinocchio model.

    Raises:
        InvalidInput: Its arm has more joints than the core has room for.
    """
    if robot.joints > compiled.MAX_JOINTS:
        raise InvalidInput(
            Status.BAD_ROBOT,
            "robot.urdf",
            f"an arm of {robot.joints} joints",
            f"an arm has {compiled.MAX_JOINTS} joints at most; robot.locked_joints holds some",
        )
    model = robot.model
    # The first two joints are Pinocchio's: the universe and the free-flyer, whose body is the base.
    placements = [*model.jointPlacements[2:], model.frames[robot.tip_frame_id].placement]
    bodies = model.inertias[1:]
    return compiled.Chain(
        translations=np.array([placement.translation for placement in placements]),
        rotations=np.array([placement.rotation for placement in placements]),
        axes=robot.joint_axes,
        masses=np.array([body.mass for body in bodies]),
        centers=np.array([body.lever for body in bodies]),
        inertias=np.array([body.inertia for body in bodies]),
    )
