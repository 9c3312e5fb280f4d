"""The chaser rotates no further than the problem allows, between the points and in the tail too.

The angle is that of its rotation since the plan's first point, 2 atan2(|q_v|, |q_w|) of the
relative quaternion: the same in any frame, and never more than pi. `ChaserAttitude` limits the
largest absolute Euler angle, Eq. (45), which is mostly smaller.

Where the chaser has not rotated, the angle has no derivative. The search therefore keeps Huber's
function of it, a parabola up to half the limit and the angle itself beyond:

    f = angle                              from the knee on, gradient  n
    f = angle^2 / (2 knee) + knee / 2      below it, gradient          n angle / knee

with n the axis of the rotation. It is smooth at zero and reaches the limit where the angle does.
Beyond the knee it is as nearly linear in the path as an angle can be; 1 - cos(angle) would be
smooth too, but a path far beyond the limit would halve its excess in each of the solver's steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.motion.pose_motion import attitudes_by_body_rates
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.limits.limited import Extremes, Limit, Limited
from ff_planner_ros.planning.requirements.requirement import OF_INTEREST
from ff_planner_ros.robot.configuration import eigen_quaternion
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.quaternion import (
    angle_of_quaternion,
    quaternion_inverse,
    quaternion_product,
    rotation_from_quaternion,
)
from ff_planner_ros.robot.rotation import euler_from_rotation

# The search keeps this much more at the points [rad], but never more than this part of the limit.
MARGIN, PART = 5e-4, 0.02
# Where Huber's function becomes the angle, in parts of what the search keeps.
KNEE = 0.5
# Times to look at in each step of the motion's integration. Between two of them the largest angle
# rises by less than 1e-6 rad.
_TIMES = 10


def limit_of_angle(most: float, field: str, verb: str, advice: tuple[str, ...]) -> Limit:
    """Return the limit of an angle of the chaser, without any excess.

    Args:
        most: Largest angle [rad].
        field: That gives the limit.
        verb: What the chaser does by the angle, for failures.
        advice: What may help.
    """
    return Limit(
        np.array([-most]),
        np.array([most]),
        ["the chaser"],
        verb,
        ["rad"],
        advice,
        name=field,
        excess=0.0,
        is_relative=False,
    )


class _ChaserAngle(Limited):
    """An angle of the chaser since the first point is within its limit, if there is one."""

    verb: ClassVar[str]

    def limit(self, problem: PlanningProblem) -> float:
        """Return the limit [rad], infinite: there is none."""
        return float(getattr(problem.limits, self.name))

    def angles(self, attitudes: Array) -> Array:
        """Return the angle at each attitude [rad], a quaternion of chaser to inertial axes."""
        raise NotImplementedError

    def limits(self, problem: PlanningProblem) -> Sequence[Limit]:
        """Return the limit, if the angle can exceed it."""
        limit, field = self.limit(problem), f"limits.{self.name}"
        if np.isinf(limit):
            return ()
        advice = (
            f"a larger {field}",
            "a larger objective.chaser_attitude",
            "a longer duration",
            "more planner.starts",
        )
        return (limit_of_angle(limit, field, self.verb, advice),)

    def extremes(self, problem: PlanningProblem, motion: FollowedMotion) -> Sequence[Extremes]:
        """Return the largest angle along a motion."""
        times, attitudes = _attitudes_along(problem.robot, motion)
        angles = self.angles(attitudes)
        at = [0, int(angles.argmax())]
        return (Extremes(angles[at, None], times[at, None], angles[:1]),)

    def margin(self, problem: PlanningProblem, settings: PlannerSettings) -> float:
        """Return how far from the limit the search stays at the points [rad]."""
        return min(MARGIN, PART * self.limit(problem))


class ChaserAttitude(_ChaserAngle):
    """No Euler angle of the chaser exceeds its limit, Eq. (45), if there is one."""

    name = "chaser_attitude"
    verb = "has a largest Euler angle of"

    def angles(self, attitudes: Array) -> Array:
        """Return the largest absolute Euler angle at each attitude [rad]."""
        angles: Array = np.abs(euler_from_rotation(rotation_from_quaternion(attitudes))).max(axis=1)
        return angles

    def extremes(self, problem: PlanningProblem, motion: FollowedMotion) -> Sequence[Extremes]:
        """Return the largest angle along a motion, if it has a limit."""
        return super().extremes(problem, motion) if self.concerns(problem) else ()

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        axes, limit = problem.robot.rotation_chaser_to_base, self.limit(problem)
        return (compiled.attitude_within(axes, limit - margin, OF_INTEREST),)


class ChaserRotation(_ChaserAngle):
    """The angle of the chaser's rotation since the first point is within its limit, if any."""

    name = "chaser_rotation"
    sizes = ("max_chaser_rotation",)  # after the goal too
    verb = "has rotated by"

    def limits(self, problem: PlanningProblem) -> Sequence[Limit]:
        """Return the limit, if a rotation can exceed it."""
        return super().limits(problem) if self.limit(problem) < np.pi else ()

    def angles(self, attitudes: Array) -> Array:
        """Return the rotation angle since the first attitude [rad]."""
        return angle_of_quaternion(quaternion_product(quaternion_inverse(attitudes[0]), attitudes))

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        kept = self.limit(problem) - margin
        return (compiled.rotation_within(kept, KNEE * kept, OF_INTEREST),)


def _attitudes_along(robot: Robot, motion: FollowedMotion) -> tuple[Array, Array]:
    """Return times [s] along a motion, and quaternions of chaser to inertial axes, (times, 4)."""
    to_base = robot.rotation_chaser_to_base
    axes = quaternion_product(motion.q[:, 3:7], eigen_quaternion(to_base))
    if robot.base is Base.ATTITUDE_HELD:
        return motion.time, axes
    count = len(motion.time) - 1
    at = np.interp(np.arange(_TIMES * count + 1), _TIMES * np.arange(count + 1), motion.time)
    return at, attitudes_by_body_rates(motion.time, axes, motion.v[:, 3:6] @ to_base, at)
