"""The joints stay within the velocity limits of the URDF, where the problem limits them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.paths.start_motion import least_highest_rates
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
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.urdf.urdf import NO_VELOCITY_LIMIT

# A velocity below this fraction of its limit cannot reach it in one step of the solver.
_OF_INTEREST = 0.4
# Between 50 points velocities of quintics and of the search's cubics differ by less, as a fraction.
_MARGIN = 1e-4


class JointRates(Requirement):
    """The joints stay within their velocity limits, between the points too."""

    name = "joint_rates"

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a joint that exceeds its velocity limit, or will whatever a plan does."""
        if not problem.limits.joint_velocities:
            return
        robot = problem.robot
        highest_allowed = robot.velocity_limits + _allowed_excess(robot.velocity_limits)
        for joint, (rate, limit) in enumerate(
            zip(problem.start.joint_velocities, robot.velocity_limits, strict=True)
        ):
            unit = robot.unit(joint)
            if not abs(rate) <= highest_allowed[joint]:
                raise InvalidInput(
                    Status.START_OUTSIDE_LIMITS,
                    f"joints.velocity[{robot.joint_names[joint]}]",
                    f"{rate:.6f} {unit}/s",
                    f"it must be at most {limit:.6f} {unit}/s either way, the joint's limit",
                )
        rates, accelerations = problem.start.joint_velocities, problem.start.joint_accelerations
        if accelerations is None:
            return
        # Either way: a joint that is slowed down may turn round.
        highest = np.maximum(
            least_highest_rates(rates, accelerations), least_highest_rates(-rates, -accelerations)
        )
        joint = int((highest / highest_allowed).argmax())
        if highest[joint] > highest_allowed[joint]:
            unit = robot.unit(joint)
            raise InvalidInput(
                Status.START_OUTSIDE_LIMITS,
                f"joints.acceleration[{robot.joint_names[joint]}]",
                f"{accelerations[joint]:.6f} {unit}/s2 at {rates[joint]:.6f} {unit}/s",
                f"no plan can keep the joint within its limit of {robot.velocity_limits[joint]:.6f}"
                f" {unit}/s",
            )

    def margin(self, problem: PlanningProblem, settings: PlannerSettings) -> float:
        """Return how far from the limits the search stays, as a fraction of them."""
        return _MARGIN

    def concerns(self, problem: PlanningProblem) -> bool:
        """Tell whether velocities have limits."""
        return problem.limits.joint_velocities

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        return (
            compiled.rates_within(
                _finite_limits(problem.robot),
                excess=ALLOWED_EXCESS,
                margin=margin,
                interest=1.0 - _OF_INTEREST,
            ),
        )

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return the least distance as a fraction of its limit, or a positive bound below it."""
        if not self.concerns(problem):
            return np.inf
        limits = _finite_limits(problem.robot)
        limits = eased(limits, np.abs(problem.start.joint_velocities), _allowed_excess(limits))
        distances = motion.joints.least_distances(-limits, limits, order=1)
        if distances.min() < 0.0:
            distances, _ = motion.joints.distances(-limits, limits, order=1)
        return float(((distances + LIMIT_TOLERANCE) / limits).min())

    def assess(self, samples: Samples) -> Assessment:
        """Return the least distance to a limit [rad/s], of prismatic joints by their weight."""
        robot, joints = samples.problem.robot, samples.followed.joints
        limits, weights = robot.velocity_limits, robot.joint_weights
        least = joints.least_distance(-limits, limits, 1, weights)
        return Assessment({"min_velocity_margin": least}, tuple(self._failures(samples, least)))

    def _failures(self, samples: Samples, least: float) -> Iterator[Failure]:
        """Yield the joint whose velocity exceeds its limit by the largest fraction."""
        if not samples.problem.limits.joint_velocities or least >= 0.0:
            return
        robot, limits = samples.problem.robot, _finite_limits(samples.problem.robot)
        distances, times = samples.followed.joints.distances(-limits, limits, order=1)
        parts = distances / limits
        if (distances >= -_allowed_excess(limits)).all():
            return
        side, joint = np.unravel_index(parts.argmin(), parts.shape)
        excess = -distances[side, joint]
        rate = (limits[joint] + excess) * (1.0 if side else -1.0)
        moves, unit = ("slides", "m/s") if robot.slides(int(joint)) else ("turns", "rad/s")
        yield Failure(
            Status.LIMIT_VIOLATED,
            f"joint {robot.joint_names[joint]} {moves} at {rate:.4f} {unit}, {excess:.3g} {unit} "
            f"faster than its limit of {limits[joint]:.4f} {unit}, at "
            f"{samples.at(times[side, joint])}",
            ("a longer duration", "more planner.starts"),
        )


def _allowed_excess(limits: Array) -> Array:
    """Return by how much velocities may exceed their limits: a fraction of them, or rounding."""
    return np.maximum(ALLOWED_EXCESS * limits, LIMIT_TOLERANCE)


def _finite_limits(robot: Robot) -> Array:
    """Return the velocity limits; where there is none, one that no motion comes near."""
    return np.minimum(robot.velocity_limits, NO_VELOCITY_LIMIT)
