"""A circle to follow: a short form of a path, from where the end effector is at the start."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.declared import check_declared, declare
from ff_planner_ros.common.forms import DIRECTION, a_number, a_vector, a_word
from ff_planner_ros.common.shown import in_a_line
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.path.followed import (
    MOST_POINTS,
    ORIENTATION_TOLERANCE,
    POSITION_TOLERANCE,
    PathPoint,
    PathToFollow,
    end_effector,
)
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState

# The cubic spline through points an angle a apart is off the circle by 1/384 of the radius times
# a^4; this part of the tolerance may be used up by that. No two points are further apart [rad], and
# no fewer show how it begins and ends.
_SPLINE, _MISSED, _WIDEST, _FEWEST = 1.0 / 384.0, 0.02, 0.2, 50


class Turning(StrEnum):
    """What becomes of the end effector's orientation along a circle."""

    FREE = "free"
    KEPT = "kept"  # as at the start
    CARRIED = "carried"  # round with the circle, so that a camera looks at the centre all the way


@dataclass(frozen=True, eq=False)
class CircleToFollow:
    """A circle that the end effector follows from where it is at the start, at rest at both ends.

    Raises:
        InvalidInput: A value is not allowed.
    """

    center: Array = declare(
        a_vector(),
        "instead of a pose: a point on the axis that the end effector circles",
        key="circle.center",
        unit="m",
    )
    axis: Array = declare(DIRECTION, "of the circle, right-handed", key="circle.axis")
    turns: float = declare(
        a_number(), "how often it goes round; negative: backwards", key="circle.turns", default=1.0
    )
    orientation: Turning = declare(
        a_word(Turning),
        "of the end effector: kept as at the start, or carried round with the circle",
        key="circle.orientation",
        default=Turning.FREE,
    )
    position_tolerance: float = POSITION_TOLERANCE
    orientation_tolerance: float = ORIENTATION_TOLERANCE

    __repr__ = in_a_line

    def __post_init__(self) -> None:
        """Check every value."""
        check_declared(self, "target")

    def path(self, robot: Robot, start: SystemState, duration: float) -> PathToFollow:
        """Return the points of the circle, passed by a polynomial of fifth order in time.

        Raises:
            InvalidInput: The end effector is on the axis, or goes round too often for its points.
        """
        pose, _ = end_effector(robot, start)
        arm, angle = pose.translation - self.center, 2.0 * math.pi * self.turns
        radius = float(np.linalg.norm(np.cross(self.axis, arm)))
        if radius <= self.position_tolerance:
            found = f"{radius:.6g} m from the end effector at the start"
            allowed = "the axis must be further away than position_tolerance: there is no circle"
            raise InvalidInput(Status.OUT_OF_RANGE, "target.circle.center", found, allowed)
        apart = (_MISSED * self.position_tolerance / (_SPLINE * radius)) ** 0.25
        fastest = 15.0 / 8.0 * abs(angle)  # an angle in all of the time
        count = max(_FEWEST, math.ceil(fastest / min(apart, _WIDEST)))
        if count > MOST_POINTS:
            allowed = f"it must be so few that {MOST_POINTS} points are enough"
            raise InvalidInput(Status.OUT_OF_RANGE, "target.circle.turns", self.turns, allowed)
        points = []
        for s in np.linspace(0.0, 1.0, count).tolist():
            turned = pin.exp3(angle * s**3 * (10.0 - 15.0 * s + 6.0 * s**2) * self.axis)
            carried = turned if self.orientation == Turning.CARRIED else np.eye(3)
            quaternion = pin.Quaternion(carried @ pose.rotation).normalized().coeffs()
            points.append(PathPoint(s * duration, self.center + turned @ arm, quaternion))
        if self.orientation == Turning.FREE:
            points = [replace(one, quaternion_xyzw=None) for one in points]
        return PathToFollow(tuple(points), self.position_tolerance, self.orientation_tolerance)
