"""A path's program put together by Python: objectives, and the rows of all requirements."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import reference_distance_rows as distances
import reference_goal_rows as goals
import reference_load_rows as loads
import reference_objectives
from core_rows import NO_OBJECTIVE, sensitivity_of
from reference_joint_spline import hulls

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.planning.optimisation.evaluated_path import PathLinearisation, undefined
from ff_planner_ros.planning.optimisation.objectives import _slow
from ff_planner_ros.planning.optimisation.program import _NAMES, Correction, PathProgram
from ff_planner_ros.planning.paths.joint_spline import JointSplines
from ff_planner_ros.planning.paths.path_family import Motion, Sensitivity
from ff_planner_ros.planning.problem.problem import Objective, PlanningProblem
from ff_planner_ros.planning.requirements.requirement import Requirement, Rows

ROWS = {
    "approach": goals.approach,
    "camera": goals.camera,
    "chaser_attitude": goals.chaser_attitude,
    "chaser_rotation": goals.chaser_rotation,
    "grasp_wrench": loads.grasp_wrench,
    "joint_accelerations": loads.joint_accelerations,
    "joint_positions": loads.joint_positions,
    "joint_rates": loads.joint_rates,
    "singular_values": goals.singular_values,
    "torques": loads.torques,
    "wheels": loads.wheels,
}
DISTANCES = {
    "clear_of_itself": distances.clear_of_itself,
    "clear_of_obstacles": distances.clear_of_obstacles,
}


def rows_of(
    required: Requirement,
    problem: PlanningProblem,
    motion: Motion,
    sensitivity: Sensitivity,
    margin: float,
) -> Rows | None:
    """Return the rows of a requirement that is not one of distances; of a plug-in, its own."""
    if not required.concerns(problem):
        return None
    return ROWS.get(required.name, required.rows)(problem, motion, sensitivity, margin)


def distances_of_core(program: PathProgram, required: Requirement, motion: Motion) -> Rows:
    """Return all distances of interest; tests of clearance and bodies have their truth."""
    # Without margins, and nothing may touch.
    problem = replace(program.problem, allowed_collisions=())
    requirements = required.in_core(problem, program.points, 0.0) or ()
    corrected = program.correction
    found = compiled.PathProgram(
        program.family.on_grid(program.points, program.damping),
        1.0,
        NO_OBJECTIVE,
        [(0, one) for one in requirements],
        corrected and compiled.Correction(corrected.q, corrected.v, corrected.q_half_way),
    ).at(motion.x)
    return Rows(found.constraints, found.constraints_jacobian, found.names - _NAMES // 2)


def linearise(program: PathProgram, x: Array) -> PathLinearisation:
    """Return what `PathProgram.linearise` does."""
    motion = program.family.motion(x, program.points, program.damping)
    if motion.singular_at is not None:
        return undefined(motion)
    sensitivity = sensitivity_of(program.family, motion, program.damping)
    if isinstance(program.family, JointSplines):
        motion = loads.WithHulls(**_parts(motion), hulls=hulls(program.family, x))
    problem, step = program.problem, program.problem.duration / (program.points - 1)
    corrected = program.correction
    driven = motion if corrected is None else apply(corrected, problem.robot.model, motion)
    variables = sensitivity.variables
    value, gradient = 0.0, np.zeros(variables)
    hessian = np.zeros((variables, variables))
    max_terms, max_terms_jacobian = [np.empty(0)], [np.empty((0, variables))]
    how = program.smoothing, program.attitude_norm
    for term in terms(program.objective, problem, motion, sensitivity, step, *how):
        value, gradient = value + term.value, gradient + term.gradient
        hessian = hessian + term.hessian
        max_terms.append(term.max_terms)
        max_terms_jacobian.append(term.max_terms_jacobian)
    kept = []
    for number, required in enumerate(program.requirements):
        if required.name in program.on_demand or not required.concerns(problem):
            continue
        margin = program.margins[required.name]
        if required.name in DISTANCES:
            near = distances_of_core(program, required, driven)
            kept.append((number, DISTANCES[required.name](problem, driven, near, margin)))
        elif (found := rows_of(required, problem, driven, sensitivity, margin)) is not None:
            kept.append((number, found))
    return PathLinearisation(
        value=value,
        gradient=gradient,
        hessian=hessian,
        max_terms=np.concatenate(max_terms),
        max_terms_jacobian=np.concatenate(max_terms_jacobian),
        constraints=np.concatenate([np.empty(0), *(found.values for _, found in kept)]),
        constraints_jacobian=np.concatenate(
            [np.empty((0, variables)), *(found.jacobian for _, found in kept)]
        ),
        # Those of a requirement lie on both sides of zero.
        names=np.concatenate(
            [np.empty(0, np.intp), *(of.names + k * _NAMES + _NAMES // 2 for k, of in kept)]
        ),
        equalities=motion.goal_error,
        equalities_jacobian=sensitivity.goal_error,
        motion=motion,
        acceleration=sensitivity.acceleration,
    )


def _parts(motion: Motion) -> dict[str, Any]:
    return {one.name: getattr(motion, one.name) for one in fields(Motion)}


def apply(correction: Correction, model: pin.Model, motion: Motion) -> Motion:
    """Return a motion near the path's, corrected to the controller's interpolation."""
    q, q_half_way = (
        np.array([pin.integrate(model, *at) for at in zip(q, steps, strict=True)])
        for q, steps in ((motion.q, correction.q), (motion.q_half_way, correction.q_half_way))
    )
    return replace(motion, q=q, v=motion.v + correction.v, q_half_way=q_half_way)


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
        of_wheels = loads.loads_with_derivatives(problem, robot.wheels, motion, sensitivity)
        momenta = weights.wheel_momentum * of_wheels.momenta.ravel()
        by_x = weights.wheel_momentum * of_wheels.momenta_by_x.reshape(-1, variables)
        max_terms, jacobian = np.append(momenta, -momenta), np.concatenate([by_x, -by_x])
        return [*found, Term(0.0, nothing[0], nothing, max_terms, jacobian)]  # attitude is held
    weight = weights.chaser_attitude
    if weight > 0.0:
        # The Euler angles whose largest modulus is J_Theta.
        euler, jacobian = reference_objectives.chaser_euler(
            motion.q, sensitivity.q, robot.rotation_chaser_to_base
        )
        euler, jacobian = weight * euler.ravel(), (weight * jacobian).reshape(-1, variables)
        if np.isfinite(attitude_norm):
            value, gradient, hessian = power_mean(euler, jacobian, attitude_norm)
            return [*found, Term(value, gradient, hessian, nothing[0, :0], nothing[:0])]
        max_terms, jacobian = np.append(euler, -euler), np.concatenate([jacobian, -jacobian])
        found.append(Term(0.0, nothing[0], nothing, max_terms, jacobian))
    return found


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
    return reference_objectives.joint_path(v, by_x, step, slow, smoothing)
