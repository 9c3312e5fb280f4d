"""The arm's link centre lines as bodies without thickness, for distances from obstacle bodies."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import coal
import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import frozen
from ff_planner_ros.robot.collision.bodies import Body
from ff_planner_ros.robot.model import Robot

# Joint origins nearer than this are the same point; drawings are not more exact [m].
SAME_POINT = 1e-6


@lru_cache(maxsize=8)
def with_bodies(robot: Robot) -> Robot:
    """Return a robot whose bodies are its shapes, or its link centre lines if it has none."""
    return robot if robot.bodies else replace(robot, bodies=_lines(robot))


def _lines(robot: Robot) -> tuple[Body, ...]:
    """Return a body for each line from a joint to the next one or to the end effector."""
    ends = (*robot.joint_names, robot.tip_link)
    beyond = [place.translation for place in robot.model.jointPlacements[3:]]
    beyond.append(robot.model.frames[robot.tip_frame_id].placement.translation)
    found = []
    for number, end in enumerate(beyond):
        length = float(np.linalg.norm(end))
        if length > SAME_POINT:
            along_z = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end / length)
            found.append(
                Body(
                    name=f"{ends[number]}-{ends[number + 1]}",
                    link=f"{ends[number]}-{ends[number + 1]}",
                    joint=number + 2,
                    solid=coal.Capsule(0.0, length),
                    placement_in_joint=pin.SE3(along_z.toRotationMatrix(), end / 2),
                    center_in_joint=frozen(end / 2),
                    radius=length / 2,
                )
            )
    return tuple(found)
