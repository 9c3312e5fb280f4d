"""The chaser has the attitude at the goal that the problem asks for.

The search keeps the angle off that attitude, smooth at zero as in `limits.chaser_rotation`, and its
components along three axes: a path that is far off is led to all of them at once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.problem.limits import ANY_ATTITUDE
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.limits.chaser_rotation import (
    KNEE,
    MARGIN,
    PART,
    limit_of_angle,
)
from ff_planner_ros.planning.requirements.limits.limited import Extremes, Limit, Limited
from ff_planner_ros.robot.configuration import eigen_quaternion
from ff_planner_ros.robot.model import Base
from ff_planner_ros.robot.plane import flattened
from ff_planner_ros.robot.quaternion import (
    quaternion_inverse,
    quaternion_product,
    rotation_from_quaternion,
)


class ChaserAtGoal(Limited):
    """The chaser's attitude at the goal is within an angle of the one asked for, if any is."""

    name = "chaser_at_goal"

    def refuse(self, problem: PlanningProblem) -> None:
        """Refuse an attitude that no motion of this base leads to."""
        goal, start = problem.chaser_goal, problem.start.quaternion_chaser_to_inertial_xyzw
        if goal.quaternion_xyzw is None:
            return
        turn = quaternion_product(goal.quaternion_xyzw, quaternion_inverse(start))
        if problem.robot.base is Base.ATTITUDE_HELD:
            off, base = goal.off(start, start), "attitude_held the chaser does not turn"
        elif problem.robot.base is Base.PLANAR:
            off, base = flattened(turn)[1], "planar the chaser turns about z only"
        else:
            return
        if off > goal.most:
            raise InvalidInput(
                Status.OUT_OF_RANGE,
                "target.chaser_quaternion_xyzw",
                goal.quaternion_xyzw.tolist(),
                f"with robot.base {base}: no motion leads nearer to it than {off:.4g} rad",
            )

    def limits(self, problem: PlanningProblem) -> Sequence[Limit]:
        """Return the largest angle off the attitude, if the chaser can be further off."""
        goal = problem.chaser_goal
        if goal.most >= np.pi or problem.robot.base is Base.ATTITUDE_HELD:
            return ()
        of_start = goal.quaternion_xyzw is None
        field = "target.chaser_rotation" if of_start else "target.chaser_tolerance"
        off = "has rotated by" if of_start else "is off target.chaser_quaternion_xyzw by"
        advice = (f"a larger {field}", "a longer duration", "more planner.joint_spline_spans")
        return (limit_of_angle(goal.most, field, off, advice),)

    def extremes(self, problem: PlanningProblem, motion: FollowedMotion) -> Sequence[Extremes]:
        """Return the angle off the attitude at the goal."""
        goal = _at_goal(problem, motion)
        first, there = _attitudes(problem, motion, goal)
        off = np.array([problem.chaser_goal.off(first, there)])
        return (Extremes(np.array([off, off]), motion.time[[goal, goal], None], np.zeros(1)),)

    def metrics(
        self, problem: PlanningProblem, motion: FollowedMotion, found: Sequence[Extremes]
    ) -> Mapping[str, float]:
        """Return the rotation angle at the goal since the first point, whatever is asked for."""
        first, there = _attitudes(problem, motion, _at_goal(problem, motion))
        return {"final_chaser_rotation": ANY_ATTITUDE.off(first, there)}

    def margin(self, problem: PlanningProblem, settings: PlannerSettings) -> float:
        """Return how far from the limit the search stays [rad]."""
        return min(MARGIN, PART * problem.chaser_goal.most)

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        start, kept = problem.start.quaternion_chaser_to_inertial_xyzw, problem.chaser_goal.most
        wanted = rotation_from_quaternion(problem.chaser_goal.wanted(start))
        of_base = wanted @ problem.robot.rotation_chaser_to_base.T
        kept -= margin
        return (compiled.chaser_at_goal(of_base, kept, KNEE * kept),)


def _at_goal(problem: PlanningProblem, motion: FollowedMotion) -> int:
    """Return the number of a motion's time that is the goal's."""
    return int(np.abs(motion.time - problem.duration).argmin())


def _attitudes(problem: PlanningProblem, motion: FollowedMotion, goal: int) -> tuple[Array, Array]:
    """Return the attitudes of the chaser at the first time and at the goal, each of shape (4,)."""
    to_base = eigen_quaternion(problem.robot.rotation_chaser_to_base)
    first, there = quaternion_product(motion.q[[0, goal], 3:7], to_base)
    return first, there
