"""Reaction wheels stay within their momentum and torque limits, between the points too.

The search takes angular momentum and the torque on the base from inverse dynamics, with exact
derivatives; the check takes both from Pinocchio's centroidal algorithms, and certifies the limits.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import chain_of
from ff_planner_ros.errors import Failure, InvalidInput, Status
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.motion.wheel_motion import (
    WheelPeaks,
    certain_peaks,
    peaks_of_wheels,
    wheel_peaks,
)
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
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.dynamics import torques_on_base
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import STORED
from ff_planner_ros.robot.wheels import Wheels, momenta_of

# A load further from its limit than this fraction of it cannot reach it in one solver step.
_OF_INTEREST = 0.4
# Loads rise above the parabolas through three points by less, as a fraction of their limits.
_MARGIN = 1e-3
# Names of the rows of torques, above those of momenta.
_TORQUES = 1 << 30


class WheelLimits(Requirement):
    """Momentum and torque of each wheel stay within their limits, where it has any."""

    name = "wheels"
    is_on_demand = True

    def refuse(self, problem: PlanningProblem) -> None:
        """Refuse a weight on momentum without wheels."""
        given = problem.objective.wheel_momentum
        if given and problem.robot.wheels is None:
            allowed = f"with robot.base {problem.robot.base} it must be 0: there are no wheels"
            raise InvalidInput(Status.UNSUPPORTED, "objective.wheel_momentum", given, allowed)

    def refuse_start(
        self, problem: PlanningProblem, q_start: Array, settings: PlannerSettings
    ) -> None:
        """Refuse a start beyond the wheels' limits."""
        wheels = problem.robot.wheels
        if wheels is None:
            return
        stored, limits = momenta_of(wheels, problem.start), wheels.momentum_limits
        most = (1.0 + ALLOWED_EXCESS) * limits + LIMIT_TOLERANCE
        for k in np.flatnonzero(np.abs(stored) > most):
            allowed = f"wheel {k + 1} holds {limits[k]:g} N m s at most, either way"
            raise InvalidInput(
                Status.START_OUTSIDE_LIMITS, f"{STORED}[{k}]", f"{stored[k]:.6g} N m s", allowed
            )
        accelerations = problem.start.joint_accelerations
        if accelerations is None:
            return
        _, v = configuration(problem.robot, problem.start)
        (torques,) = _torques(problem.robot, wheels, q_start[None], v[None], accelerations[None])
        excess = np.abs(torques) - (1.0 + ALLOWED_EXCESS) * wheels.torque_limits
        worst = int(excess.argmax())
        if excess[worst] > LIMIT_TOLERANCE:
            raise InvalidInput(
                Status.START_OUTSIDE_LIMITS,
                "joints.acceleration",
                np.array2string(accelerations, precision=4),
                f"for it wheel {worst + 1} gives {torques[worst]:.4g} N m, and its limit is "
                f"{wheels.torque_limits[worst]:g} N m either way",
            )

    def margin(self, problem: PlanningProblem, settings: PlannerSettings) -> float:
        """Return how far from the limits the search stays, as a fraction of them."""
        return _MARGIN

    def concerns(self, problem: PlanningProblem) -> bool:
        """Tell whether there are wheels with limits."""
        return problem.robot.wheels is not None and _is_limited(problem.robot.wheels)

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
                interest=_OF_INTEREST,
                between=points >= problem.points,
            ),
        )

    def slack(self, problem: PlanningProblem, motion: FollowedMotion) -> float:
        """Return the least distance to a limit, as a fraction of the limit."""
        wheels = problem.robot.wheels
        if wheels is None or not _is_limited(wheels):
            return np.inf
        loads = _loads(problem, wheels, motion.q, motion.v, motion.joint_accelerations)
        peaks = peaks_of_wheels(*loads, motion)
        return min(float(one.left.min()) for one in _judged(wheels, peaks))

    def assess(self, samples: Samples) -> Assessment:
        """Return the largest momentum [N m s] and torque [N m] of each wheel, if there are any."""
        problem, wheels = samples.problem, samples.problem.robot.wheels
        if wheels is None:
            return Assessment()
        found = wheel_peaks(problem.robot, wheels, problem.start, samples.followed)
        metrics = {
            name: tuple(np.abs(peaks.values).tolist())
            for name, peaks in (
                ("peak_wheel_momenta", found.momenta),
                ("peak_wheel_torques", found.torques),
            )
        }
        return Assessment(metrics, tuple(self._failures(samples, wheels, found)))

    def _failures(self, samples: Samples, wheels: Wheels, peaks: WheelPeaks) -> Iterator[Failure]:
        """Yield the wheels that exceed momentum and torque limits by the largest fraction."""
        if not _is_limited(wheels):
            return
        robot, motion = samples.problem.robot, samples.followed
        judged = _judged(wheels, peaks)
        if all((one.left >= 0.0).all() for one in judged):
            limits = np.concatenate([one.limits for one in judged])
            allowed = (1.0 + ALLOWED_EXCESS) * limits + LIMIT_TOLERANCE
            certain = certain_peaks(robot, wheels, motion, peaks, allowed)
            yield from _uncertain(judged, certain, allowed)
            return
        for one in judged:
            wheel = int(one.left.argmin())
            if one.left[wheel] >= 0.0:
                continue
            value, limit = one.values[wheel], one.limits[wheel]
            yield Failure(
                Status.LIMIT_VIOLATED,
                f"wheel {wheel + 1} {one.verb} {value:.4g} {one.unit}, {abs(value) - limit:.3g} "
                f"{one.unit} more than its limit of {limit:g} {one.unit}, at "
                f"{samples.at(float(one.times[wheel]))}",
                ("a longer duration", *one.advice, "more planner.starts"),
            )


