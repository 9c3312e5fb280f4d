"""The end effector's path: 8th-order polynomials in Cartesian space, Eqs. (33)-(42).

Each of the six components (position, three Euler angles) is the quintic through the six end
conditions plus three free terms. In normalised time s = t / duration the free terms are
64 s^3 (1 - s)^3 {1, s, s^2}: value, rate and acceleration vanish at both ends, so the end
conditions hold for every choice of the 18 coefficients, and each term is of the size of its
coefficient. The paper's decision variables a6, a7, a8 are a linear map of them.

The rotation from end effector to inertial axes is R = A Rz(psi) Ry(theta) Rx(phi) B, with two
definitions (`reading`):

- `inertial`, the paper's: A = B = 1, in the inertial frame that the plan is made in, whose axes are
  the chaser's at the start (`system_frame`);
- `along_turn`: A and B are such that on the straight path only psi changes, from zero to the whole
  rotation angle. This path is as far as possible from the singularity, and does not depend on the
  choice of the inertial frame. Used if the paper's angles are not safe.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, frozen
from ff_planner_ros.robot.quaternion import canonical_quaternion, quaternion_from_rotation
from ff_planner_ros.robot.rotation import (
    euler_from_rotation,
    euler_rate_map,
    euler_rate_map_derivative,
    euler_rate_map_second_derivative,
    rotation_from_euler,
)

COMPONENTS, FREE_TERMS = 6, 3
PARAMETERS = COMPONENTS * FREE_TERMS

# Ascending coefficients of 64 s^3 (1 - s)^3 {1, s, s^2}, a column a term; the peak of
# s^3 (1 - s)^3 is 1/64. Shape (9, 3).
_BUMP = 64.0 * np.array([1.0, -3.0, 3.0, -1.0])
_FREE_TERM_COEFFICIENTS = np.array(
    [np.concatenate([np.zeros(3 + j), _BUMP, np.zeros(2 - j)]) for j in range(FREE_TERMS)]
).T
# Changes of the three coefficients, as columns, whose paths have the same mean square and are
# orthogonal over the duration: a Gram-Schmidt process from the first term on.
_MEANS = np.cumprod([1.0, 7 / 14, 8 / 15, 9 / 16, 10 / 17])  # of s^n, weighted by s^6 (1 - s)^6
_GRAM = _MEANS[np.add.outer(np.arange(3), np.arange(3))]
_OWN_WAYS = np.linalg.inv(np.linalg.cholesky(_GRAM)).T
DIRECTIONS = frozen(np.kron(np.eye(COMPONENTS), _OWN_WAYS))  # of all components
# Beyond this pitch on the straight path the paper's angles are too near their singularity at
# 90 deg; the paper's own goal, at 80 deg, is inside.
_SAFE_PITCH = np.deg2rad(85.0)
# Beyond this change of an angle [rad], rounding might decide its direction.
_SAFE_TURN = np.pi - 1e-3
_PITCH_SAMPLES = np.linspace(0.0, 1.0, 51)
# A smaller rotation, difference from half a turn, or component of its axis is rounding.
_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class EndEffectorMotion:
    """Pose, twist and acceleration of the end effector at one time, in the inertial frame."""

    position: Array  # shape (3,) [m]
    rotation_ee_to_inertial: Array  # shape (3, 3)
    twist: Array  # linear and angular velocity; shape (6,) [m/s, rad/s]
    acceleration: Array  # linear and angular acceleration; shape (6,) [m/s2, rad/s2]


@dataclass(frozen=True, eq=False)
class EndEffectorPolynomial:
    """All end-effector paths between two end conditions, one for each choice of 18 coefficients."""

    duration: float  # between the ends [s]
    quintic: Array  # ascending coefficients of the quintic in s; shape (6, 6), a column a component
    reading: str  # `inertial` or `along_turn`
    rotation_outer: Array  # A; shape (3, 3)
    rotation_inner: Array  # B; shape (3, 3)

    def components(self, coefficients: Array, s: Array) -> tuple[Array, Array, Array]:
        """Return the six components, their rates and accelerations, Eqs. (33)-(35).

        Each has the shape (times, 6); coefficients: of the free terms, shape (6, 3); s: normalised
        times.
        """
        polynomial = _FREE_TERM_COEFFICIENTS @ coefficients.T
        polynomial[:6] += self.quintic
        value, rate, acceleration = (
            powers(s, order) @ polynomial / self.duration**order for order in range(3)
        )
        return value, rate, acceleration

    def pose(self, coefficients: Array, s: Array) -> tuple[Array, Array]:
        """Return positions, shape (times, 3), and rotations to inertial, (times, 3, 3)."""
        value, _, _ = self.components(coefficients, s)
        rotation = self.rotation_outer @ rotation_from_euler(value[:, 3:]) @ self.rotation_inner
        return value[:, :3], rotation

    def near(self, positions: Array, rotations_ee_to_inertial: Array) -> Array:
        """Return the coefficients, shape (18,), of the path that fits a motion best.

        The fit is exact for a part of a path with the same definition of the Euler angles, apart
        from the ends, which the quintic fixes.

        Args:
            positions: Ten or more, at equal steps of the duration. Shape (times, 3) [m].
            rotations_ee_to_inertial: Shape (times, 3, 3).
        """
        outer, inner = self.rotation_outer.T, self.rotation_inner.T
        angles = [euler_from_rotation(outer @ turn @ inner) for turn in rotations_ee_to_inertial]
        components = np.column_stack([positions, np.unwrap(angles, axis=0)])
        of_s = powers(np.linspace(0.0, 1.0, len(components)), 0)
        # The fitted quintic is dropped: the ends are given.
        terms = np.column_stack([of_s[:, :6], of_s @ _FREE_TERM_COEFFICIENTS])
        fitted, *_ = np.linalg.lstsq(terms, components)
        return np.asarray(fitted[6:].T.ravel(), np.float64)

    def towards(self, end: EndEffectorMotion) -> EndEffectorPolynomial:
        """Return the paths to another end near this one, with the same A and B."""
        return self.lasting(self.duration, end)

    def lasting(self, duration: float, end: EndEffectorMotion) -> EndEffectorPolynomial:
        """Return the paths of another duration to an end near this one; they begin as these do."""
        ends = self.components(np.zeros((COMPONENTS, FREE_TERMS)), np.array([0.0, 1.0]))
        value, rate, acceleration = _components(end, self.rotation_outer, self.rotation_inner)
        value[3:] = _nearest(value[3:], ends[0][1, 3:])
        conditions = [tuple(of_ends[0] for of_ends in ends), (value, rate, acceleration)]
        return replace(self, duration=duration, quintic=_quintic(conditions, duration))

    def quintic_by_duration(self, place: Array, twist: Array, acceleration: Array) -> Array:
        """Return the derivatives of `quintic` by the duration T. Shape (6, 6).

        The quintic in s goes through T^k times the k-th derivatives by time at both ends. Those at
        the start are constant, and those at the end change with the goal. With e the Euler angles,
        w = A W(e) e' and w' = A (W(e) e'' + (dW/de e') e') are differentiated once more.

        Args:
            place: Derivative of the goal's pose by the duration: velocity and angular velocity, as
                all in inertial axes. Shape (6,).
            twist: Derivative of the goal's twist by the duration. Shape (6,).
            acceleration: Derivative of the goal's acceleration by the duration. Shape (6,).
        """
        duration = self.duration
        ends = self.components(np.zeros((COMPONENTS, FREE_TERMS)), np.array([0.0, 1.0]))
        euler, rate, accelerated = (of_ends[1, 3:] for of_ends in ends)
        to_rate = np.linalg.inv(self.rotation_outer @ euler_rate_map(euler))
        inward = np.linalg.inv(euler_rate_map(euler))
        of_rate = euler_rate_map_derivative(euler, rate)
        turned = to_rate @ place[3:]
        faster = to_rate @ twist[3:] - inward @ of_rate @ turned
        bent = (
            euler_rate_map_derivative(euler, accelerated) @ turned
            + euler_rate_map_derivative(euler, faster) @ rate
            + of_rate @ faster
            + euler_rate_map_second_derivative(euler, rate) @ turned
        )
        changes = (
            np.concatenate([place[:3], turned]),
            np.concatenate([twist[:3], faster]),
            np.concatenate([acceleration[:3], to_rate @ acceleration[3:] - inward @ bent]),
        )
        wanted = np.zeros((6, COMPONENTS))
        for order in range(1, 3):
            wanted[2 * order : 2 * order + 2] = order * duration ** (order - 1) * ends[order]
        for order in range(3):
            wanted[2 * order + 1] += duration**order * changes[order]
        at_ends = np.array([0.0, 1.0])
        system = np.concatenate([powers(at_ends, order)[:, :6] for order in range(3)])
        return np.asarray(np.linalg.solve(system, wanted), np.float64)

    def through(self, place: Array, s: float) -> Array:
        """Return the coefficients, shape (6, 3), of the straightest path through a point.

        The nearest to the straight path in mean square over the duration, with its orientation.

        Args:
            place: Position of the end effector, in the inertial frame. Shape (3,) [m].
            s: Normalised time of that position, between 0 and 1.
        """
        coefficients, at = np.zeros((COMPONENTS, FREE_TERMS)), np.array([s])
        straight, _, _ = self.components(coefficients, at)
        (reached,) = powers(at, 0) @ _FREE_TERM_COEFFICIENTS @ _OWN_WAYS
        nearest = _OWN_WAYS @ reached / (reached @ reached)
        coefficients[:3] = np.outer(place - straight[0, :3], nearest)
        return coefficients

    def decision_variables(self, coefficients: Array) -> Array:
        """Return the paper's xi: a6, a7, a8 of each component, Eq. (42). Shape (18,)."""
        in_normalised_time = coefficients @ _FREE_TERM_COEFFICIENTS[6:].T
        variables: Array = in_normalised_time / self.duration ** np.arange(6.0, 9.0)
        return variables.ravel()


def end_effector_polynomials(
    start: EndEffectorMotion, end: EndEffectorMotion, duration: float
) -> list[EndEffectorPolynomial]:
    """Return the paths from `start` to `end` in `duration` seconds.

    They are one set; but if the rotation is half a turn, two, since both directions are equally
    long.
    """
    paths = _paths("inertial", np.eye(3), np.eye(3), start, end, duration)
    straight = powers(_PITCH_SAMPLES, 0)[:, :6] @ paths.quintic
    turned = np.abs(straight[-1, 3:] - straight[0, 3:]).max()
    if np.abs(straight[:, 4]).max() <= _SAFE_PITCH and turned <= _SAFE_TURN:
        return [paths]
    axis, angles = _turns(start.rotation_ee_to_inertial.T @ end.rotation_ee_to_inertial)
    to_axis = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis).toRotationMatrix()
    outer, inner = start.rotation_ee_to_inertial @ to_axis, to_axis.T
    return [_paths("along_turn", outer, inner, start, end, duration, angle) for angle in angles]


