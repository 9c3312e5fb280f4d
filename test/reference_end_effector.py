"""The paper's motions and derivatives by numpy and Pinocchio: what the core is held against."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from reference_velocity_map import VelocityMap, VelocitySolution, stacked

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.runge_kutta import increment
from ff_planner_ros.planning.paths.end_effector_polynomial import EndEffectorPaths
from ff_planner_ros.planning.paths.path_family import Motion, Sensitivity
from ff_planner_ros.planning.paths.polynomial import EndEffectorPolynomial, powers
from ff_planner_ros.planning.paths.start_motion import NullSpaceFade
from ff_planner_ros.robot.rotation import euler_rate_map, euler_rate_map_derivative, skew

# Ascending coefficients of 64 s^3 (1 - s)^3 {1, s, s^2}, a column a term. Shape (9, 3).
_BUMP = 64.0 * np.array([1.0, -3.0, 3.0, -1.0])
FREE_TERM_COEFFICIENTS = np.array(
    [np.concatenate([np.zeros(3 + j), _BUMP, np.zeros(2 - j)]) for j in range(3)]
).T


@dataclass(frozen=True, eq=False, kw_only=True)
class Rollout(Motion):
    """A motion with what its derivatives need."""

    # Tangent steps to the four stages; the last is the step. Shape (points - 1, 4, 6 + joints)
    increments: Array
    # Velocities at four stages a step and at the last point, in order of time, stacked
    stages: VelocitySolution


def motion(
    family: EndEffectorPaths, x: Array, points: int, damping: float = 0.0
) -> Rollout | float:
    """Integrate the motion of one path, or return when it meets a dynamic singularity."""
    model, velocity_map = family.robot.model, VelocityMap(family.robot, damping)
    steps, h = points - 1, family.polynomial.duration / (points - 1)
    half_steps = np.linspace(0.0, 1.0, 2 * points - 1)
    twist = twist_of(family.polynomial, x.reshape(6, 3), half_steps)
    bias: Sequence[Array | None] = [None] * len(half_steps)
    if family.null_space is not None:
        bias = list(faded(family.null_space, half_steps * family.polynomial.duration)[0])
    q = np.empty((points, model.nq))
    increments = np.empty((steps, 4, model.nv))
    solutions: list[VelocitySolution] = []
    velocities: list[Array] = []
    there = q[0] = family.q_start
    for count in range(4 * steps + 1):
        i, stage = divmod(count, 4)
        half_step = 2 * i + (stage + 1) // 2
        solution = velocity_map.regular(there, family.momentum, twist[half_step], bias[half_step])
        if solution is None:
            return float(half_steps[half_step] * family.polynomial.duration)
        solutions.append(solution)
        if i == steps:
            break
        velocities = [*velocities, solution.v] if stage else [solution.v]
        increments[i, stage] = increment(h, velocities)
        there = pin.integrate(model, q[i], increments[i, stage])
        if stage == 3:
            q[i + 1] = there
    stages = stacked(solutions)
    half_way = [pin.integrate(model, *at) for at in zip(q, _half_way(increments), strict=False)]
    return Rollout(
        x=x,
        q=q,
        v=stages.v[::4].copy(),
        q_half_way=np.array(half_way),
        goal_error=np.empty(0),
        increments=increments,
        stages=stages,
    )


def faded(fade: NullSpaceFade, time: Array) -> tuple[Array, Array]:
    """Return z and its derivative, each of shape (times, joints) [rad/s, rad/s2]."""
    u = np.minimum(time / fade.seconds, 1.0)[:, None]
    f = 1.0 - 10.0 * u**3 + 15.0 * u**4 - 6.0 * u**5
    g = u - 6.0 * u**3 + 8.0 * u**4 - 3.0 * u**5
    f_slope = (-30.0 * u**2 + 60.0 * u**3 - 30.0 * u**4) / fade.seconds
    g_slope = 1.0 - 18.0 * u**2 + 32.0 * u**3 - 15.0 * u**4
    z = f * fade.rates + fade.seconds * g * fade.accelerations
    return z, f_slope * fade.rates + g_slope * fade.accelerations


def sensitivity(family: EndEffectorPaths, rollout: Rollout, damping: float = 0.0) -> Sensitivity:
    """Differentiate a regular motion of this family, all steps at once.

    Every stage's displacement and velocity is affine in the sensitivity X of its step's
    first point: [F | G] stands for F X + G. Only the chain from point to point is sequential.
    """
    steps = len(rollout.increments)
    size, h = family.robot.model.nv, family.polynomial.duration / steps
    half_steps = np.linspace(0.0, 1.0, 2 * steps + 1)
    coefficients = rollout.x.reshape(6, 3)
    velocity_map = VelocityMap(family.robot, damping)
    of_q, of_twist = velocity_map.derivatives(rollout.stages)
    twist = twist_derivative(family.polynomial, coefficients, half_steps)

    def velocity(stage: int, displacement: Array) -> Array:
        affine = of_q[stage:-1:4] @ displacement
        half_steps = slice((stage + 1) // 2, (stage + 1) // 2 + 2 * steps, 2)
        affine[:, :, size:] += of_twist[stage:-1:4] @ twist[half_steps]
        return affine

    def displacement(increments: Array, derivative: Array) -> Array:
        by_q, by_increment = _integrate_derivatives(increments[:, :6])
        affine = derivative.copy()
        affine[:, :6] = by_increment @ derivative[:, :6]
        affine[:, :6, :6] += by_q
        affine[:, range(6, size), range(6, size)] += 1.0
        return affine

    v1, v2, _, v4 = (rollout.stages.v[k:-1:4].copy() for k in range(4))
    start = np.zeros((steps, size, size + 18))
    start[:, range(size), range(size)] = 1.0
    d1 = velocity(0, start)
    first, second, third, whole = rollout.increments.transpose(1, 0, 2)
    d_first = h / 2 * d1
    d2 = velocity(1, displacement(first, d_first))
    d_second = h / 2 * d2
    d_second[:, :6] += h**2 / 8 * _bracket_derivative(v1, d1, v2, d2)
    d3 = velocity(2, displacement(second, d_second))
    d4 = velocity(3, displacement(third, h * d3))
    d_whole = h / 6 * (d1 + 2 * d2 + 2 * d3 + d4)
    d_whole[:, :6] += h**2 / 12 * _bracket_derivative(v1, d1, v4, d4)
    step = displacement(whole, d_whole)
    half_way = displacement(_half_way(rollout.increments), (d_first + d_second) / 2)

    q = np.zeros((steps + 1, size, 18))
    for i in range(steps):
        q[i + 1] = step[i, :, :size] @ q[i] + step[i, :, size:]
    twist_rate = acceleration_of(family.polynomial, coefficients, half_steps[::2])
    acceleration = np.einsum("pij,pj->pi", of_q[::4], rollout.v)
    acceleration += np.einsum("pij,pj->pi", of_twist[::4], twist_rate)
    if family.null_space is not None:
        _, bias_rate = faded(family.null_space, half_steps[::2] * family.polynomial.duration)
        at_points = VelocitySolution(*(column[::4] for column in rollout.stages))
        acceleration += np.einsum("pij,pj->pi", velocity_map.of_bias(at_points), bias_rate)
    return Sensitivity(
        q=q,
        v=of_q[::4] @ q + of_twist[::4] @ twist[::2],
        q_half_way=half_way[:, :, :size] @ q[:-1] + half_way[:, :, size:],
        goal_error=np.empty((0, 18)),
        acceleration=acceleration,
    )


def _half_way(increments: Array) -> Array:
    """Return the steps to half-way; the errors of both stages there cancel in their mean."""
    mean: Array = (increments[:, 0] + increments[:, 1]) / 2
    return mean


def _bracket_derivative(a: Array, da: Array, b: Array, db: Array) -> Array:
    """Return the derivative of the bracket [a, b]. Shape (steps, 6, columns)."""
    return _bracket_matrix(a) @ db[:, :6] - _bracket_matrix(b) @ da[:, :6]


def _bracket_matrix(a: Array) -> Array:
    """Return the matrices of the bracket with a base twist. Shape (steps, 6, 6)."""
    matrix = np.zeros((len(a), 6, 6))
    matrix[:, :3, :3] = matrix[:, 3:, 3:] = skew(a[:, 3:6])
    matrix[:, :3, 3:] = skew(a[:, :3])
    return matrix


def _integrate_derivatives(increments: Array) -> tuple[Array, Array]:
    """Return d(q + u)/dq and d(q + u)/du of base steps u. Each of shape (steps, 6, 6)."""
    motions = [pin.Motion(u) for u in increments]
    by_q = np.array([pin.exp6(motion).inverse().action for motion in motions])
    by_increment = np.array([pin.Jexp6(motion) for motion in motions])
    return by_q, by_increment


def twist_of(path: EndEffectorPolynomial, coefficients: Array, s: Array) -> Array:
    """Return linear and angular velocities in the inertial frame. Shape (times, 6)."""
    value, rate, _ = path.components(coefficients, s)
    omega = _apply(path.rotation_outer @ euler_rate_map(value[:, 3:]), rate[:, 3:])
    return np.concatenate([rate[:, :3], omega], axis=1)


def acceleration_of(path: EndEffectorPolynomial, coefficients: Array, s: Array) -> Array:
    """Return linear and angular accelerations in the inertial frame. Shape (times, 6)."""
    value, rate, acceleration = path.components(coefficients, s)
    euler, euler_rate = value[:, 3:], rate[:, 3:]
    alpha = _apply(euler_rate_map(euler), acceleration[:, 3:])
    alpha += _apply(euler_rate_map_derivative(euler, euler_rate), euler_rate)
    return np.concatenate([acceleration[:, :3], alpha @ path.rotation_outer.T], axis=1)


def twist_derivative(path: EndEffectorPolynomial, coefficients: Array, s: Array) -> Array:
    """Return d twist / d coefficients, these flattened. Shape (times, 6, 18)."""
    value, rate, _ = path.components(coefficients, s)
    euler, euler_rate = value[:, 3:], rate[:, 3:]
    of_value = powers(s, 0) @ FREE_TERM_COEFFICIENTS
    of_rate = powers(s, 1) @ FREE_TERM_COEFFICIENTS / path.duration
    derivative = np.zeros((len(s), 6, 6, 3))
    for k in range(3):
        derivative[:, k, k] = of_rate
    derivative[:, 3:, 3:] = np.einsum("tij,tk->tijk", euler_rate_map(euler), of_rate)
    derivative[:, 3:, 3:] += np.einsum(
        "tij,tk->tijk", euler_rate_map_derivative(euler, euler_rate), of_value
    )
    derivative[:, 3:] = np.einsum("ij,tjck->tick", path.rotation_outer, derivative[:, 3:])
    return derivative.reshape(len(s), 6, 18)


def _apply(matrices: Array, vectors: Array) -> Array:
    """Return the product of each matrix with its vector. Shape (times, 3)."""
    product: Array = np.einsum("tij,tj->ti", matrices, vectors)
    return product