class _Judged(NamedTuple):
    """The peaks of one quantity of all wheels, and how far they are from their limits."""

    verb: str
    unit: str
    advice: tuple[str, ...]
    values: Array  # shape (wheels,)
    times: Array  # shape (wheels,) [s]
    limits: Array  # eased for what the start has already; shape (wheels,)
    left: Array  # distances to the limits as fractions of them; shape (wheels,)


def _judged(wheels: Wheels, peaks: WheelPeaks) -> list[_Judged]:
    """Return the peaks of momenta and torques against their limits."""
    holds = "holds", "N m s", ("a larger objective.wheel_momentum",), wheels.momentum_limits
    gives = "gives", "N m", (), wheels.torque_limits
    judged = list[_Judged]()
    for (verb, unit, advice, limits), along, found in zip(
        (holds, gives), peaks.along, (peaks.momenta, peaks.torques), strict=True
    ):
        kept = eased(limits, np.abs(along[0]), ALLOWED_EXCESS * limits)
        left = 1.0 + (LIMIT_TOLERANCE - np.abs(found.values)) / kept
        if advice and along[0].any():
            advice = ("wheels that hold less at the start", *advice)
        judged.append(_Judged(verb, unit, advice, found.values, found.times, kept, left))
    return judged


def _uncertain(judged: Sequence[_Judged], certain: Array, allowed: Array) -> Iterator[Failure]:
    """Yield the load that may exceed its limit between the times at which none does."""
    worst = int((certain / allowed).argmax())
    if certain[worst] > allowed[worst]:
        quantity, wheel = divmod(worst, len(judged[0].values))
        one = judged[quantity]
        yield Failure(
            Status.LIMIT_VIOLATED,
            f"wheel {wheel + 1} may exceed its limit of {one.limits[wheel]:g} {one.unit} between "
            f"the points: all that is certain is that it {one.verb} {certain[worst]:.4g} "
            f"{one.unit} or less",
            ("more points", "a longer duration", *one.advice),
        )


def exceeds_at_points(problem: PlanningProblem, q: Array, v: Array, accelerations: Array) -> bool:
    """Tell whether a load exceeds its limit at a point, or at a parabola's peak between points.

    Args:
        accelerations: Of the joints. Shape (points, joints) [rad/s2, m/s2].
    """
    wheels = problem.robot.wheels
    if wheels is None or not _is_limited(wheels):
        return False
    loads = _loads(problem, wheels, q, v, accelerations)
    limits = np.concatenate([wheels.momentum_limits, wheels.torque_limits])
    parts = np.abs(np.hstack(loads)) / limits
    rises = np.maximum(-np.diff(parts, 2, axis=0) / 8, 0.0)
    return bool((parts[1:-1] + rises > 1.0).any() or (parts[-1] > 1.0).any())


def wheels_in_core(problem: PlanningProblem, wheels: Wheels) -> compiled.Wheels:
    """Return the wheels of a problem as the core has them."""
    return compiled.Wheels(_shares(problem.robot, wheels), momenta_of(wheels, problem.start))


def _loads(
    problem: PlanningProblem, wheels: Wheels, q: Array, v: Array, accelerations: Array
) -> tuple[Array, Array]:
    """Return momentum [N m s] and torque [N m] of each wheel. Each of shape (points, wheels)."""
    chain, shares = chain_of(problem.robot), _shares(problem.robot, wheels)
    momenta, torques = compiled.held_momenta(chain, q, v, accelerations)
    held = momenta_of(wheels, problem.start) + (momenta[0] - momenta) @ shares.T
    return held, -torques @ shares.T


def _torques(robot: Robot, wheels: Wheels, q: Array, v: Array, accelerations: Array) -> Array:
    """Return the torque of each wheel. Shape (points, wheels) [N m]."""
    torques: Array = -torques_on_base(robot, q, v, accelerations) @ _shares(robot, wheels).T
    return torques


def _shares(robot: Robot, wheels: Wheels) -> Array:
    """Return the map from momentum in base axes to that of each wheel. Shape (wheels, 3)."""
    shares: Array = wheels.shares @ robot.rotation_chaser_to_base.T
    return shares


def _is_limited(wheels: Wheels) -> bool:
    return wheels.momentum is not None or wheels.torque is not None
