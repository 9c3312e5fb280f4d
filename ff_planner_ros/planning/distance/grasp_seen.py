"""The grasp frame of a problem at given times, and points seen from it.

It is the grasp of the target body; without a body, it is the target pose, which moves uniformly
with the target's twist at the goal.
"""

from __future__ import annotations

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.scene import grasp_frame


def grasp_of_path(problem: PlanningProblem, points: int) -> GraspSeen:
    """Return the grasp frame at all points of a time grid but the first, then half-way."""
    times = np.linspace(0.0, problem.duration, points)
    return GraspSeen(problem, np.concatenate([times[1:], (times[:-1] + times[1:]) / 2]))


class GraspSeen:
    """The grasp frame at given times, with conversions of one point per time."""

    def __init__(self, problem: PlanningProblem, times: Array) -> None:
        """Compute the grasp frame at times from the plan's first point on, (times,) [s]."""
        body = problem.target_body
        self._parts, self._of_body = times / problem.duration, body is not None
        # On a table the height does not count.
        self._counts = np.array([float(axis in problem.robot.base.rows) for axis in range(3)])
        grasp = grasp_frame(body or problem.target, problem.duration, times)
        self._positions, self._rotations, self._twists = grasp

    @property
    def positions(self) -> Array:
        """Origin of the grasp frame, inertial frame. Shape (times, 3) [m]."""
        return self._positions

    @property
    def velocities(self) -> Array:
        """Velocities of the grasp, inertial axes. Shape (times, 3) [m/s]."""
        return self._twists[:, :3]

    def _own_by_duration(self) -> Array:
        """Return `by_duration` but for what a target's pose at the goal adds."""
        parts = self._parts if self._of_body else self._parts - 1.0
        return np.asarray(parts[:, None] * self._twists, np.float64)

    def in_core(self) -> compiled.GraspSeen:
        """Return the same as the core has it."""
        moved, with_goal = self._own_by_duration(), not self._of_body
        frames = self._positions, self._rotations, self._counts
        return compiled.GraspSeen(*frames, moved, with_goal)

    def _here(self, vectors: Array) -> Array:
        seen: Array = np.einsum("pji,pj->pi", self._rotations, self._counts * vectors)
        return seen

    def from_grasp(self, points: Array) -> Array:
        """Return the vectors from the grasp to points, inertial axes. Shape (times, 3) [m]."""
        return points - self._positions

    def sees(self, points: Array) -> Array:
        """Return points of the inertial frame in the grasp frame. Shape (times, 3) [m]."""
        return self._here(points - self._positions)

    def sees_moving(self, points: Array, velocities: Array) -> Array:
        """Return velocities of points, as the grasp frame sees them. Shape (times, 3) [m/s]."""
        carried = np.cross(self._twists[:, 3:], points - self._positions)
        return self._here(velocities - self._twists[:, :3] - carried)

    def is_at(self, places: Array) -> Array:
        """Return points of the grasp frame in the inertial frame. Shape (times, 3) [m]."""
        there: Array = self._positions + np.einsum("pij,pj->pi", self._rotations, places)
        return there
