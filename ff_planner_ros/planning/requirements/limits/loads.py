"""Joint torques, and force and torque through the grasp of a payload, stay within their limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import Status
from ff_planner_ros.planning.motion.followed import FollowedMotion, peaks_of_steps
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.limits.limited import (
    PART_OF_INTEREST,
    Extremes,
    Limit,
    Limited,
)
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.dynamics import frame_wrenches, joint_torques
from ff_planner_ros.robot.urdf.payload import payload_frame

# Where torques are below this part of their limits at every fourth step of a motion, they do not
# become twice as high between these steps.
_FAR, _GLIMPSE = 0.5, 4


class LimitedLoads(Limited):
    """Limits of loads, which the dynamics make of positions, velocities and accelerations.

    They are known at each step of a motion; their peaks are exact to 5e-4.
    """

    is_on_demand = True

    def loads(self, problem: PlanningProblem, *motion: Any) -> Sequence[Array]:
        """Return the loads of each limit, each of shape (times, quantities).

        A motion is configurations (times, 7 + joints), tangent velocities (times, 6 + joints), the
        joints' accelerations (times, joints) [rad/s2, m/s2], and `momentum_maps` or None.
        """
        raise NotImplementedError

    def extremes(self, problem: PlanningProblem, motion: FollowedMotion) -> Sequence[Extremes]:
        """Return the extremes of the loads along a motion."""
        samples = motion.q, motion.v, motion.joint_accelerations, motion.maps
        loads = self.loads(problem, *samples)
        return [Extremes.of(peaks_of_steps(values, motion), values[0]) for values in loads]

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a start whose joint accelerations need loads beyond the limits."""
        limits, accelerations = self.limits(problem), problem.start.joint_accelerations
        if not limits or accelerations is None:
            return
        _, v = configuration(problem.robot, problem.start)
        loads = self.loads(problem, q_start[None], v[None], accelerations[None], None)
        given = np.array2string(accelerations, precision=4)
        for limit, values in zip(limits, loads, strict=True):
            limit.refuse_start(values[0], ["joints.acceleration"], [given])


class Torques(LimitedLoads):
    """Joint torques, of prismatic joints forces, stay within the effort limits of the URDF."""

    name = "torques"
    sizes = ("peak_joint_torques",)
    of_each = True

    def limits(self, problem: PlanningProblem) -> Sequence[Limit]:
        """Return the effort limits of the URDF, if the problem limits torques."""
        robot, efforts = problem.robot, problem.robot.effort_limits
        limit = Limit(
            -efforts,
            efforts,
            [f"joint {name}" for name in robot.joint_names],
            "needs",
            [robot.effort_unit(k) for k in range(robot.joints)],
            ("a longer duration", "limits.effort none"),
            name="its effort limit",
            status=Status.TORQUE_TOO_HIGH,
            excess=0.0,
        )
        return (limit,) if problem.limits.joint_torques else ()

    def loads(self, problem: PlanningProblem, *motion: Any) -> Sequence[Array]:
        """Return the torques by inverse dynamics."""
        return (joint_torques(problem.robot, *motion),)

    def metrics(
        self, problem: PlanningProblem, motion: FollowedMotion, found: Sequence[Extremes]
    ) -> Mapping[str, Any]:
        """Return each joint's largest torque [N m, N], and the least distance to a limit [N m]."""
        robot, metrics = problem.robot, super().metrics(problem, motion, found)
        # A force as the torque that does as much work along the joint path.
        left = (robot.effort_limits - metrics["peak_joint_torques"]) / robot.joint_weights
        return {**metrics, "min_torque_margin": float(left.min())}

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return the least distance as a fraction of its limit, or 0.5 if torques are far below."""
        samples = motion.q, motion.v, motion.joint_accelerations
        if problem.limits.joint_torques:
            glimpse = joint_torques(problem.robot, *(rows[::_GLIMPSE] for rows in samples))
            if (np.abs(glimpse) <= _FAR * problem.robot.effort_limits).all():
                return 1.0 - _FAR
        return super().slack(problem, motion)

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        robot = problem.robot
        parts = 1.0 / robot.effort_limits
        return (compiled.torques_within(robot.base, parts, margin, PART_OF_INTEREST),)


class GraspWrench(LimitedLoads):
    """Force and torque through the grasp of a payload stay within their limits."""

    name = "grasp_wrench"
    sizes = ("peak_grasp_force", "peak_grasp_torque")

    def limits(self, problem: PlanningProblem) -> Sequence[Limit]:
        """Return the limits of force and torque, infinite: none; nothing without a payload."""
        force, torque = problem.limits.grasp_force, problem.limits.grasp_torque
        if payload_frame(problem.robot) is None or np.isinf([force, torque]).all():
            return ()
        return [
            Limit(
                np.array([-limit]),
                np.array([limit]),
                [f"peak_{name}"],
                "is",
                [unit],
                ("a longer duration", f"a larger limits.{name}"),
                name=f"limits.{name}",
            )
            for name, limit, unit in (("grasp_force", force, "N"), ("grasp_torque", torque, "N m"))
        ]

    def loads(self, problem: PlanningProblem, *motion: Any) -> Sequence[Array]:
        """Return the sizes of force and torque; nothing without a payload."""
        frame = payload_frame(problem.robot)
        if frame is None:
            return ()
        wrenches = frame_wrenches(problem.robot, frame, *motion[:3])
        sizes = np.linalg.norm(wrenches.reshape(-1, 2, 3), axis=2)
        return sizes[:, :1], sizes[:, 1:]

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        robot, number = problem.robot, payload_frame(problem.robot)
        if number is None:
            return ()
        frame = robot.model.frames[number]
        return (
            compiled.grasp_wrench_within(
                robot.base,
                # The first two joints are Pinocchio's: the universe and the free-flyer.
                link=frame.parentJoint - 1,
                position=frame.placement.translation,
                rotation=frame.placement.rotation,
                mass=frame.inertia.mass,
                center=frame.inertia.lever,
                inertia=frame.inertia.inertia,
                parts=1.0 / np.array([problem.limits.grasp_force, problem.limits.grasp_torque]),
                margin=margin,
                interest=PART_OF_INTEREST,
            ),
        )
