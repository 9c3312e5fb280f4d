"""Rows of limits of joints, wheels and grasps, by Python."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from reference_dynamics import frame_wrenches_by_x, joint_torques_by_x

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import chain_of
from ff_planner_ros.planning.paths.path_family import Motion, Sensitivity
from ff_planner_ros.planning.paths.start_motion import FASTEST_CHANGE
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.requirements.requirement import (
    ALLOWED_EXCESS,
    OF_INTEREST,
    Rows,
    eased,
)
from ff_planner_ros.robot.dynamics import frame_wrenches, joint_torques
from ff_planner_ros.robot.urdf.payload import payload_frame
from ff_planner_ros.robot.wheels import Wheels, momenta_of

# Rows of loads further from their limit than this part of it are left out.
_OF_INTEREST = 0.4
_STOP_OF_INTEREST = 1e-3
_TORQUES = 1 << 30


@dataclass(frozen=True, eq=False, kw_only=True)
class WithHulls(Motion):
    """A motion of splines."""

    hulls: Sequence[tuple[Array, Array]]  # of `reference_joint_spline`


def torques(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows | None:
    """Return the distances to near limits at the points, as fractions of the limits."""
    robot, step = problem.robot, problem.duration / (len(motion.q) - 1)
    accelerated = accelerations_at_points(motion.q[:, 7:], motion.v[:, 6:], step)
    parts = joint_torques(robot, motion.q, motion.v, accelerated) / robot.effort_limits
    limits, parts = np.full(robot.joints, 1.0 - margin), parts[1:]
    (near,) = np.nonzero((np.abs(parts) > limits - _OF_INTEREST).any(axis=1))
    if not near.size:
        return None
    points = near + 1
    of_q, of_v = sensitivity.q, sensitivity.v
    of_rates = accelerations_by_x(motion, sensitivity, step)
    by_x = np.zeros((*parts.shape, sensitivity.variables))
    by_x[near] = joint_torques_by_x(
        robot,
        *(rows[points] for rows in (motion.q, motion.v, accelerated, of_q, of_v, of_rates)),
    )
    by_x /= robot.effort_limits[:, None]
    return within(parts, by_x, -limits, limits, _OF_INTEREST)


def joint_accelerations(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows | None:
    """Return the distances to near limits at the points, as fractions of the limits."""
    limits = problem.limits.joint_accelerations
    if limits is None:
        return None
    limits = np.array(limits)
    step = problem.duration / (len(motion.q) - 1)
    parts = accelerations_at_points(motion.q[:, 7:], motion.v[:, 6:], step) / limits
    by_x = accelerations_by_x(motion, sensitivity, step) / limits[:, None]
    parts, by_x = raised_at_peaks(problem, parts, by_x)
    most = np.full(len(limits), 1.0 - margin)
    return within(parts[1:], by_x[1:], -most, most, _OF_INTEREST)


def joint_positions(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows:
    """Return the distances to near limits, at points and turning points [rad, m]."""
    at_start = motion.q[0, 7:]
    lower = -eased(-problem.robot.lower_position_limits, -at_start)
    upper = eased(problem.robot.upper_position_limits, at_start)
    lower = lower + np.clip(at_start - lower, 0.0, margin)
    upper = upper - np.clip(upper - at_start, 0.0, margin)
    if isinstance(motion, WithHulls):
        rows = within(*motion.hulls[0], lower, upper, OF_INTEREST)
    else:
        path = motion.q, motion.v, sensitivity.q, sensitivity.v
        step = problem.duration / (len(motion.q) - 1)
        has_duration = sensitivity.goal_motion is not None
        limits = lower, upper, np.full(lower.shape, OF_INTEREST)
        rows = position_rows(*path, step, has_duration, *limits)
    stops = _stops(motion, sensitivity, lower, upper)
    return Rows(*(np.concatenate(both) for both in zip(rows, stops, strict=True)))


def _stops(motion: Motion, sensitivity: Sensitivity, lower: Array, upper: Array) -> Rows:
    """Return what is left to the limits where joints stop after the last point."""
    q, v, by_q, by_v = motion.q[-1:], motion.v[-1:], sensitivity.q[-1:], sensitivity.v[-1:]
    limits = lower, upper, np.full(lower.shape, _STOP_OF_INTEREST)
    values, jacobian, names = stop_rows(q, v, by_q, by_v, FASTEST_CHANGE, *limits)
    # Below those of the turns.
    return Rows(values, jacobian, -2 - 2 * len(motion.q) * len(lower) - names)


def stop_rows(
    q: Array,
    v: Array,
    q_by_x: Array,
    v_by_x: Array,
    jerk: float,
    lower: Array,
    upper: Array,
    interest: Array,
) -> Rows:
    """Return rows of positions where joints come to rest by a jerk after the last point.

    On the way they go by |v| t - jerk t^3 / 6. Names: by side, the lower one first, and joint.
    """
    position, rate = q[-1, 7:], v[-1, 6:]
    time, upward = np.sqrt(2.0 * np.abs(rate) / jerk), rate > 0.0
    left = np.where(upward, upper - position, position - lower)
    left = left - (np.abs(rate) * time - jerk * time**3 / 6.0)
    by_x = q_by_x[-1, 6:] + time[:, None] * v_by_x[-1, 6:]
    (near,) = np.nonzero(left < interest)
    signs = np.where(upward, -1.0, 1.0)[near, None]
    return Rows(left[near], signs * by_x[near], near + len(lower) * upward[near])


class Extremes(NamedTuple):
    """Where cubics from point to point are highest or lowest, or fastest."""

    intervals: Indices
    joints: Indices
    values: Array
    by_x: Array  # shape (extremes, variables)


def position_rows(
    q: Array,
    v: Array,
    q_by_x: Array,
    v_by_x: Array,
    step: float,
    has_duration: bool,
    lower: Array,
    upper: Array,
    interest: Array,
) -> Rows:
    """Return rows of joint positions: at all points but the first, then where cubics turn.

    Args:
        has_duration: Whether the last variable is the duration, of which the step is a part.

    Returns:
        Names of turns are below zero: by side, the upper one first, interval and joint.
    """
    path = q[:, 7:], v[:, 6:], q_by_x[:, 6:], v_by_x[:, 6:]
    way, begin, end = np.diff(path[0], axis=0), step * path[1][:-1], step * path[1][1:]
    # The rate along a cubic, times the step: a s^2 + b s + c.
    a, b = 3.0 * (begin + end) - 6.0 * way, 6.0 * way - 4.0 * begin - 2.0 * end
    with np.errstate(invalid="ignore", divide="ignore"):
        part = -(b + np.copysign(np.sqrt(b**2 - 4.0 * a * begin), b)) / 2.0
        found = [extremes_at(s, path, step, 0, has_duration) for s in (part / a, begin / part)]
    turns = Extremes(*(np.concatenate(both) for both in zip(*found, strict=True)))
    return with_extremes(path[0], path[2], turns, lower, upper, interest)


def rate_rows(
    q: Array,
    v: Array,
    q_by_x: Array,
    v_by_x: Array,
    step: float,
    has_duration: bool,
    lower: Array,
    upper: Array,
    interest: Array,
) -> Rows:
    """Return likewise the rows of joint rates, at points and where cubics are fastest."""
    path = q[:, 7:], v[:, 6:], q_by_x[:, 6:], v_by_x[:, 6:]
    way, begin, end = np.diff(path[0], axis=0) / step, path[1][:-1], path[1][1:]
    with np.errstate(invalid="ignore", divide="ignore"):
        s = (4.0 * begin + 2.0 * end - 6.0 * way) / (6.0 * (begin + end - 2.0 * way))
    peaks = extremes_at(s, path, step, 1, has_duration)
    return with_extremes(path[1], path[3], peaks, lower, upper, interest)


def extremes_at(
    parts: Array,
    path: tuple[Array, Array, Array, Array],
    step: float,
    order: int,
    has_duration: bool,
) -> Extremes:
    """Return values of cubics, or of their rates, at parts of intervals where they are extreme.

    There the part itself does not count in the derivative.

    Args:
        parts: Those not between 0 and 1 are none. Shape (points - 1, joints).
        path: Positions and rates of joints, and their derivatives.
        order: 0: positions, 1: rates.
    """
    at, joint = np.nonzero((parts > 0.0) & (parts < 1.0))
    s = parts[at, joint]
    hermite = np.array([[1, 0, -3, 2], [0, 0, 3, -2], [0, 1, -2, 1], [0, 0, -1, 1]])
    powers = np.array([np.ones_like(s), s, s**2, s**3])
    if order == 1:
        powers = np.array([np.zeros_like(s), np.ones_like(s), 2.0 * s, 3.0 * s**2]) / step
    weights = hermite @ powers
    ends = [(0, at), (0, at + 1), (1, at), (1, at + 1)]
    scales = 1.0, 1.0, step, step
    values = sum(
        scale * weight * path[kind][point, joint]
        for scale, weight, (kind, point) in zip(scales, weights, ends, strict=True)
    )
    by_x = sum(
        scale * weight[:, None] * path[2 + kind][point, joint]
        for scale, weight, (kind, point) in zip(scales, weights, ends, strict=True)
    )
    assert isinstance(values, np.ndarray)
    assert isinstance(by_x, np.ndarray)
    if has_duration:
        # A position keeps its share of both positions, and its share of rates grows; a rate is
        # one by the step less where it is a difference of positions.
        kinds = (2, 3) if order == 0 else (0, 1)
        sign = 1.0 if order == 0 else -1.0
        grown = sum(
            sign * weights[k] * path[ends[k][0]][ends[k][1], joint] * scales[k] / step
            for k in kinds
        )
        by_x[:, -1] += grown / (len(path[0]) - 1)
    return Extremes(at, joint, values, by_x)


def with_extremes(
    values: Array, by_x: Array, extremes: Extremes, lower: Array, upper: Array, interest: Array
) -> Rows:
    """Return the rows at all points but the first, then those of the extremes."""
    at_points = within(values[1:], by_x[1:], lower, upper, interest)
    joints, found = extremes.joints, [at_points]
    for side, sign, limit in ((0, -1.0, upper), (1, 1.0, -lower)):
        left = limit[joints] + sign * extremes.values
        near = left < interest[joints]
        at = side * len(values) + extremes.intervals[near]
        names = -1 - at * len(lower) - joints[near]
        found.append(Rows(left[near], sign * extremes.by_x[near], names))
    return Rows(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def joint_rates(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows | None:
    """Return the distances to near limits, at points and peaks between [rad/s, m/s]."""
    limits = problem.robot.velocity_limits
    interest = (1.0 - _OF_INTEREST) * limits
    at_start = np.abs(motion.v[0, 6:])
    limits = eased(limits, at_start, ALLOWED_EXCESS * limits)
    limits = limits - np.clip(limits - at_start, 0.0, margin * limits)
    if isinstance(motion, WithHulls):
        return within(*motion.hulls[1], -limits, limits, interest)
    path = motion.q, motion.v, sensitivity.q, sensitivity.v
    step = problem.duration / (len(motion.q) - 1)
    has_duration = sensitivity.goal_motion is not None
    return rate_rows(*path, step, has_duration, -limits, limits, interest)


def grasp_wrench(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows | None:
    """Return the distances to near limits at the points, as fractions of the limits."""
    frame, robot = payload_frame(problem.robot), problem.robot
    limits = np.array([problem.limits.grasp_force, problem.limits.grasp_torque])
    if frame is None or not np.isfinite(limits).any():
        return None
    step = problem.duration / (len(motion.q) - 1)
    rates = accelerations_at_points(motion.q[:, 7:], motion.v[:, 6:], step)
    wrenches = frame_wrenches(robot, frame, motion.q, motion.v, rates)
    norms = np.linalg.norm(wrenches.reshape(-1, 2, 3), axis=2)
    parts = norms / limits
    most = 1.0 - margin
    after_start, kinds = np.nonzero(most - parts[1:] < _OF_INTEREST)
    if not after_start.size:
        return None
    found = points, _ = after_start + 1, kinds
    near, by_rates = np.unique(points), accelerations_by_x(motion, sensitivity, step)
    of_x = sensitivity.q, sensitivity.v, by_rates
    by_x = np.zeros((len(parts), 6, sensitivity.variables))
    by_x[near] = frame_wrenches_by_x(
        robot,
        frame,
        *(rows[near] for rows in (motion.q, motion.v, rates, *of_x)),
    )
    ways = wrenches.reshape(-1, 2, 3)[found] / norms[found][:, None]
    by_x = np.einsum("ri,rix->rx", ways, by_x.reshape(len(parts), 2, 3, -1)[found])
    return Rows(
        (most - parts)[found],
        -by_x / limits[kinds][:, None],
        np.ravel_multi_index(found, parts.shape),
    )


def wheels(
    problem: PlanningProblem, motion: Motion, sensitivity: Sensitivity, margin: float
) -> Rows | None:
    """Return the distances to near limits at the points, as fractions of the limits."""
    wheels = problem.robot.wheels
    if wheels is None or not (wheels.momentum is not None or wheels.torque is not None):
        return None
    loads = loads_with_derivatives(problem, wheels, motion, sensitivity)
    limits = wheels.momentum_limits
    parts = loads.momenta / limits
    most = eased(np.ones(parts.shape[1]), np.abs(parts[0]))
    most = most - np.clip(most - np.abs(parts[0]), 0.0, margin)
    of_momenta = _kept(problem, parts, loads.momenta_by_x / limits[:, None], most)
    limits = wheels.torque_limits
    parts, most = loads.torques / limits, np.full(len(most), 1.0 - margin)
    of_torques = _kept(problem, parts, loads.torques_by_x / limits[:, None], most)
    return Rows(
        np.concatenate([of_momenta.values, of_torques.values]),
        np.concatenate([of_momenta.jacobian, of_torques.jacobian]),
        np.concatenate([of_momenta.names, _TORQUES + of_torques.names]),
    )


class WheelLoads(NamedTuple):
    """Momentum and torque of each wheel at the points of a path, and their derivatives by x."""

    momenta: Array  # shape (points, wheels) [N m s]
    momenta_by_x: Array  # shape (points, wheels, variables)
    torques: Array  # likewise [N m]
    torques_by_x: Array


def loads_with_derivatives(
    problem: PlanningProblem, wheels: Wheels, motion: Motion, sensitivity: Sensitivity
) -> WheelLoads:
    """Return the loads of the wheels that hold the chaser's attitude along a path."""
    step = problem.duration / (len(motion.q) - 1)
    accelerations = accelerations_at_points(motion.q[:, 7:], motion.v[:, 6:], step)
    along = [of[:, -problem.robot.joints :] for of in (sensitivity.q, sensitivity.v)]
    along.append(accelerations_by_x(motion, sensitivity, step))
    shares = wheels.shares @ problem.robot.rotation_chaser_to_base.T

    def held(aside: Sequence[Array]) -> Array:
        q, v = motion.q.copy(), motion.v.copy()
        q[:, 7:] += aside[0]
        v[:, 6:] += aside[1]
        return np.array(
            compiled.held_momenta(chain_of(problem.robot), q, v, accelerations + aside[2])
        )

    momenta, torques = held([0.0 * accelerations] * 3)
    by_x = np.empty((*np.shape((momenta, torques)), sensitivity.variables))
    for k in range(sensitivity.variables):  # by differences of order four
        way = [of[..., k] for of in along]
        aside = 1e-3 / max(1.0, *(np.abs(of).max() for of in way))
        near, far = (
            held([times * aside * of for of in way]) - held([-times * aside * of for of in way])
            for times in (1.0, 2.0)
        )
        by_x[..., k] = (8.0 * near - far) / (12.0 * aside)
    return WheelLoads(
        momenta_of(wheels, problem.start) + (momenta[0] - momenta) @ shares.T,
        shares @ (by_x[0, 0] - by_x[0]),
        -torques @ shares.T,
        -shares @ by_x[1],
    )


