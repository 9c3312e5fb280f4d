"""Names of goal kinds, orientations and path families, for code that only chooses among them."""

from __future__ import annotations

import enum


class GoalKind(enum.IntEnum):
    """Kind of a goal, with the numbers of `ff_planner_msgs/Goal`."""

    POSE = 0
    CAPTURE = 1
    JOINTS = 2
    AT_REST = 3
    FOLLOW = 4


class Orientation(enum.StrEnum):
    """How a target constrains the end effector's orientation; messages number it in this order."""

    FIXED = "fixed"
    FREE = "free"
    ABOUT_AXIS = "about_axis"  # free to turn about one axis of the end effector


class Parametrisation(enum.StrEnum):
    """Trajectory parameterisation to search: a path family by its name, or `AUTO`."""

    # The paper's; joint splines where it does not apply, finds no plan, or the attitude counts
    AUTO = "auto"
    END_EFFECTOR_POLYNOMIAL = "end_effector_polynomial"
    JOINT_SPLINE = "joint_spline"
