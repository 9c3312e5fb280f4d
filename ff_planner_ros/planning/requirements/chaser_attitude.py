"""No Euler angle of the chaser exceeds what the problem allows, between the points too.

The measure is the largest absolute Euler angle relative to the start, Eq. (45). `ChaserRotation`
limits the rotation angle, which is mostly larger.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import Failure, Status
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.motion.pose_motion import attitudes_by_body_rates
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.requirement import (
    LIMIT_TOLERANCE,
    OF_INTEREST,
    Assessment,
    Requirement,
    Samples,
)
from ff_planner_ros.robot.configuration import eigen_quaternion
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.quaternion import quaternion_product, rotation_from_quaternion
from ff_planner_ros.robot.rotation import euler_from_rotation

# The search keeps this much more at the points [rad], but never more than this part of the limit.
_MARGIN, _PART = 5e-4, 0.02
# Times to look at in each step of the motion's integration. Between two of them the largest angle
# rises by less than 1e-6 rad.
_TIMES = 10


class ChaserAttitude(Requirement):
    """No Euler angle of the chaser exceeds its limit, if there is one."""

    name = "chaser_attitude"

    def margin(self, problem: PlanningProblem, settings: PlannerSettings) -> float:
        """Return how far from the limit the search stays at the points [rad]."""
        return min(_MARGIN, _PART * problem.limits.chaser_attitude)

    def concerns(self, problem: PlanningProblem) -> bool:
        """Tell whether the Euler angles have a limit."""
        return bool(np.isfinite(problem.limits.chaser_attitude))

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        axes, limit = problem.robot.rotation_chaser_to_base, problem.limits.chaser_attitude
        return (compiled.attitude_within(axes, limit - margin, OF_INTEREST),)

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return how far the chaser stays from the limit [rad]."""
        limit = problem.limits.chaser_attitude
        if np.isinf(limit):
            return np.inf
        _, angles = _angles(problem.robot, motion)
        return limit - float(angles.max())

    def assess(self, samples: Samples) -> Assessment:
        """Return the failure of the largest Euler angle, if it exceeds the limit, and its time."""
        limit = samples.problem.limits.chaser_attitude
        if np.isinf(limit):
            return Assessment()
        times, angles = _angles(samples.problem.robot, samples.followed)
        worst = int(angles.argmax())
        if angles[worst] <= limit + LIMIT_TOLERANCE:
            return Assessment()
        failure = Failure(
            Status.LIMIT_VIOLATED,
            f"the chaser's largest Euler angle is {angles[worst]:.4f} rad at "
            f"{samples.at(times[worst])}, {angles[worst] - limit:.3g} rad more "
            f"than limits.chaser_attitude, {limit:g} rad",
            (
                "a larger limits.chaser_attitude",
                "a larger objective.chaser_attitude",
                "a longer duration",
                "more planner.starts",
            ),
        )
        return Assessment(failures=(failure,))


@lru_cache(maxsize=2)  # what is measured first is judged soon after
def attitudes_along(robot: Robot, motion: FollowedMotion) -> tuple[Array, Array]:
    """Return times [s] along a motion, and quaternions of chaser to inertial axes, (times, 4)."""
    to_base = robot.rotation_chaser_to_base
    axes = quaternion_product(motion.q[:, 3:7], eigen_quaternion(to_base))
    if robot.base is Base.ATTITUDE_HELD:
        return motion.time, axes
    count = len(motion.time) - 1
    at = np.interp(np.arange(_TIMES * count + 1), _TIMES * np.arange(count + 1), motion.time)
    return at, attitudes_by_body_rates(motion.time, axes, motion.v[:, 3:6] @ to_base, at)


def _angles(robot: Robot, motion: FollowedMotion) -> tuple[Array, Array]:
    """Return times along a motion, and the largest absolute Euler angle at each [rad]."""
    at, between = attitudes_along(robot, motion)
    angles: Array = np.abs(euler_from_rotation(rotation_from_quaternion(between))).max(axis=1)
    return at, angles
