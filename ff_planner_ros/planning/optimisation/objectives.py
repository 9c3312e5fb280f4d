"""The paper's objectives, Eqs. (44) and (45), and their derivatives: what a program minimises.

Throughout, q are configurations, shape (points, 7 + joints), with derivatives `q_sensitivity` in
their tangent space, shape (points, 6 + joints, variables); joint velocities have the shape
(points, joints) [rad/s], and `step` is the time between two points [s].
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.planning.motion.measures import chaser_euler_with_derivative
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.paths.path_family import Motion, Sensitivity
from ff_planner_ros.planning.problem.problem import Objective, PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.wheels import loads_with_derivatives, wheels_in_core

# Rotation of the extra joint of `joint_path` [rad]: it makes a path of 1 rad 0.05 % longer.
_ROUNDING = 0.03


class Term(NamedTuple):
    """The contribution of one objective to a program: f plus the largest max term."""

    value: float  # f
    gradient: Array  # of f; shape (variables,)
    hessian: Array  # Gauss-Newton approximation for f; shape (variables, variables)
    max_terms: Array  # shape (max terms,), may be empty
    max_terms_jacobian: Array  # shape (max terms, variables)


def terms(
    weights: Objective,
    problem: PlanningProblem,
    motion: Motion,
    sensitivity: Sensitivity,
    step: float,
    smoothing: float = 0.0,
    attitude_norm: float = np.inf,
) -> list[Term]:
    """Return the terms of all objectives that have a weight.

    Args:
        smoothing: Weight of smooth joint velocities relative to the joint path; see `joint_path`.
        attitude_norm: p of the p-norm that approximates the largest Euler angle; inf: max terms.
    """
    found, robot = [], problem.robot
    variables = sensitivity.variables
    weight, nothing = weights.joint_path_length, np.zeros((variables, variables))
    if weight > 0.0:
        v, by_x, duration = motion.v, sensitivity.v, (len(motion.v) - 1) * step
        if sensitivity.goal_motion is not None:
            # In normalised time the path is as long, and does not depend on the duration.
            by_x = duration * by_x
            by_x[..., -1] += v
            v, step = duration * v, step / duration
        shares = robot.joint_weights if robot.has_slides else None
        value, gradient, hessian = joint_path(v, by_x, step, smoothing, shares)
        value = weight * value
        found.append(Term(value, weight * gradient, weight * hessian, nothing[0, :0], nothing[:0]))
    if weights.wheel_momentum > 0.0 and robot.wheels is not None:
        loads = loads_with_derivatives(problem, robot.wheels, motion, sensitivity)
        momenta = weights.wheel_momentum * loads.momenta.ravel()
        by_x = weights.wheel_momentum * loads.momenta_by_x.reshape(-1, variables)
        max_terms, jacobian = np.append(momenta, -momenta), np.concatenate([by_x, -by_x])
        return [*found, Term(0.0, nothing[0], nothing, max_terms, jacobian)]  # attitude is held
    weight = weights.chaser_attitude
    if weight > 0.0:
        # The Euler angles whose largest modulus is J_Theta.
        euler, jacobian = chaser_euler_with_derivative(robot, motion.q, sensitivity.q)
        euler, jacobian = weight * euler.ravel(), (weight * jacobian).reshape(-1, variables)
        if np.isfinite(attitude_norm):
            value, gradient, hessian = power_mean(euler, jacobian, attitude_norm)
            return [*found, Term(value, gradient, hessian, nothing[0, :0], nothing[:0])]
        max_terms, jacobian = np.append(euler, -euler), np.concatenate([jacobian, -jacobian])
        found.append(Term(0.0, nothing[0], nothing, max_terms, jacobian))
    return found


def objective_in_core(
    weights: Objective, problem: PlanningProblem, smoothing: float, attitude_norm: float
) -> compiled.PathObjective:
    """Return the objectives of `terms` as the core has them."""
    robot, wheels = problem.robot, problem.robot.wheels
    shares = np.append(np.ones(6), robot.joint_weights) if robot.has_slides else np.empty(0)
    return compiled.PathObjective(
        joint_path=weights.joint_path_length,
        slow=_slow(problem.duration, smoothing),
        smoothing=smoothing,
        shares=shares,
        attitude=weights.chaser_attitude,
        rotation_chaser_to_base=robot.rotation_chaser_to_base,
        attitude_norm=attitude_norm if np.isfinite(attitude_norm) else 0.0,
        wheel_momentum=weights.wheel_momentum,
        wheels=None if wheels is None else wheels_in_core(problem, wheels),
    )


def _slow(duration: float, smoothing: float) -> float:
    """Return the rate of the one more joint of `joint_path` [rad/s]."""
    return _ROUNDING / duration if smoothing > 0.0 else 0.0


def power_mean(values: Array, jacobian: Array, p: float) -> tuple[float, Array, Array]:
    """Return (mean |values|^p)^(1/p), its gradient and its Gauss-Newton Hessian.

    It is smooth where its limit for large p, the largest modulus, has kinks. The Hessian is exact
    if the values are linear in x, and positive semidefinite because a norm is convex.

    Args:
        values: Shape (values,).
        jacobian: Shape (values, variables).
        p: Two or more.
    """
    largest = float(np.abs(values).max())
    if largest == 0.0:
        nothing = np.zeros(jacobian.shape[1])
        return 0.0, nothing, np.outer(nothing, nothing)
    parts = values / largest
    mean = float(np.mean(np.abs(parts) ** p)) ** (1.0 / p)
    shares = parts / mean
    slopes = np.sign(shares) * np.abs(shares) ** (p - 1.0) / len(values)
    gradient = jacobian.T @ slopes
    curved = jacobian * (np.abs(shares) ** (p - 2.0) / len(values))[:, None]
    value = largest * mean
    hessian = (p - 1.0) / value * (curved.T @ jacobian - np.outer(gradient, gradient))
    return value, gradient, hessian


def with_tie_break(objective: Objective, settings: PlannerSettings) -> Objective:
    """Return the objective for a given duration, with a small joint path weight if it has none."""
    if objective.joint_path_length > 0.0:
        return objective
    if objective.only_duration:  # which is decided
        return replace(objective, joint_path_length=1.0)
    weight = max(objective.chaser_attitude, objective.wheel_momentum)
    tie_break = settings.joint_path_tie_break * weight
    return replace(objective, joint_path_length=tie_break)


def weighted_sum(objective: Objective, metrics: Metrics) -> float:
    """Return the objective value of a plan with these metrics, without its duration [rad]."""
    length = objective.joint_path_length * metrics.joint_path_length
    wheels = objective.wheel_momentum * max(metrics.peak_wheel_momenta, default=0.0)
    return length + objective.chaser_attitude * metrics.max_chaser_euler + wheels


def duration_of(plan: Plan) -> float:
    """Return the time from the first point to the goal of a plan without post-goal segment [s]."""
    return float(plan.trajectory.time[-1]) if plan.duration is None else plan.duration


def plan_cost(objective: Objective, plan: Plan) -> float:
    """Return the objective value of a plan, its weighted duration included [rad]."""
    return weighted_sum(objective, plan.metrics) + objective.duration * duration_of(plan)


def joint_path(
    v: Array,
    by_x: Array,
    step: float,
    smoothing: float = 0.0,
    weights: Array | None = None,
) -> tuple[float, Array, Array]:
    """Return J_L of Eq. (44), its gradient and its Gauss-Newton Hessian, positive semidefinite.

    With smoothing s > 0 two terms are added. The first is s T times the integral of the squared
    joint velocities (trapezoidal rule): s times the squared joint path if the joints move uniformly
    along a straight line, more otherwise. The second is one more joint at a small constant
    velocity: it rounds the kink that J_L has where all joints stop at once and turn back, and where
    the solver stalls.

    Args:
        v: Tangent velocities. Shape (points, 6 + joints).
        by_x: Their derivatives. Shape (points, 6 + joints, variables).
        step: Time between two points [s].
        smoothing: s.
        weights: Weight of each joint. Shape (joints,). None: 1.
    """
    if weights is not None:
        shares = np.append(np.ones(6), weights)
        v, by_x = shares * v, shares[:, None] * by_x
    slow = _slow((len(v) - 1) * step, smoothing)
    return compiled.joint_path(v, by_x, step, slow, smoothing)
