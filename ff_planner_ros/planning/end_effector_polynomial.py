"""The paper's path family: the motions that follow from polynomial paths of the end effector.

At each stage of a Runge-Kutta step the velocity map gives joint rates and chaser twist, Eqs. (27)
and (31). Start and goal fix the end effector's pose, twist and acceleration at both ends, whatever
the decision variables are. Null-space motion of the start fades on the way.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, cast

import numpy as np
import pinocchio as pin

from ff_planner_ros.arrays import Array
from ff_planner_ros.planning.detours import detours, scattered
from ff_planner_ros.planning.path_family import Motion, Sensitivity
from ff_planner_ros.planning.polynomial import (
    COMPONENTS,
    DIRECTIONS,
    FREE_TERMS,
    PARAMETERS,
    EndEffectorMotion,
    EndEffectorPolynomial,
    end_effector_polynomials,
)
from ff_planner_ros.planning.problem import Orientation, PlanningProblem, Sphere, Target
from ff_planner_ros.planning.runge_kutta import increment
from ff_planner_ros.planning.start_motion import NullSpaceFade, start_motion
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.rotation import skew
from ff_planner_ros.robot.velocity_map import VelocityMap, VelocitySolution, stacked

# An end effector's pose takes as many joints at least.
PAPERS_JOINTS = 6


@dataclass(frozen=True, eq=False, kw_only=True)
class Rollout(Motion):
    """A motion with what its derivatives need."""

    # Tangent steps to the four stages; the last is the step. Shape (points - 1, 4, 6 + joints)
    increments: Array
    # Velocities at four stages a step and at the last point, in order of time, stacked
    stages: VelocitySolution


@dataclass(frozen=True, eq=False)
class EndEffectorPaths:
    """The motions of one robot from one start, one for each choice of 18 coefficients."""

    robot: Robot
    q_start: Array  # configuration at the first point; shape (7 + joints,)
    momentum: Array  # constant total P and L about the inertial origin; shape (6,)
    polynomial: EndEffectorPolynomial
    null_space: NullSpaceFade | None = None  # what the start has beyond Eq. (31); None: nothing
    # By damping. Their scratch space serves one thread, and so does a family.
    _velocity_maps: dict[float, VelocityMap] = field(default_factory=dict, init=False, repr=False)

    name: ClassVar[str] = "end_effector_polynomial"
    variables: ClassVar[int] = PARAMETERS  # coefficients of six components
    stride: ClassVar[float] = 1.0
    directions: ClassVar[Array] = DIRECTIONS

    @property
    def reading(self) -> str:
        """How the Euler angles are read: `inertial` or `along_turn`."""
        return self.polynomial.reading

    def decision_variables(self, x: Array) -> Array:
        """Return the paper's xi: a6, a7, a8 of each component, Eq. (42). Shape (18,)."""
        return self.polynomial.decision_variables(x.reshape(COMPONENTS, FREE_TERMS))

    def first_guesses(
        self, obstacles: Sequence[Sphere], points: int, damping: float
    ) -> Iterator[Array]:
        """Yield the straight path, detours around what blocks it, and others without end."""
        straight = np.zeros(PARAMETERS)
        yield straight
        motion = self.motion(straight, points, damping)
        if motion.singular_at is None:
            yield from detours(self.robot, motion, self.polynomial.duration, obstacles)
        yield from scattered()

    def towards(self, target: Target) -> EndEffectorPaths:
        """Return the motions to a target near this one; the coefficients keep their meaning."""
        return replace(self, polynomial=self.polynomial.towards(_end(target)))

    def motion(self, x: Array, points: int, damping: float = 0.0) -> Motion:
        """Integrate the motion of one path; x: coefficients of the free terms, flattened."""
        model, velocity_map = self.robot.model, self._velocity_map(damping)
        steps, h = points - 1, self.polynomial.duration / (points - 1)
        half_steps = np.linspace(0.0, 1.0, 2 * points - 1)
        twist = self.polynomial.twist(x.reshape(COMPONENTS, FREE_TERMS), half_steps)
        bias: Sequence[Array | None] = [None] * len(half_steps)
        if self.null_space is not None:
            bias = list(self.null_space.at(half_steps * self.polynomial.duration)[0])
        q = np.empty((points, model.nq))
        increments = np.empty((steps, 4, model.nv))
        solutions: list[VelocitySolution] = []
        velocities: list[Array] = []
        there = q[0] = self.q_start
        for count in range(4 * steps + 1):
            i, stage = divmod(count, 4)
            half_step = 2 * i + (stage + 1) // 2
            solution = velocity_map.regular(there, self.momentum, twist[half_step], bias[half_step])
            if solution is None:
                time = half_steps[half_step] * self.polynomial.duration
                return _ended(x, time)
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

    def sensitivity(self, motion: Motion, damping: float = 0.0) -> Sensitivity:
        """Differentiate a regular motion of this family, all steps at once.

        Every stage's displacement and velocity is affine in the sensitivity X of its step's
        first point: [F | G] stands for F X + G. Only the chain from point to point is sequential.
        """
        rollout = cast(Rollout, motion)
        steps = len(rollout.increments)
        size, h = self.robot.model.nv, self.polynomial.duration / steps
        half_steps = np.linspace(0.0, 1.0, 2 * steps + 1)
        coefficients = rollout.x.reshape(COMPONENTS, FREE_TERMS)
        velocity_map = self._velocity_map(damping)
        of_q, of_twist = velocity_map.derivatives(rollout.stages)
        twist = self.polynomial.twist_derivative(coefficients, half_steps)

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
        start = np.zeros((steps, size, size + PARAMETERS))
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

        q = np.zeros((steps + 1, size, PARAMETERS))
        for i in range(steps):
            q[i + 1] = step[i, :, :size] @ q[i] + step[i, :, size:]
        twist_rate = self.polynomial.acceleration(coefficients, half_steps[::2])
        acceleration = np.einsum("pij,pj->pi", of_q[::4], rollout.v)
        acceleration += np.einsum("pij,pj->pi", of_twist[::4], twist_rate)
        if self.null_space is not None:
            _, bias_rate = self.null_space.at(half_steps[::2] * self.polynomial.duration)
            at_points = VelocitySolution(*(column[::4] for column in rollout.stages))
            acceleration += np.einsum("pij,pj->pi", velocity_map.of_bias(at_points), bias_rate)
        return Sensitivity(
            q=q,
            v=of_q[::4] @ q + of_twist[::4] @ twist[::2],
            q_half_way=half_way[:, :, :size] @ q[:-1] + half_way[:, :, size:],
            goal_error=np.empty((0, PARAMETERS)),
            acceleration=acceleration,
        )

    def _velocity_map(self, damping: float) -> VelocityMap:
        if damping not in self._velocity_maps:
            self._velocity_maps[damping] = VelocityMap(self.robot, damping)
        return self._velocity_maps[damping]


