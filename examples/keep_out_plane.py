"""No part of the arm crosses a plane that is fixed to the chaser: a requirement of your own.

A distribution brings it along by an entry point, after which scenarios and the node know it:

    [project.entry-points."ff_planner_ros.requirements"]
    keep_out_plane = "keep_out_plane:KeepOutPlane"
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

import ff_planner_ros.planning.requirements.requirement as of
from ff_planner_ros.common.declared import declare
from ff_planner_ros.common.forms import a_number, a_vector
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.planning.distance.clearance import arm_points, arm_points_with_derivatives
from ff_planner_ros.planning.motion.joint_motion import JointMotion

EXACT = 1e-4  # [m] to which the least height is known between the points
AT_REST = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])  # the base link, in its own axes


@dataclass(frozen=True, eq=False)
class KeepOutPlane(of.Requirement):
    """The arm's centre lines stay on one side of a plane, in axes of the base link."""

    name: ClassVar[str] = "keep_out_plane"
    point: of.Array = declare(a_vector(), "of the plane, from the base link's origin", unit="m")
    normal: of.Array = declare(a_vector(), "of unit length, to the side where the arm stays")
    distance: float = declare(a_number(at_least=0.0), "that is kept", unit="m", default=0.0)

    def _heights(self, robot: Any, joints: of.Array) -> of.Array:
        """Return how far inside joint origins and end effector are. (times, points) [m]."""
        q = np.hstack([np.tile(AT_REST, (len(joints), 1)), joints])
        return np.asarray((arm_points(robot, q) - self.point) @ self.normal - self.distance)

    def _least(self, robot: Any, joints: JointMotion) -> tuple[float, float]:
        """Return a height [m] that the arm is never below, between the points too, and when."""
        stretched = np.append(AT_REST, np.zeros(robot.joints))[None]
        links = np.diff(arm_points(robot, stretched)[0], axis=0)
        reach = np.linalg.norm(links[::-1], axis=1).cumsum()[::-1]  # of what each joint moves
        fastest = float(np.abs(joints.extremes(1)[0]).max(axis=0) @ reach)
        times = np.linspace(joints.time[0], joints.time[-1], 200)
        while True:
            heights = self._heights(robot, joints.at(times)[0]).min(axis=1)
            bounds = (heights[:-1] + heights[1:] - fastest * np.diff(times)) / 2
            (low,) = np.nonzero(bounds < heights.min() - EXACT)
            if not low.size:
                return float(heights.min()) - EXACT, float(times[heights.argmin()])
            times = np.sort(np.append(times, (times[low] + times[low + 1]) / 2))

    def refuse_start(self, problem: Any, q_start: of.Array, _settings: Any) -> None:
        """Refuse a start beyond the plane."""
        if (height := float(self._heights(problem.robot, q_start[None, 7:]).min())) < EXACT:
            found, allowed = f"{height:.4f} m", f"the arm must be {EXACT} m or more inside"
            raise InvalidInput(of.Status.START_OUTSIDE_LIMITS, self.name, found, allowed)

    def rows(self, problem: Any, motion: Any, sensitivity: Any, margin: float) -> of.Rows:
        """Return the heights at the points and half-way between [m], with exact derivatives."""
        q = np.concatenate([motion.q[1:], motion.q_half_way])
        by_x = np.concatenate([sensitivity.q[1:], sensitivity.q_half_way])
        q[:, :7], by_x[:, :6] = AT_REST, 0.0
        heights = self._heights(problem.robot, q[:, 7:]) - margin
        jacobian = self.normal @ arm_points_with_derivatives(problem.robot, q, by_x)[1]
        near = heights < of.OF_INTEREST
        return of.Rows(heights[near], jacobian[near], np.flatnonzero(near))

    def slack(self, problem: Any, motion: of.FollowedMotion) -> float:
        """Return the least height along a motion [m]."""
        return self._least(problem.robot, motion.joints)[0]

    def assess(self, samples: of.Samples) -> of.Assessment:
        """Return the failure of the time at which the arm is furthest beyond the plane."""
        height, time = self._least(samples.problem.robot, samples.followed.joints)
        if height >= 0.0:
            return of.Assessment()
        words = f"the arm is {-height:.4f} m beyond {self.name} at {samples.at(time)}"
        advice = (f"a smaller {self.name}.distance",)
        return of.Assessment(failures=(of.Failure(of.Status.LIMIT_VIOLATED, words, advice),))
