"""What goals and their orientations are called, in words and numbers, for who reads no more."""

from __future__ import annotations

import enum


class GoalKind(enum.IntEnum):
    """What a goal is; the numbers of `ff_planner_msgs/Goal`."""

    POSE = 0
    CAPTURE = 1
    JOINTS = 2
    AT_REST = 3


class Orientation(enum.StrEnum):
    """What a target says about the end effector's orientation; messages number it in this order."""

    FIXED = "fixed"
    FREE = "free"
    ABOUT_AXIS = "about_axis"  # free to turn about one axis of the end effector
