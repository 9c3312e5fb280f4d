"""The motion of a captured body along a plan: torque-free, then fixed to the end effector."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from ff_planner_ros.planning.motion.plan import BodyMotion, Trajectory, with_end_effector
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.problem.target_body import TargetBody


@dataclass(frozen=True, eq=False)
class CapturedBody:
    """A body that a plan captures; it is held from then on if another phase follows."""

    body: TargetBody  # in its state at the plan's first point
    held_from: float = math.inf  # time since the plan's first point [s]; infinite: it is never held

    @property
    def place(self) -> pin.SE3:
        """Pose of the body's frame in the end effector's frame while it is held."""
        turn = pin.Quaternion(self.body.grasp_quaternion_xyzw)
        return pin.SE3(turn, self.body.grasp_position).inverse()

    def along(self, motion: Trajectory) -> BodyMotion:
        """Return the body's motion in the inertial frame at the points of the whole plan."""
        # The point of the contact is the end of the approach.
        free = int(np.searchsorted(motion.time, self.held_from, side="right"))
        there = self.body.motion(np.zeros(3), motion.time[:free])
        turns = Rotation.from_matrix(there.rotations).as_quat()
        alone = BodyMotion(there.positions, turns, *np.hsplit(there.twists, 2))
        if free == len(motion.time):
            return alone
        place = pin.SE3ToXYZQUAT(self.place)
        return alone.followed_by(with_end_effector(motion, place, slice(free, None)))


def captured_in(scene: Scene) -> CapturedBody | None:
    """Return the body that is captured in a scene; None: no body is."""
    body = scene.target_body
    return None if body is None else CapturedBody(body, scene.held_from)
