"""The paper's objectives, Eqs. (44) and (45), and their derivatives: what a program minimises.

Throughout, q are configurations, shape (points, 7 + joints), with derivatives `q_sensitivity` in
their tangent space, shape (points, 6 + joints, variables); joint velocities have the shape
(points, joints) [rad/s], and `step` is the time between two points [s].
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ff_planner_ros.core import compiled
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import Objective, PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.limits.wheels import wheels_in_core

# Rotation of the extra joint of `JointPath` [rad]: it makes a path of 1 rad 0.05 % longer.
_ROUNDING = 0.03


def objective_in_core(
    weights: Objective, problem: PlanningProblem, smoothing: float, attitude_norm: float
) -> compiled.PathObjective:
    """Return the objectives of a program as the core has them.

    Args:
        smoothing: Weight of smooth joint velocities relative to the joint path, `JointPath`.
        attitude_norm: p of the p-norm that stands for the largest Euler angle; inf: max terms.
    """
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
    """Return the rate of the one more joint of `JointPath` [rad/s]."""
    return _ROUNDING / duration if smoothing > 0.0 else 0.0


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