def _kept(problem: PlanningProblem, parts: Array, by_x: Array, most: Array) -> Rows:
    """Return rows for the loads at all points but the first, as fractions of their limits."""
    parts, by_x = raised_at_peaks(problem, parts, by_x)
    return within(parts[1:], by_x[1:], -most, most, _OF_INTEREST)


def accelerations_at_points(positions: Array, rates: Array, step: float) -> Array:
    """Return accelerations, or their derivatives by x from those of positions and velocities.

    Args:
        positions: At three points or more. Shape (points, ...).
        rates: Time derivatives of `positions`. Shape (points, ...).
        step: Time from point to point [s].
    """
    way, rate = positions / step**2, rates / step
    found = np.empty_like(way)
    found[1:-1] = 2 * (way[2:] - 2 * way[1:-1] + way[:-2]) - (rate[2:] - rate[:-2]) / 2
    for end, inward, sign in ((0, 1, 1), (-1, -1, -1)):
        near, far = end + inward, end + 2 * inward
        of_rates = 6 * rate[end] + 8 * rate[near] + rate[far]
        found[end] = -11.5 * way[end] + 8 * way[near] + 3.5 * way[far] - sign * of_rates
    return found


def accelerations_by_x(motion: Motion, sensitivity: Sensitivity, step: float) -> Array:
    """Return the derivatives of joint accelerations by x. Shape (points, joints, variables)."""
    by_x = accelerations_at_points(sensitivity.q[:, 6:], sensitivity.v[:, 6:], step)
    if sensitivity.goal_motion is not None:  # positions count by 1 / T^2 there, rates by 1 / T
        duration = step * (len(motion.q) - 1)
        slower = accelerations_at_points(-2.0 * motion.q[:, 7:], -motion.v[:, 6:], step)
        by_x[..., -1] += slower / duration
    return by_x


