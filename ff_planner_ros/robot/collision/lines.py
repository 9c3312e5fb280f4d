"""The arm's link centre lines as bodies without thickness, for distances from obstacle bodies."""

from __future__ import annotations

from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, frozen
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
    ends = _ends(robot)
    start = robot.tree.to_tip.index(with_bodies(robot).bodies[body].joint - 2)
    return f"the link from {ends[start]} to {ends[start + 1]}"


def _lines(robot: Robot) -> tuple[Body, ...]:
    """Return a body for each line from a joint to the next one or to the end effector."""
    ends, tree, way = _ends(robot), robot.tree, robot.tree.to_tip
    beyond = [robot.model.jointPlacements[2 + k] for k in way[1:]]
    beyond.append(robot.model.frames[robot.tip_frame_id].placement)
    found = []
    for number, place in enumerate(beyond):
        end, slide = place.translation, np.zeros(3)
        if number + 1 < len(way):
            slide = place.rotation @ tree.slides[way[number + 1]]
        length, is_stretched = float(np.linalg.norm(end)), bool(slide.any())
        if length <= SAME_POINT and not is_stretched:
            continue
        # One that has no length may slide out.
        along = end if length > SAME_POINT else SAME_POINT * slide
        along_z = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), along)
        longest = length
        if is_stretched:
            longest += float(slid(robot)[way[number + 1]])
        found.append(
            Body(
                name=f"{ends[number]}-{ends[number + 1]}",
                link=f"{ends[number]}-{ends[number + 1]}",
                joint=way[number] + 2,
                solid=coal.Capsule(0.0, float(np.linalg.norm(along))),
                placement_in_joint=pin.SE3(along_z.toRotationMatrix(), along / 2),
                center_in_joint=frozen(end / 2),
                radius=longest / 2,
                slide_in_joint=frozen(slide),
            )
        )
    return tuple(found)


def _ends(robot: Robot) -> tuple[str, ...]:
    """Return the names of the joints from base to tip, and of the tip link."""
    return (*(robot.model.names[2 + k] for k in robot.tree.to_tip), robot.tip_link)


def slid(robot: Robot) -> Array:
    """Return how far each joint slides from zero at most; zero if it turns. Shape (all,) [m]."""
    beyond = BEYOND_LIMITS * np.abs(robot.tree.multipliers)
    return robot.furthest_slides + beyond * robot.tree.slides.any(axis=1)
