"""Joint accelerations stay within the limits of the problem, if any; a URDF has none."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.requirement import (
    ALLOWED_EXCESS,
    LIMIT_TOLERANCE,
    Assessment,
    Requirement,
    Samples,
    eased,
)

# An acceleration further from its limit than this fraction of it cannot reach it in one step.
_OF_INTEREST = 0.4
# They rise above the parabolas through three points by less, as a fraction of the limits.
_MARGIN = 1e-3


class JointAccelerations(Requirement):
    """Joint accelerations stay within the limits of the problem, between the points too."""

    name = "joint_accelerations"

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a start whose joint accelerations exceed the limits."""
        limits, accelerations = _limits(problem), problem.start.joint_accelerations
        if limits is None or accelerations is None:
            return
        joint = int((np.abs(accelerations) / limits).argmax())
        unit = f"{problem.robot.unit(joint)}/s2"
        most = (1.0 + ALLOWED_EXCESS) * limits[joint] + LIMIT_TOLERANCE
        if np.abs(accelerations[joint]) > most:
            raise InvalidInput(
                Status.START_OUTSIDE_LIMITS,
                f"joints.acceleration[{problem.robot.joint_names[joint]}]",
                f"{accelerations[joint]:.6f} {unit}",
                f"it must be at most {limits[joint]:.6f} {unit} either way, limits.acceleration",
            )

    def margin(self, problem: PlanningProblem, settings: PlannerSettings) -> float:
        """Return how far from the limits the search stays, as a fraction of them."""
        return _MARGIN

    def concerns(self, problem: PlanningProblem) -> bool:
        """Tell whether accelerations have limits."""
        return _limits(problem) is not None

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        limits = _limits(problem)
        if limits is None:
            return ()
        between = points >= problem.points
        return (compiled.accelerations_within(1.0 / limits, margin, _OF_INTEREST, between),)

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return the least distance to a limit, as a fraction of the limit."""
        limits = _limits(problem)
        if limits is None:
            return np.inf
        if problem.start.joint_accelerations is not None:
            at_start = np.abs(problem.start.joint_accelerations)
            limits = eased(limits, at_start, ALLOWED_EXCESS * limits)
        distances, _ = _distances(limits, motion.joints)
        return float(((distances + LIMIT_TOLERANCE) / limits).min())

    def assess(self, samples: Samples) -> Assessment:
        """Return the least distance to a limit [rad/s2], of prismatic joints by their weight."""
        limits = _limits(samples.problem)
        if limits is None:
            return Assessment()
        weights = samples.problem.robot.joint_weights
        least = samples.followed.joints.least_distance(-limits, limits, 2, weights)
        return Assessment(
            {"min_acceleration_margin": least}, tuple(self._failures(samples, limits))
        )

    def _failures(self, samples: Samples, limits: Array) -> Iterator[Failure]:
        """Yield the joint whose acceleration exceeds its limit by the largest fraction."""
        distances, times = _distances(limits, samples.followed.joints)
        parts = (distances + LIMIT_TOLERANCE) / limits
        if parts.min() >= -ALLOWED_EXCESS:
            return
        side, joint = np.unravel_index(parts.argmin(), parts.shape)
        excess = -distances[side, joint]
        acceleration = (limits[joint] + excess) * (1.0 if side else -1.0)
        unit = f"{samples.problem.robot.unit(int(joint))}/s2"
        yield Failure(
            Status.LIMIT_VIOLATED,
            f"joint {samples.problem.robot.joint_names[joint]} accelerates by "
            f"{acceleration:.4g} {unit}, {excess:.3g} {unit} more than its limit of "
            f"{limits[joint]:.4g} {unit}, at {samples.at(times[side, joint])}",
            ("a longer duration", "a larger limits.acceleration", "more planner.starts"),
        )


def _limits(problem: PlanningProblem) -> Array | None:
    """Return the largest acceleration of each joint [rad/s2, m/s2]; None: any."""
    limits = problem.limits.joint_accelerations
    return None if limits is None else np.array(limits)


def _distances(limits: Array, joints: JointMotion) -> tuple[Array, Array]:
    """Return how near each joint comes to its limit either way, and when, of shape (2, joints)."""
    return joints.distances(-limits, limits, order=2)