def raised_at_peaks(
    problem: PlanningProblem, values: Array, jacobian: Array
) -> tuple[Array, Array]:
    """Return values at the points of a path, at peaks raised to what they may be in between.

    A parabola through three points exceeds the largest of them, between the outer ones, by an
    eighth of its second difference at most. On fewer points than the plan's, where that is much,
    the values stay what they are.

    Args:
        values: At equal steps of time, with limits on both sides of zero. Shape (points, values).
        jacobian: Shape (points, values, variables).
    """
    if len(values) < problem.points:
        return values, jacobian
    rises, by_x = (-np.diff(at, 2, axis=0) / 8 for at in (values, jacobian))
    is_peak = rises * values[1:-1] > 0.0
    values, jacobian = values.copy(), jacobian.copy()
    values[1:-1][is_peak] += rises[is_peak]
    jacobian[1:-1][is_peak] += by_x[is_peak]
    return values, jacobian


def within(
    values: Array, jacobian: Array, lower: Array, upper: Array, interest: Array | float
) -> Rows:
    """Return the distances to both limits that are below `interest`, as rows; upper limits first.

    Args:
        values: Shape (points, values).
        jacobian: Shape (points, values, variables).
        lower: Shape (values,).
        upper: Shape (values,).
        interest: Shape (values,), or one number for all.
    """
    left = np.array([upper - values, values - lower])
    near = np.nonzero(left < interest)
    side, *at = near
    signs = np.array([-1.0, 1.0])[side, None]
    return Rows(left[near], signs * jacobian[*at], np.ravel_multi_index(near, left.shape))
