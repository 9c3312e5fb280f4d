"""The arm's link centre lines as bodies without thickness, for distances from obstacle bodies."""

from __future__ import annotations

from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import frozen
from ff_planner_ros.robot.collision.bodies import Body
from ff_planner_ros.robot.kept_with import kept_with_it
from ff_planner_ros.robot.model import Robot

# Joint origins nearer than this are the same point; drawings are not more exact [m].
SAME_POINT = 1e-6
# No joint slides further beyond its limits [m]: the check refuses plans that exceed them by more.
BEYOND_LIMITS = 1e-3


@kept_with_it
def with_bodies(robot: Robot) -> Robot:
    """Return a robot whose bodies are its shapes, or its link centre lines if it has none."""
    return robot if robot.bodies else replace(robot, bodies=_lines(robot))


def in_words(robot: Robot, body: int) -> str:
    """Return the name of a body, or words for a centre line, by its number in `with_bodies`."""
    if robot.bodies:
        return robot.bodies[body].name
    ends, start = (*robot.joint_names, robot.tip_link), with_bodies(robot).bodies[body].joint - 2
    return f"the link from {ends[start]} to {ends[start + 1]}"


def _lines(robot: Robot) -> tuple[Body, ...]:
    """Return a body for each line from a joint to the next one or to the end effector."""
    ends = (*robot.joint_names, robot.tip_link)
    beyond = [*robot.model.jointPlacements[3:], robot.model.frames[robot.tip_frame_id].placement]
    found = []
    for number, place in enumerate(beyond):
        end, slide = place.translation, np.zeros(3)
        if number + 1 < robot.joints:
            slide = place.rotation @ robot.joint_slides[number + 1]
        length, is_stretched = float(np.linalg.norm(end)), bool(slide.any())
        if length <= SAME_POINT and not is_stretched:
            continue
        # One that has no length may slide out.
        along = end if length > SAME_POINT else SAME_POINT * slide
        along_z = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), along)
        longest = length
        if is_stretched:
            longest += float(robot.furthest_slides[number + 1]) + BEYOND_LIMITS
        found.append(
            Body(
                name=f"{ends[number]}-{ends[number + 1]}",
                link=f"{ends[number]}-{ends[number + 1]}",
                joint=number + 2,
                solid=coal.Capsule(0.0, float(np.linalg.norm(along))),
                placement_in_joint=pin.SE3(along_z.toRotationMatrix(), along / 2),
                center_in_joint=frozen(end / 2),
                radius=longest / 2,
                slide_in_joint=frozen(slide),
            )
        )
    return tuple(found)
