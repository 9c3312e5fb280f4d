"""What the grasp of a problem sees, where it is at each moment.

It is that of a target body, or a target that goes on with the velocity and the turn rate that it
has at the goal: one that rests stays where it is, in every inertial frame.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.quaternion import (
    quaternion_from_rotation_vector,
    rotation_from_quaternion,
)


class GraspSeen:
    """Points in the grasp's frame, one at each of some times."""

    def __init__(self, problem: PlanningProblem, times: Array) -> None:
        """Work out where the grasp is at times from the plan's first point on, (times,) [s]."""
        body, target = problem.target_body, problem.target
        self._parts, self._of_body = times / problem.duration, body is not None
        # On a table the height does not count.
        self._counts = np.isin(range(3), problem.robot.base.rows).astype(np.float64)
        if body is not None:
            motion = body.grasp(times)
            self._positions, self._rotations = motion.positions, motion.rotations
            self._twists = motion.twists
            return
        later = times - problem.duration
        turned = quaternion_from_rotation_vector(np.outer(later, target.angular_velocity))
        at_goal = pin.Quaternion(target.quaternion_xyzw).toRotationMatrix()
        self._positions = target.position + np.outer(later, target.linear_velocity)
        self._rotations = rotation_from_quaternion(turned) @ at_goal
        twist = np.concatenate([target.linear_velocity, target.angular_velocity])
        self._twists = np.broadcast_to(twist, (len(times), 6))

    @property
    def positions(self) -> Array:
        """Where the grasp is, inertial frame. Shape (times, 3) [m]."""
        return self._positions

    @property
    def velocities(self) -> Array:
        """Velocities of the grasp, inertial axes. Shape (times, 3) [m/s]."""
        return self._twists[:, :3]

    def by_duration(self, target_by_duration: Array) -> Array:
        """Return how the grasp moves with the duration, at fixed parts of it, as twists.

        The grasp of a body is where it is at that time. A target is at the goal where it is told to
        be, and before that on its uniform way there.

        Args:
            target_by_duration: Place of the target by the duration, a twist. Shape (6,).

        Returns:
            Linear part first, inertial axes. Shape (times, 6) [m/s, rad/s].
        """
        parts = self._parts[:, None]
        if self._of_body:
            return np.asarray(parts * self._twists, np.float64)
        return np.asarray(target_by_duration + (parts - 1.0) * self._twists, np.float64)

    def _here(self, vectors: Array) -> Array:
        seen: Array = np.einsum("pji,pj->pi", self._rotations, self._counts * vectors)
        return seen

    def from_grasp(self, points: Array) -> Array:
        """Return the ways from the grasp to points, inertial axes. Shape (times, 3) [m]."""
        return points - self._positions

    def sees(self, points: Array) -> Array:
        """Return where points are, one at each time. Shape (times, 3) [m]."""
        return self._here(points - self._positions)

    def sees_moving(self, points: Array, velocities: Array) -> Array:
        """Return how fast points move, one at each time. Shape (times, 3) [m/s]."""
        carried = np.cross(self._twists[:, 3:], points - self._positions)
        return self._here(velocities - self._twists[:, :3] - carried)

    def sees_by_duration(self, points: Array, target_by_duration: Array) -> Array:
        """Return how places change with the duration, at fixed parts of it. Shape (times, 3)."""
        by_duration = self.by_duration(target_by_duration)
        carried = np.cross(by_duration[:, 3:], points - self._positions)
        return self._here(-by_duration[:, :3] - carried)

    def is_at(self, places: Array) -> Array:
        """Return where places of its frame are, one at each time. Shape (times, 3) [m]."""
        there: Array = self._positions + np.einsum("pij,pj->pi", self._rotations, places)
        return there

    def in_inertial(self, gradients: Array) -> Array:
        """Return gradients by places as those by points of the inertial frame. (times, 3)."""
        turned: Array = self._counts * np.einsum("pij,pj->pi", self._rotations, gradients)
        return turned
