"""Joint torques stay within the effort limits of the URDF, between the points too.

Of prismatic joints these are forces.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.motion.followed import FollowedMotion, Peaks, peaks_of_steps
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.requirement import (
    LIMIT_TOLERANCE,
    Assessment,
    Requirement,
    Samples,
)
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.dynamics import joint_torques
from ff_planner_ros.robot.model import Robot

# A torque further from its limit than this fraction of it cannot reach it in one solver step.
_OF_INTEREST = 0.4
# Where torques are below this part of their limits at every fourth step of a motion, they do not
# become twice as high between these steps.
_FAR, _GLIMPSE = 0.5, 4
# Between 50 points torques rise above those at the points by less, as a fraction of their limits.
_MARGIN = 1e-3


class Torques(Requirement):
    """Joint torques stay within the effort limits, if the problem limits them."""

    name = "torques"
    is_on_demand = True

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a start whose joint accelerations need more torque than the limits."""
        robot, accelerations = problem.robot, problem.start.joint_accelerations
        if accelerations is None or not problem.limits.joint_torques:
            return
        _, v_start = configuration(robot, problem.start)
        (torques,) = joint_torques(robot, q_start[None], v_start[None], accelerations[None])
        excess = np.abs(torques) - robot.effort_limits
        joint = int(excess.argmax())
        unit = robot.effort_unit(joint)
        if excess[joint] > LIMIT_TOLERANCE:
            raise InvalidInput(
                Status.START_OUTSIDE_LIMITS,
                f"joints.acceleration[{robot.joint_names[joint]}]",
                f"{accelerations[joint]:.6f} {robot.unit(joint)}/s2, for which the joint needs "
                f"{torques[joint]:.4g} {unit}",
                f"its effort limit is {robot.effort_limits[joint]:g} {unit} either way",
            )

    def margin(self, problem: PlanningProblem, settings: PlannerSettings) -> float:
        """Return how far from the limits the search stays, as a fraction of them."""
        return _MARGIN

    def concerns(self, problem: PlanningProblem) -> bool:
        """Tell whether torques have limits."""
        return problem.limits.joint_torques

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        robot = problem.robot
        parts = 1.0 / robot.effort_limits
        return (compiled.torques_within(robot.base, parts, margin, _OF_INTEREST),)

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return the least distance as a fraction of its limit, or 0.5 if torques are far below."""
        if not self.concerns(problem):
            return np.inf
        robot, limits = problem.robot, problem.robot.effort_limits
        samples = motion.q, motion.v, motion.joint_accelerations
        glimpse = joint_torques(robot, *(rows[::_GLIMPSE] for rows in samples))
        if (np.abs(glimpse) <= _FAR * limits).all():
            return 1.0 - _FAR
        torques, _ = _peaks(robot, motion)
        return float((1.0 + (LIMIT_TOLERANCE - np.abs(torques)) / limits).min())

    def assess(self, samples: Samples) -> Assessment:
        """Return each joint's largest torque [N m, N], and the least distance to a limit [N m]."""
        robot = samples.problem.robot
        found = _peaks(robot, samples.followed)
        peaks = np.abs(found.values)
        metrics: dict[str, float | tuple[float, ...]] = {
            "peak_joint_torques": tuple(peaks.tolist()),
            # A force as the torque that does as much work along the joint path.
            "min_torque_margin": float(((robot.effort_limits - peaks) / robot.joint_weights).min()),
        }
        return Assessment(metrics, tuple(self._failures(samples, found)))

    def _failures(self, samples: Samples, found: Peaks) -> Iterator[Failure]:
        """Yield the joint whose torque exceeds its limit by most."""
        robot, limits = samples.problem.robot, samples.problem.robot.effort_limits
        if not samples.problem.limits.joint_torques:
            return
        torques, times = found
        if (np.abs(torques) <= limits + LIMIT_TOLERANCE).all():
            return
        excess = np.abs(torques) - limits
        joint = int((excess / robot.joint_weights).argmax())
        unit = robot.effort_unit(joint)
        yield Failure(
            Status.TORQUE_TOO_HIGH,
            f"joint {robot.joint_names[joint]} needs {torques[joint]:.4g} {unit}, "
            f"{excess[joint]:.4g} {unit} more than its effort limit of {limits[joint]:g} {unit}, "
            f"at {samples.at(times[joint])}",
            ("a longer duration", "limits.effort none"),
        )


def _peaks(robot: Robot, motion: FollowedMotion) -> Peaks:
    """Return each joint's largest torque, to 5e-4, and its time."""
    torques = joint_torques(robot, motion.q, motion.v, motion.joint_accelerations, motion.maps)
    return peaks_of_steps(torques, motion)
