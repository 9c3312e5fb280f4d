"""Joint positions, velocities and accelerations stay within limits, between the points too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.paths.start_motion import (
    FASTEST_CHANGE,
    least_highest_positions,
    least_highest_rates,
)
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.limits.limited import (
    PART_OF_INTEREST,
    Extremes,
    Limit,
    Limited,
)
from ff_planner_ros.planning.requirements.requirement import (
    ALLOWED_EXCESS,
    ANOTHER_DURATION,
    OF_INTEREST,
    elsewhere,
)
from ff_planner_ros.robot.configuration import whose_limits
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.urdf.urdf import NO_VELOCITY_LIMIT

# A joint that stops further from its limit than this [rad] after the last point stops soon enough.
_STOP_OF_INTEREST = 1e-3
# A joint moves down and up.
_WAYS = np.array([[-1.0], [1.0]])
# Of positions, velocities and accelerations: field of a start, unit per that of a position, verb.
_KINDS = (
    ("position", "", "is at"),
    ("velocity", "/s", "moves at"),
    ("acceleration", "/s2", "accelerates by"),
)


class JointLimits(Limited):
    """Positions, velocities or accelerations of the joints stay within limits."""

    order: ClassVar[int]  # 0 positions, 1 velocities, 2 accelerations
    metric: ClassVar[str]  # least distance to a limit, of prismatic joints by their weight
    advice: ClassVar[Sequence[str]] = ("a longer duration", "more planner.starts")

    def bounds(self, problem: PlanningProblem) -> tuple[Array, Array] | None:
        """Return the limits that the metric is measured from; None: there is no metric."""
        raise NotImplementedError

    def limits(self, problem: PlanningProblem) -> Sequence[Limit]:
        """Return the limits."""
        bounds, robot, (_, per, verb) = self.bounds(problem), problem.robot, _KINDS[self.order]
        if bounds is None:
            return ()
        return (Limit(*bounds, _names(robot), verb, _units(robot, per), self.advice),)

    def extremes(self, problem: PlanningProblem, motion: FollowedMotion) -> Sequence[Extremes]:
        """Return the extremes of the joints, or bounds that are within the limits already."""
        limits, joints = self.limits(problem), motion.joints
        if not limits:
            return ()
        first = (joints.positions, joints.velocities, joints.accelerations)[self.order][0]
        lowest, highest = quick = joints.bounds(self.order)
        if (lowest >= limits[0].lower).all() and (highest <= limits[0].upper).all():
            return (Extremes(quick, np.full(quick.shape, np.nan), first),)
        return (Extremes(*joints.extremes(self.order), first),)

    def metrics(
        self, problem: PlanningProblem, motion: FollowedMotion, found: Sequence[Extremes]
    ) -> Mapping[str, float]:
        """Return the least distance to a limit, of prismatic joints by their weight."""
        bounds, weights = self.bounds(problem), problem.robot.joint_weights
        if bounds is None:
            return {}
        return {self.metric: motion.joints.least_distance(*bounds, self.order, weights)}

    def unavoidable(self, start: Sequence[Array], duration: float) -> Array | None:
        """Return extremes that no plan from there avoids, (2, joints); None: any can be avoided.

        Args:
            start: Positions, velocities and accelerations of the joints.
        """
        return None

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a joint beyond its limit, or one that will be, whatever a plan does."""
        robot, start, limits = problem.robot, problem.start, self.limits(problem)
        known = start.joint_positions, start.joint_velocities, start.joint_accelerations
        values = known[self.order]
        if not limits or values is None:
            return
        fields, given = _given(robot, self.order, values)
        limits[0].refuse_start(values, fields, given)
        changes = np.zeros(robot.joints) if known[2] is None else known[2]
        extremes = self.unavoidable((*known[:2], changes), problem.duration)
        if extremes is not None:
            by = (*known[:2], changes)[self.order + 1]
            fields, why = _given(robot, self.order + 1, by)
            said = [f"{change} at {value}" for change, value in zip(why, given, strict=True)]
            limits[0].refuse_start(extremes, fields, said, "whatever a plan does,")


