"""Reaction wheels stay within their momentum and torque limits, between the points too.

The search's rows take angular momentum and the torque on the base from inverse dynamics, with exact
derivatives; the check takes both from Pinocchio's centroidal algorithms, and certifies the limits.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import chain_of
from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.motion.wheel_motion import certain_peaks, wheels_along
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.limits.limited import (
    PART_OF_INTEREST,
    Limit,
)
from ff_planner_ros.planning.requirements.limits.loads import LimitedLoads
from ff_planner_ros.planning.requirements.requirement import (
    ALLOWED_EXCESS,
    Assessment,
    Samples,
)
from ff_planner_ros.robot.state import STORED
from ff_planner_ros.robot.wheels import Wheels, momenta_of


class WheelLimits(LimitedLoads):
    """Momentum and torque of each wheel stay within their limits, where it has any."""

    name = "wheels"
    sizes = ("peak_wheel_momenta", "peak_wheel_torques")
    of_each = True

    def refuse(self, problem: PlanningProblem) -> None:
        """Refuse a weight on momentum without wheels."""
        given = problem.objective.wheel_momentum
        if given and problem.robot.wheels is None:
            allowed = f"with robot.base {problem.robot.base} it must be 0: there are no wheels"
            raise InvalidInput(Status.UNSUPPORTED, "objective.wheel_momentum", given, allowed)

    def limits(self, problem: PlanningProblem) -> Sequence[Limit]:
        """Return the limits of momenta and torques, infinite: any; nothing without wheels."""
        wheels = problem.robot.wheels
        if wheels is None or (wheels.momentum is None and wheels.torque is None):
            return ()
        lighter = ["a larger objective.wheel_momentum"]
        if momenta_of(wheels, problem.start).any():
            lighter.insert(0, "wheels that hold less at the start")
        return [
            Limit(
                -limits,
                limits,
                [f"wheel {k + 1}" for k in range(len(limits))],
                verb,
                [unit] * len(limits),
                ("a longer duration", *advice, "more planner.starts"),
            )
            for verb, unit, limits, advice in (
                ("holds", "N m s", wheels.momentum_limits, lighter),
                ("gives", "N m", wheels.torque_limits, ()),
            )
        ]

    def loads(self, problem: PlanningProblem, *motion: Any) -> Sequence[Array]:
        """Return momenta [N m s] and torques [N m]; nothing without wheels."""
        robot, wheels = problem.robot, problem.robot.wheels
        if wheels is None:
            return ()
        return wheels_along(robot, wheels, momenta_of(wheels, problem.start), *motion[:3])

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a start beyond the wheels' limits."""
        wheels, limits = problem.robot.wheels, self.limits(problem)
        if wheels is not None and limits:
            stored = momenta_of(wheels, problem.start)
            fields = [f"{STORED}[{k}]" for k in range(len(stored))]
            limits[0].refuse_start(stored, fields, [f"{held:.6g} N m s" for held in stored])
        super().refuse_start(problem, q_start, settings)

    def assess(self, samples: Samples) -> Assessment:
        """Return the metrics, and what is or may be beyond the limits."""
        found = super().assess(samples)
        if found.failures:
            return found
        return Assessment(found.metrics, tuple(self._uncertain(samples)))

    def _uncertain(self, samples: Samples) -> Iterator[Failure]:
        """Yield the load that may exceed its limit between the times at which none does."""
        problem, motion, limits = samples.problem, samples.followed, self.limits(samples.problem)
        wheels = problem.robot.wheels
        if wheels is None or not limits:
            return
        loads = self.loads(problem, motion.q, motion.v, motion.joint_accelerations, motion.maps)
        most = (limit.certain(load[0]) for limit, load in zip(limits, loads, strict=True))
        allowed = np.concatenate([np.abs(bounds).max(axis=0) for bounds in most])
        certain = certain_peaks(problem.robot, wheels, motion, loads, allowed)
        worst = int((certain / allowed).argmax())
        if certain[worst] > allowed[worst]:
            kind, wheel = divmod(worst, len(limits[0].upper))
            limit, unit = limits[kind], limits[kind].units[wheel]
            yield Failure(
                Status.LIMIT_VIOLATED,
                f"wheel {wheel + 1} may exceed its limit of {limit.upper[wheel]:g} {unit} between "
                f"the points: all that is certain is that it {limit.verb} "
                f"{certain[worst]:.4g} {unit} or less",
                ("more points", *limit.advice),
            )

    def in_core(
        self, problem: PlanningProblem, points: int, margin: float
    ) -> Sequence[compiled.PathRequirement]:
        """Return what makes the rows in the core."""
        wheels = problem.robot.wheels
        if wheels is None:
            return ()
        return (
            compiled.wheels_within(
                wheels_in_core(problem, wheels),
                1.0 / wheels.momentum_limits,
                1.0 / wheels.torque_limits,
                excess=ALLOWED_EXCESS,
                margin=margin,
                interest=PART_OF_INTEREST,
                between=points >= problem.points,
            ),
        )


def exceeds_at_points(problem: PlanningProblem, q: Array, v: Array, accelerations: Array) -> bool:
    """Tell whether a load exceeds its limit at a point, or at a parabola's peak between points.

    Args:
        accelerations: Of the joints. Shape (points, joints) [rad/s2, m/s2].
    """
    wheels = problem.robot.wheels
    if wheels is None or not WheelLimits().concerns(problem):
        return False
    momenta, torques = compiled.held_momenta(chain_of(problem.robot), q, v, accelerations)
    shares = _shares(problem, wheels)
    held = momenta_of(wheels, problem.start) + (momenta[0] - momenta) @ shares.T
    limits = np.concatenate([wheels.momentum_limits, wheels.torque_limits])
    parts = np.abs(np.hstack([held, torques @ shares.T])) / limits
    rises = np.maximum(-np.diff(parts, 2, axis=0) / 8, 0.0)
    return bool((parts[1:-1] + rises > 1.0).any() or (parts[-1] > 1.0).any())


def wheels_in_core(problem: PlanningProblem, wheels: Wheels) -> compiled.Wheels:
    """Return the wheels of a problem as the core has them."""
    return compiled.Wheels(_shares(problem, wheels), momenta_of(wheels, problem.start))


def _shares(problem: PlanningProblem, wheels: Wheels) -> Array:
    """Return the map from momentum in base axes to that of each wheel. Shape (wheels, 3)."""
    shares: Array = wheels.shares @ problem.robot.rotation_chaser_to_base.T
    return shares