def applies(problem: PlanningProblem) -> bool:
    """Tell whether arm, base and target are such that these motions are defined."""
    return (
        problem.robot.joints >= PAPERS_JOINTS
        and problem.robot.base is Base.FREE_FLYER
        and problem.target.orientation is Orientation.FIXED
    )


def end_effector_families(problem: PlanningProblem) -> list[EndEffectorPaths]:
    """Return the paper's family of motions from the start state to the target.

    Where the end effector has half a turn to make there are two of them, a way round each.
    """
    start = start_motion(problem.robot, problem.start, problem.duration)
    end = _end(problem.target)
    return [
        EndEffectorPaths(problem.robot, start.q, start.momentum, polynomial, start.null_space)
        for polynomial in end_effector_polynomials(start.end_effector, end, problem.duration)
    ]


def end_effector_paths(problem: PlanningProblem) -> EndEffectorPaths:
    """Return the first, and nearly always the only one, of `end_effector_families`."""
    return end_effector_families(problem)[0]


def _end(target: Target) -> EndEffectorMotion:
    """Return the end effector's motion at the target."""
    return EndEffectorMotion(
        position=target.position,
        rotation_ee_to_inertial=pin.Quaternion(target.quaternion_xyzw).toRotationMatrix(),
        twist=np.concatenate([target.linear_velocity, target.angular_velocity]),
        acceleration=np.concatenate([target.linear_acceleration, target.angular_acceleration]),
    )


def _ended(x: Array, time: float) -> Motion:
    """Return a motion that meets a singularity, as a status."""
    nothing = np.empty(0)
    return Motion(
        x=x, q=nothing, v=nothing, q_half_way=nothing, goal_error=nothing, singular_at=time
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
