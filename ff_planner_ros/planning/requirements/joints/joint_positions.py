"""The joints stay within their position limits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.paths.start_motion import FASTEST_CHANGE, least_highest_positions
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.requirement import (
    ALLOWED_EXCESS,
    ANOTHER_DURATION,
    LIMIT_TOLERANCE,
    OF_INTEREST,
    Assessment,
    Requirement,
    Samples,
    eased,
    elsewhere,
)
from ff_planner_ros.robot.configuration import whose_limits
from ff_planner_ros.robot.model import Robot

# Between 50 points the quintics and the cubics that the search knows differ by less [rad].
_MARGIN = 1e-5
# A joint that stops further from its limit than this [rad] after the last point stops soon enough.
_STOP_OF_INTEREST = 1e-3
# A joint moves down and up.
_WAYS = np.array([[-1.0], [1.0]])


class JointPositions(Requirement):
    """The joints stay within their position limits, between the points too."""

    name = "joint_positions"

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a joint outside its limits, or too fast to stop before them."""
        robot = problem.robot
        for joint, (position, lower, upper) in enumerate(
            zip(
                problem.start.joint_positions,
                robot.lower_position_limits,
                robot.upper_position_limits,
                strict=True,
            )
        ):
            if not lower - ALLOWED_EXCESS <= position <= upper + ALLOWED_EXCESS:
                raise InvalidInput(
                    Status.START_OUTSIDE_LIMITS,
                    f"joints.position[{robot.joint_names[joint]}]",
                    f"{position:.6f} {robot.unit(joint)}",
                    f"it must be within the joint's limits [{lower:.6f}, {upper:.6f}] "
                    f"{robot.unit(joint)}{whose_limits(robot, joint)}",
                )
        _require_stops(problem)

    def margin(self, problem: PlanningProblem, settings: PlannerSettings) -> float:
        """Return how far from the limits the search stays [rad]."""
        return _MARGIN

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        robot = problem.robot
        return (
            compiled.positions_within(
                robot.lower_position_limits,
                robot.upper_position_limits,
                excess=ALLOWED_EXCESS,
                margin=margin,
                interest=OF_INTEREST,
                stop_interest=_STOP_OF_INTEREST,
                jerk=FASTEST_CHANGE,
            ),
        )

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return the least distance to the limits, or a positive bound below it [rad, m]."""
        lower, upper = _eased_limits(problem.robot, problem.start.joint_positions)
        distances = motion.joints.least_distances(lower, upper)
        if distances.min() < 0.0:
            distances, _ = motion.joints.distances(lower, upper)
        at_end = _left_at_end(motion.joints, lower, upper)
        return float(min(distances.min(), at_end.min())) + LIMIT_TOLERANCE

    def assess(self, samples: Samples) -> Assessment:
        """Return the least distance to a limit [rad], of prismatic joints by their weight."""
        robot, joints = samples.problem.robot, samples.followed.joints
        lower, upper = robot.lower_position_limits, robot.upper_position_limits
        least = joints.least_distance(lower, upper, 0, robot.joint_weights)
        return Assessment({"min_joint_margin": least}, tuple(self._failures(samples, least)))

    def _failures(self, samples: Samples, least: float) -> Iterator[Failure]:
        """Yield the joint furthest outside, or one that cannot stop inside after the last point."""
        robot = samples.problem.robot
        advice = elsewhere(samples.problem), ANOTHER_DURATION, "more planner.starts"
        lower, upper = robot.lower_position_limits, robot.upper_position_limits
        if least < 0.0:
            distances, times = _distances(robot, samples.followed.joints)
            side, joint = np.unravel_index(distances.argmin(), distances.shape)
            if distances[side, joint] < -ALLOWED_EXCESS:
                unit = robot.unit(int(joint))
                yield Failure(
                    Status.LIMIT_VIOLATED,
                    f"joint {robot.joint_names[joint]} is {-distances[side, joint]:.3g} {unit} "
                    f"outside its limits [{lower[joint]:.4f}, {upper[joint]:.4f}] {unit} at "
                    f"{samples.at(times[side, joint])}{whose_limits(robot, int(joint))}",
                    advice,
                )
        yield from _runs_out(robot, samples.followed.joints, advice)


def _runs_out(robot: Robot, joints: JointMotion, advice: tuple[str, ...]) -> Iterator[Failure]:
    """Yield the joint that no other plan can stop before its limit, where this one ends."""
    lower, upper = robot.lower_position_limits, robot.upper_position_limits
    left = _left_at_end(joints, lower, upper)
    inside = np.array([joints.positions[-1] - lower, upper - joints.positions[-1]])
    left[inside < -ALLOWED_EXCESS] = 0.0  # a joint that ends outside is another failure
    side, joint = np.unravel_index(left.argmin(), left.shape)
    if left[side, joint] < -ALLOWED_EXCESS:
        unit = robot.unit(int(joint))
        yield Failure(
            Status.LIMIT_VIOLATED,
            f"joint {robot.joint_names[joint]} moves at {joints.velocities[-1, joint]:.4f} "
            f"{unit}/s at the last point, {joints.positions[-1, joint]:.4f} {unit}, and cannot "
            f"stop before its limit of {(lower, upper)[side][joint]:.4f} {unit}: no other plan "
            f"can start there{whose_limits(robot, int(joint))}",
            advice,
        )


def _left_at_end(joints: JointMotion, lower: Array, upper: Array) -> Array:
    """Return how far joints that stop after the last point stay from their limits: (2, joints).

    As from a measured start, of which the accelerations are not known.
    """
    p, v, none = joints.positions[-1], joints.velocities[-1], np.zeros(len(lower))
    return np.array([-lower, upper]) - least_highest_positions(_WAYS * p, _WAYS * v, none, np.inf)


def _eased_limits(robot: Robot, at_start: Array) -> tuple[Array, Array]:
    lower = -eased(-robot.lower_position_limits, -at_start)
    return lower, eased(robot.upper_position_limits, at_start)


def _require_stops(problem: PlanningProblem) -> None:
    """Refuse a joint whose motion at the start leads beyond its limits, whatever a plan does."""
    robot, start = problem.robot, problem.start
    positions, rates = start.joint_positions, start.joint_velocities
    accelerations = start.joint_accelerations
    if accelerations is None:
        accelerations = np.zeros(robot.joints)
    highest = least_highest_positions(
        _WAYS * positions, _WAYS * rates, _WAYS * accelerations, problem.duration
    )
    limits = np.array([robot.lower_position_limits, robot.upper_position_limits])
    excess = highest - _WAYS * limits
    side, joint = (int(number) for number in np.unravel_index(excess.argmax(), excess.shape))
    if excess[side, joint] > ALLOWED_EXCESS:
        unit = robot.unit(joint)
        raise InvalidInput(
            Status.START_OUTSIDE_LIMITS,
            f"joints.velocity[{robot.joint_names[joint]}]",
            f"{rates[joint]:.6f} {unit}/s at {positions[joint]:.6f} {unit}",
            f"no plan can stop the joint before its limit of {limits[side, joint]:.6f} {unit}"
            f"{whose_limits(robot, joint)}",
        )


def _distances(robot: Robot, joints: JointMotion) -> tuple[Array, Array]:
    """Return how near each joint comes to both limits, lower first, and when: (2, joints)."""
    return joints.distances(robot.lower_position_limits, robot.upper_position_limits)
