"""The joints stay within their position limits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ff_planner_ros.arrays import Array
from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.metrics import Metrics
from ff_planner_ros.planning.path_family import Motion, Sensitivity
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.requirements.requirement import (
    LIMIT_TOLERANCE,
    OF_INTEREST,
    Requirement,
    Rows,
    Samples,
    within,
)
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.planning.start_motion import ALLOWED_EXCESS, least_highest_positions


class JointPositions(Requirement):
    """The joints stay within their position limits at the points."""

    name = "joint_positions"

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a joint outside its limits, or one that cannot stop before them."""
        robot = problem.robot
        for name, position, lower, upper in zip(
            robot.joint_names,
            problem.start.joint_positions,
            robot.lower_position_limits,
            robot.upper_position_limits,
            strict=True,
        ):
            if not lower - LIMIT_TOLERANCE <= position <= upper + LIMIT_TOLERANCE:
                raise InvalidInput(
                    Status.START_OUTSIDE_LIMITS,
                    f"joints.position[{name}]",
                    f"{position:.6f} rad",
                    f"it must be within the joint's limits [{lower:.6f}, {upper:.6f}] rad",
                )
        _require_stops(problem)

    def rows(
        self, problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
    ) -> Rows:
        """Return the distances of interest to the limits [rad]."""
        lower, upper = problem.robot.lower_position_limits, problem.robot.upper_position_limits
        return within(motion.q[1:, 7:], sensitivity.q[1:, 6:], lower, upper, OF_INTEREST)

    def metrics(self, samples: Samples) -> Mapping[str, float]:
        """Return the distance to the nearest limit."""
        robot, joints = samples.problem.robot, samples.trajectory.joint_positions
        margins = np.minimum(
            robot.upper_position_limits - joints, joints - robot.lower_position_limits
        )
        return {"min_joint_margin": float(margins.min())}

    def failures(self, samples: Samples, metrics: Metrics) -> Iterator[Failure]:
        """Yield the joint that is furthest outside."""
        if metrics.min_joint_margin >= -LIMIT_TOLERANCE:
            return
        robot, joints = samples.problem.robot, samples.trajectory.joint_positions
        lower, upper = robot.lower_position_limits, robot.upper_position_limits
        excess = np.maximum(joints - upper, lower - joints)
        point, joint = np.unravel_index(excess.argmax(), excess.shape)
        yield Failure(
            Status.LIMIT_VIOLATED,
            f"joint {robot.joint_names[joint]} is {excess[point, joint]:.3g} rad outside its "
            f"limits [{lower[joint]:.4f}, {upper[joint]:.4f}] rad at {samples.when(point)}",
            ("another goal orientation, start posture or duration", "more planner.starts"),
        )


def _require_stops(problem: PlanningProblem) -> None:
    """Refuse a joint whose motion at the start leads beyond its limits, whatever a plan does."""
    robot, start = problem.robot, problem.start
    positions, rates = start.joint_positions, start.joint_velocities
    accelerations = start.joint_accelerations
    if accelerations is None:
        accelerations = np.zeros(robot.joints)
    for sign, limits in (
        (1.0, robot.upper_position_limits),
        (-1.0, robot.lower_position_limits),
    ):
        highest = least_highest_positions(
            sign * positions, sign * rates, sign * accelerations, problem.duration
        )
        excess = highest - sign * limits
        joint = int(excess.argmax())
        if excess[joint] > ALLOWED_EXCESS:
            raise InvalidInput(
                Status.START_OUTSIDE_LIMITS,
                f"joints.velocity[{robot.joint_names[joint]}]",
                f"{rates[joint]:.6f} rad/s at {positions[joint]:.6f} rad",
                f"no plan can stop the joint before its limit of {limits[joint]:.6f} rad",
            )
