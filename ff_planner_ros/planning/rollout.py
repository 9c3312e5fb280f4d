"""The motion that follows from an end-effector path: RK4 on the configuration manifold.

At each stage the velocity map gives joint rates and chaser twist, Eqs. (27) and (31). The base
moves on SE(3), where Runge-Kutta's weighted sum of velocities alone has order two; the brackets
of Munthe-Kaas restore order four [Munthe-Kaas, High order Runge-Kutta methods on manifolds,
Appl. Numer. Math. 29, 1999].
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ff_planner_ros.arrays import Array
from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.planning.polynomial import PARAMETERS, EndEffectorPolynomial
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.rotation import skew
from ff_planner_ros.robot.velocity_map import VelocityMap, VelocitySolution

# Faster than this no arm in space moves, by an order of magnitude; the velocity map says so only
# next to a dynamic singularity [rad/s].
_SINGULAR_JOINT_RATE = 10.0


@dataclass(frozen=True, eq=False)
class Rollout:
    """The motion at each point, as Pinocchio writes it.

    Attributes:
        s: Normalised times of the points. Shape (points,).
        q: Configurations. Shape (points, 7 + joints).
        v: Tangent velocities. Shape (points, 6 + joints).
        q_half_way: Configurations half-way between the points, of order three. Shape
            (points - 1, 7 + joints).
        coefficients: Of the end-effector path. Shape (6, 3).
        increments: Tangent steps to the stages of each step. Shape (points - 1, 4, 6 + joints);
            the last is the step itself.
        stages: Four solutions a step and one at the last point, in order of time.
    """

    s: Array
    q: Array
    v: Array
    q_half_way: Array
    coefficients: Array
    increments: Array
    stages: list[VelocitySolution]


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Derivatives of a rollout with respect to the 18 coefficients, exact as discretised.

    Attributes:
        q: In the tangent space at each point. Shape (points, 6 + joints, 18).
        v: Shape (points, 6 + joints, 18).
        q_half_way: Shape (points - 1, 6 + joints, 18).
        acceleration: dv/dt itself at each point. Shape (points, 6 + joints).
    """

    q: Array
    v: Array
    q_half_way: Array
    acceleration: Array


