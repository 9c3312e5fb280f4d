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

from collections.abc import Iterator, Sequence

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import Failure, Status
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.chaser_attitude import attitudes_along
from ff_planner_ros.planning.requirements.requirement import (
    LIMIT_TOLERANCE,
    OF_INTEREST,
    Assessment,
    Requirement,
    Samples,
)
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.quaternion import (
    angle_of_quaternion,
    quaternion_inverse,
    quaternion_product,
)

# The search keeps this much more at the points [rad], but never more than this part of the limit.
_MARGIN, _PART = 5e-4, 0.02
# Where Huber's function becomes the angle, in parts of what the search keeps.
_KNEE = 0.5


class ChaserRotation(Requirement):
    """The angle of the chaser's rotation since the first point is within its limit, if any."""

    name = "chaser_rotation"

    def margin(self, problem: PlanningProblem, settings: PlannerSettings) -> float:
        """Return how far from the limit the search stays at the points [rad]."""
        return min(_MARGIN, _PART * problem.limits.chaser_rotation)

    def concerns(self, problem: PlanningProblem) -> bool:
        """Tell whether there is a limit that a rotation can exceed."""
        return _is_limited(problem)

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        kept = problem.limits.chaser_rotation - margin
        return (compiled.rotation_within(kept, _KNEE * kept, OF_INTEREST),)

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return how far the chaser stays from the limit [rad]."""
        if not self.concerns(problem):
            return np.inf
        _, angles = _angles(problem.robot, motion)
        return problem.limits.chaser_rotation - float(angles.max())

    def assess(self, samples: Samples) -> Assessment:
        """Return the largest rotation angle at any time, after the goal too [rad]."""
        angles = _angles(samples.problem.robot, samples.followed)
        found = {"max_chaser_rotation": float(angles[1].max())}
        return Assessment(found, tuple(self._failures(samples, *angles)))

    def _failures(self, samples: Samples, times: Array, angles: Array) -> Iterator[Failure]:
        """Yield the largest rotation angle, if it exceeds the limit, and its time."""
        if not _is_limited(samples.problem):
            return
        limit = samples.problem.limits.chaser_rotation
        worst = int(angles.argmax())
        if not angles[worst] <= limit + LIMIT_TOLERANCE:
            yield Failure(
                Status.LIMIT_VIOLATED,
                f"the chaser has rotated by {angles[worst]:.4f} rad at {samples.at(times[worst])}, "
                f"{angles[worst] - limit:.3g} rad more than limits.chaser_rotation, {limit:g} rad",
                (
                    "a larger limits.chaser_rotation",
                    "a larger objective.chaser_attitude",
                    "a longer duration",
                    "more planner.starts",
                ),
            )


def _is_limited(problem: PlanningProblem) -> bool:
    """Tell whether there is a limit that a rotation can exceed."""
    return problem.limits.chaser_rotation < np.pi


def _angles(robot: Robot, motion: FollowedMotion) -> tuple[Array, Array]:
    """Return times along a motion, and the angle since the first of them at each [rad]."""
    at, attitudes = attitudes_along(robot, motion)
    since = quaternion_product(quaternion_inverse(attitudes[0]), attitudes)
    return at, angle_of_quaternion(since)