def _turns(rotation: Array) -> tuple[Array, list[float]]:
    """Return a rotation's axis, shape (3,), and angle, within +-pi; both angles of half a turn."""
    quaternion = canonical_quaternion(quaternion_from_rotation(rotation))
    sine = float(np.linalg.norm(quaternion[:3]))
    angle = 2.0 * np.arctan2(sine, quaternion[3])
    if angle < _ROUNDING:
        return np.array([0.0, 0.0, 1.0]), [0.0]
    axis = np.asarray(quaternion[:3] / sine, np.float64)
    # The shortest rotation from z to the opposite direction is not unique.
    if axis[2] < _ROUNDING - 1.0:
        axis, angle = -axis, -angle
    if abs(angle) < np.pi - _ROUNDING:
        return axis, [angle]
    # An axis and its opposite are the same half turn: rounding must not decide between them.
    deciding = next(part for part in axis[[2, 0, 1]] if abs(part) > _ROUNDING)
    return axis * np.sign(deciding), [np.pi, -np.pi]


def _paths(
    reading: str,
    outer: Array,
    inner: Array,
    start: EndEffectorMotion,
    end: EndEffectorMotion,
    duration: float,
    angle: float | None = None,
) -> EndEffectorPolynomial:
    """Return the paths with one definition of the Euler angles, by its A and B.

    Args:
        angle: Change of psi with `along_turn`. None: each Euler angle takes the shorter direction.
    """
    conditions = [_components(motion, outer, inner) for motion in (start, end)]
    near = conditions[0][0][3:] if angle is None else np.array([0.0, 0.0, angle])
    conditions[1][0][3:] = _nearest(conditions[1][0][3:], near)
    return EndEffectorPolynomial(
        duration=duration,
        quintic=_quintic(conditions, duration),
        reading=reading,
        rotation_outer=frozen(outer),
        rotation_inner=frozen(inner),
    )