class JointPositions(JointLimits):
    """The joints stay within their position limits, and can stop there after the last point."""

    name = "joint_positions"
    order = 0
    metric = "min_joint_margin"
    kept = 1e-5

    def bounds(self, problem: PlanningProblem) -> tuple[Array, Array]:
        """Return the limits of the URDF, and the planner's of continuous joints."""
        return problem.robot.lower_position_limits, problem.robot.upper_position_limits

    def limits(self, problem: PlanningProblem) -> Sequence[Limit]:
        """Return the limits of positions, and of where joints stop after the last point."""
        robot = problem.robot
        return [
            Limit(
                *self.bounds(problem),
                _names(robot),
                verb,
                _units(robot, ""),
                (elsewhere(problem), ANOTHER_DURATION, "more planner.starts"),
                remarks=[whose_limits(robot, k) for k in range(robot.joints)],
                is_relative=False,
            )
            for verb in ("is at", "stops no sooner than at")
        ]

    def extremes(self, problem: PlanningProblem, motion: FollowedMotion) -> Sequence[Extremes]:
        """Return the extremes of the joints, and where those stop that end within their limits.

        Another plan may start there: as at a measured start, accelerations are not known.
        """
        (positions,), joints = super().extremes(problem, motion), motion.joints
        p, v = joints.positions[-1], joints.velocities[-1]
        stops = self.unavoidable((p, v, np.zeros(len(p))), np.inf)
        limits = np.array(self.bounds(problem))
        stops = np.where(_WAYS * (p - limits) > ALLOWED_EXCESS, limits, stops)
        at_end = np.full(stops.shape, joints.time[-1])
        return positions, Extremes(stops, at_end, positions.first)

    def unavoidable(self, start: Sequence[Array], duration: float) -> Array:
        """Return where the joints stop at the latest, down and up."""
        p, v, a = (_WAYS * values for values in start)
        return _WAYS * least_highest_positions(p, v, a, duration)

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        return (
            compiled.positions_within(
                *self.bounds(problem),
                excess=ALLOWED_EXCESS,
                margin=margin,
                interest=OF_INTEREST,
                stop_interest=_STOP_OF_INTEREST,
                jerk=FASTEST_CHANGE,
            ),
        )


class JointRates(JointLimits):
    """The joints stay within the velocity limits of the URDF, where the problem limits them."""

    name = "joint_rates"
    order = 1
    metric = "min_velocity_margin"
    kept = 1e-4

    def bounds(self, problem: PlanningProblem) -> tuple[Array, Array]:
        """Return the limits of the URDF."""
        return -problem.robot.velocity_limits, problem.robot.velocity_limits

    def limits(self, problem: PlanningProblem) -> Sequence[Limit]:
        """Return the limits of the URDF, if the problem limits velocities."""
        return super().limits(problem) if problem.limits.joint_velocities else ()

    def unavoidable(self, start: Sequence[Array], duration: float) -> Array:
        """Return the velocities that accelerations lead to, down and up."""
        _, v, a = (_WAYS * values for values in start)
        return _WAYS * least_highest_rates(v, a)

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        # Where there is no limit, one that no motion comes near.
        limits = np.minimum(problem.robot.velocity_limits, NO_VELOCITY_LIMIT)
        interest = 1.0 - PART_OF_INTEREST
        return (
            compiled.rates_within(limits, excess=ALLOWED_EXCESS, margin=margin, interest=interest),
        )


class JointAccelerations(JointLimits):
    """Joint accelerations stay within the limits of the problem, if any; a URDF has none."""

    name = "joint_accelerations"
    order = 2
    metric = "min_acceleration_margin"
    advice = ("a longer duration", "a larger limits.acceleration", "more planner.starts")

    def bounds(self, problem: PlanningProblem) -> tuple[Array, Array] | None:
        """Return the limits of the problem."""
        limits = problem.limits.joint_accelerations
        return None if limits is None else (-np.array(limits), np.array(limits))

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        parts, between = (
            1.0 / np.array(problem.limits.joint_accelerations),
            points >= problem.points,
        )
        return (compiled.accelerations_within(parts, margin, PART_OF_INTEREST, between),)


def _names(robot: Robot) -> list[str]:
    return [f"joint {name}" for name in robot.joint_names]


def _units(robot: Robot, per: str) -> list[str]:
    return [f"{robot.unit(k)}{per}" for k in range(robot.joints)]


def _given(robot: Robot, order: int, values: Array) -> tuple[list[str], list[str]]:
    """Return the fields of a start with positions or their derivatives, and values in words."""
    field, per, *_ = _KINDS[order]
    fields = [f"joints.{field}[{name}]" for name in robot.joint_names]
    return fields, [
        f"{value:.6f} {unit}" for value, unit in zip(values, _units(robot, per), strict=True)
    ]