class RolloutModel:
    """Rolls out end-effector paths of one robot from one start.

    Owns scratch space: one object serves one thread.
    """

    def __init__(
        self,
        robot: Robot,
        q_start: Array,
        momentum: Array,
        polynomial: EndEffectorPolynomial,
        points: int,
        damping: float = 0.0,
    ) -> None:
        """Fix everything but the coefficients.

        Args:
            q_start: Configuration at the first point. Shape (7 + joints,).
            momentum: Constant total P and L about the inertial origin. Shape (6,).
            points: Number of points, at least 2.
            damping: Of the velocity map; a damped rollout leaves its path near a singularity
                instead of ending there.
        """
        self._robot = robot
        self._velocity_map = VelocityMap(robot, damping)
        self._q_start = q_start
        self._momentum = momentum
        self.polynomial = polynomial
        self._half_steps = np.linspace(0.0, 1.0, 2 * points - 1)
        self._step = polynomial.duration / (points - 1)

    def roll_out(self, coefficients: Array) -> Rollout:
        """Integrate the motion for one path.

        Args:
            coefficients: Of the free terms. Shape (6, 3).

        Raises:
            NoPlanFound: The path meets a dynamic singularity.
        """
        model, h = self._robot.model, self._step
        twist = self.polynomial.twist(coefficients, self._half_steps)
        steps = len(self._half_steps) // 2
        q = np.empty((steps + 1, model.nq))
        increments = np.empty((steps, 4, model.nv))
        stages: list[VelocitySolution] = []
        q[0] = self._q_start
        for i in range(steps):

            def velocity(stage: int, at: Array, i: int = i) -> Array:
                return self._stage(stages, at, twist, 2 * i + (stage + 1) // 2)

            increments[i] = runge_kutta_step(model, q[i], h, velocity)
            q[i + 1] = pin.integrate(model, q[i], increments[i, 3])
        self._stage(stages, q[-1], twist, 2 * steps)
        half_way = _half_way(increments)
        return Rollout(
            s=self._half_steps[::2],
            q=q,
            v=np.array([stage.v for stage in stages[::4]]),
            q_half_way=np.array(
                [pin.integrate(model, *at) for at in zip(q, half_way, strict=False)]
            ),
            coefficients=coefficients,
            increments=increments,
            stages=stages,
        )

    def _stage(
        self, stages: list[VelocitySolution], q: Array, twist: Array, half_step: int
    ) -> Array:
        """Evaluate and keep the velocity map at one stage."""
        duration = self.polynomial.duration
        time = self._half_steps[half_step] * duration
        solution = regular_velocity(
            self._velocity_map, q, self._momentum, twist[half_step], time, duration
        )
        stages.append(solution)
        return solution.v

    def sensitivity(self, rollout: Rollout) -> Sensitivity:
        """Differentiate a rollout of this model, all steps at once.

        Every stage's displacement and velocity is affine in the sensitivity X of its step's
        first point: [F | G] stands for F X + G. Only the chain from point to point is sequential.
        """
        size, h = self._robot.model.nv, self._step
        of_q, of_twist = self._velocity_map.derivatives(rollout.stages)
        twist = self.polynomial.twist_derivative(rollout.coefficients, self._half_steps)
        steps = len(rollout.increments)

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

        v1, v2, _, v4 = (np.array([stage.v for stage in rollout.stages[k:-1:4]]) for k in range(4))
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
        twist_rate = self.polynomial.acceleration(rollout.coefficients, rollout.s)
        return Sensitivity(
            q=q,
            v=of_q[::4] @ q + of_twist[::4] @ twist[::2],
            q_half_way=half_way[:, :, :size] @ q[:-1] + half_way[:, :, size:],
            acceleration=np.einsum("pij,pj->pi", of_q[::4], rollout.v)
            + np.einsum("pij,pj->pi", of_twist[::4], twist_rate),
        )


def runge_kutta_step(
    model: pin.Model, q: Array, step: float, velocity: Callable[[int, Array], Array]
) -> Array:
    """Return one step of order four on the configuration manifold, stage by stage.

    Args:
        q: Configuration at the step's beginning. Shape (7 + joints,).
        step: Its length [s].
        velocity: Returns the tangent velocity, shape (6 + joints,), of a stage from its number and
            its configuration. The stages 0 to 3 lie at 0, 1/2, 1/2 and 1 of the step and are
            asked for in this order.

    Returns:
        Tangent steps from q to the stages 1 to 3, and the step itself. Shape (4, 6 + joints).
    """
    increments = np.empty((4, model.nv))
    v1 = velocity(0, q)
    increments[0] = step / 2 * v1
    v2 = velocity(1, pin.integrate(model, q, increments[0]))
    increments[1] = step / 2 * v2
    increments[1, :6] += step**2 / 8 * _bracket(v1, v2)
    v3 = velocity(2, pin.integrate(model, q, increments[1]))
    increments[2] = step * v3
    v4 = velocity(3, pin.integrate(model, q, increments[2]))
    increments[3] = step / 6 * (v1 + 2 * v2 + 2 * v3 + v4)
    increments[3, :6] += step**2 / 12 * _bracket(v1, v4)
    return increments


def regular_velocity(
    velocity_map: VelocityMap,
    q: Array,
    momentum: Array,
    twist: Array,
    time: float,
    duration: float,
) -> VelocitySolution:
    """Return the solution of the velocity map where the arm can follow it.

    Args:
        q: Configuration. Shape (7 + joints,).
        momentum: Total P and L about the inertial origin. Shape (6,).
        twist: Wanted of the end effector, inertial axes. Shape (6,).
        time: For the message [s].
        duration: Of the whole motion, for the message [s].

    Raises:
        NoPlanFound: The posture is a dynamic singularity.
    """
    try:
        solution = velocity_map.solve(q, momentum, twist)
        square = float(solution.v[6:] @ solution.v[6:])
    except np.linalg.LinAlgError:
        square = np.inf
    if not square < _SINGULAR_JOINT_RATE**2:
        raise NoPlanFound(
            Status.SINGULAR,
            f"dynamic singularity at t = {time:.2f} s of {duration:g} s: the arm cannot follow the "
            "end effector's path there; choose a nearer goal, another start posture or a longer "
            "duration",
        )
    return solution


def _half_way(increments: Array) -> Array:
    """Return the steps to half-way; the errors of both stages there cancel in their mean."""
    mean: Array = (increments[:, 0] + increments[:, 1]) / 2
    return mean


def _bracket(a: Array, b: Array) -> Array:
    """Return the Lie bracket of the base twists of two tangent velocities. Shape (6,)."""
    bracket: Array = pin.Motion(a[:6]).cross(pin.Motion(b[:6])).vector
    return bracket


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