def _nearest(euler: Array, others: Array) -> Array:
    """Return Euler angles shifted by multiples of 2 pi to be nearest to others."""
    nearest: Array = euler - 2 * np.pi * np.round((euler - others) / (2 * np.pi))
    return nearest


def _quintic(conditions: Sequence[tuple[Array, ...]], duration: float) -> Array:
    """Return the quintic through components, rates and accelerations at both ends."""
    ends = np.array([0.0, 1.0])
    system = np.concatenate([powers(ends, order)[:, :6] / duration**order for order in range(3)])
    wanted = np.array([conditions[i][order] for order in range(3) for i in range(2)])
    return frozen(np.linalg.solve(system, wanted))


def _components(motion: EndEffectorMotion, outer: Array, inner: Array) -> tuple[Array, ...]:
    """Return the six components, their rates and accelerations at one end."""
    euler = euler_from_rotation(outer.T @ motion.rotation_ee_to_inertial @ inner.T)
    to_rate = np.linalg.inv(euler_rate_map(euler))
    rate: Array = to_rate @ outer.T @ motion.twist[3:]
    alpha = outer.T @ motion.acceleration[3:]
    alpha -= euler_rate_map_derivative(euler, rate) @ rate
    acceleration: Array = to_rate @ alpha
    return (
        np.concatenate([motion.position, euler]),
        np.concatenate([motion.twist[:3], rate]),
        np.concatenate([motion.acceleration[:3], acceleration]),
    )


def powers(s: Array, order: int) -> Array:
    """Return derivatives of 1, s, ..., s^8 of an order with respect to s. Shape (times, 9)."""
    derivatives = np.zeros((len(s), 9))
    derivatives[:, order:] = np.vander(s, 9 - order, increasing=True)
    for k in range(order):
        derivatives *= np.arange(9) - k
    return derivatives
