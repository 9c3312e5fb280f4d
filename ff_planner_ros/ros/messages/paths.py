"""Paths to follow in messages: poses whose stamps count from the start, with their tolerances."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from ff_planner_msgs.msg import Goal, Limits
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path

from ff_planner_ros.common.arrays import normalising_to
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import (
    InvalidInput,
    Status,
    fields_named,
    fields_placed,
    fields_renamed,
)
from ff_planner_ros.messages.status import GOAL_FIELDS, path_named
from ff_planner_ros.planning.problem.goal_words import GoalKind, Orientation
from ff_planner_ros.planning.problem.path.followed import PathPoint, PathToFollow

if TYPE_CHECKING:
    from ff_planner_msgs.msg import AllowedCollisions

# Numbers of a goal's orientations, as messages have them.
_FIXED, _FREE, _ABOUT_AXIS = range(len(Orientation))


def path_in(goal: Goal, limits: Limits, inertial_frame: str) -> PathToFollow | None:
    """Return the path to follow of a request or phase; None: its goal is of another kind.

    Raises:
        InvalidInput: There is no path, or it is given in another frame or cannot be followed.
    """
    if goal.kind != GoalKind.FOLLOW:
        return None
    if not goal.path:
        allowed = "a goal of kind FOLLOW needs a path"
        raise InvalidInput(Status.OUT_OF_RANGE, "goal.path", "missing", allowed)
    if goal.orientation == _ABOUT_AXIS:
        allowed = "with kind FOLLOW it must be FIXED or FREE"
        raise InvalidInput(Status.UNSUPPORTED, "goal.orientation", goal.orientation, allowed)
    message, turns = goal.path[0], goal.orientation == _FIXED
    if message.header.frame_id != inertial_frame:
        field, found = "goal.path.header.frame_id", repr(message.header.frame_id)
        raise InvalidInput(Status.WRONG_FRAME, field, found, f"it must be '{inertial_frame}'")
    tolerances = {
        name: getattr(limits, f"path_{name}")[0]
        for name in ("position_tolerance", "orientation_tolerance")
        if getattr(limits, f"path_{name}")
    }
    with fields_named(GOAL_FIELDS), fields_renamed(path_named):
        points = []
        for number, one in enumerate(message.poses):
            place, turn = one.pose.position, one.pose.orientation
            with fields_placed(f"target.path[{number}]"):
                points.append(
                    PathPoint(
                        nanoseconds(one.header.stamp) / NANOSECONDS,
                        np.array([place.x, place.y, place.z]),
                        np.array([turn.x, turn.y, turn.z, turn.w]) if turns else None,
                    )
                )
        return PathToFollow(tuple(points), **tolerances)


def goal_of_path(
    path: PathToFollow,
    limits: Limits,
    inertial_frame: str,
    may_touch: Sequence[AllowedCollisions] = (),
) -> Goal:
    """Write a path to follow as a goal, and its tolerances into limits."""
    message = Path()
    message.header.frame_id = inertial_frame
    for one in path.points:
        pose = PoseStamped()
        pose.header.frame_id = inertial_frame
        stamp = round(one.time * NANOSECONDS)
        pose.header.stamp.sec, pose.header.stamp.nanosec = divmod(stamp, NANOSECONDS)
        place, turn = pose.pose.position, pose.pose.orientation
        place.x, place.y, place.z = one.position.tolist()
        if one.quaternion_xyzw is not None:
            turn.x, turn.y, turn.z, turn.w = normalising_to(one.quaternion_xyzw).tolist()
        message.poses.append(pose)
    limits.path_position_tolerance = [path.position_tolerance]
    limits.path_orientation_tolerance = [path.orientation_tolerance]
    orientation = _FIXED if path.turns else _FREE
    return Goal(
        kind=Goal.FOLLOW, path=[message], orientation=orientation, allowed_collisions=may_touch
    )
