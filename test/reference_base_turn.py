"""The base's turn by numpy and Pinocchio: what the compiled core is compared with.

The centre of mass moves uniformly, whatever the joints do. About it, Eq. (27) says in base axes
I(theta) omega + A(theta) theta' = R^T L, which steps of Runge-Kutta of order four integrate on the
rotations. A base on a table turns about the table's normal alone.

Half steps are the points of a motion and the times half-way between them, in order of time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.rotation import skew

Indices: TypeAlias = NDArray[np.intp]


class MomentumMaps(NamedTuple):
    """The system about its centre of mass, in base axes, at each half step."""

    center: Array  # from the base's origin; shape (half steps, 3) [m]
    of_center: Array  # its derivative by the joints; shape (half steps, 3, joints)
    coupling: Array  # A; shape (half steps, 3, joints)
    to_rate: Array  # angular momentum to the base's rate, I^-1; shape (half steps, 3, 3)


@dataclass(frozen=True, eq=False)
class BaseTurn:
    """The attitude of a base along a motion."""

    maps: MomentumMaps
    rotations: Array  # base to inertial axes at the points; shape (points, 3, 3)
    half_way: Array  # likewise half-way between; shape (points - 1, 3, 3)
    # Turns from a point to the stages of its step; the last is the step. Shape (points - 1, 4, 3)
    increments: Array
    # At the four stages of each step and at the last point: the base's rate and the angular
    # momentum, in base axes. Each of shape (4 * (points - 1) + 1, 3)
    rates: Array
    momenta: Array

    @property
    def half_steps(self) -> Indices:
        """Return of which half step each stage is. Shape (4 * (points - 1) + 1,)."""
        return _half_steps(len(self.rotations) - 1)


def momentum_maps(robot: Robot, angles: Array) -> MomentumMaps:
    """Return the maps at joint angles, shape (half steps, joints)."""
    model, data = robot.model, robot.model.createData()
    q, count = pin.neutral(model), len(angles)
    center, maps = np.empty((count, 3)), np.empty((count, 6, model.nv))
    for i, at in enumerate(angles):
        q[7:] = at
        maps[i] = pin.computeCentroidalMap(model, data, q)
        center[i] = data.com[0]
    inertia = maps[:, 3:, 3:6]
    turns = [row - 3 for row in robot.base.rows if row >= 3]
    free = np.ix_(range(count), turns, turns)
    to_rate = np.zeros((count, 3, 3))
    to_rate[free] = np.linalg.inv(inertia[free])
    return MomentumMaps(
        center=center,
        of_center=maps[:, :3, 6:] / pin.computeTotalMass(model),
        coupling=maps[:, 3:, 6:],
        to_rate=to_rate,
    )


def base_turn(
    maps: MomentumMaps, rates: Array, rotation: Array, momentum: Array, step: float
) -> BaseTurn:
    """Integrate the base's attitude along a motion of the joints.

    Args:
        rates: Of the joints. Shape (half steps, joints) [rad/s].
        rotation: At the first point. Shape (3, 3).
        momentum: L about the centre of mass, inertial axes. Shape (3,).
        step: Time from point to point [s].
    """
    of_joints = (maps.coupling @ rates[:, :, None])[:, :, 0]
    prepared = list(zip(maps.to_rate, of_joints, strict=True))
    steps = len(rates) // 2
    rotations, half_way = np.empty((steps + 1, 3, 3)), np.empty((steps, 3, 3))
    increments = np.empty((steps, 4, 3))
    base_rates, momenta = np.empty((4 * steps + 1, 3)), np.empty((4 * steps + 1, 3))

    def rate(stage: int, half_step: int, attitude: Array) -> Array:
        to_rate, moving = prepared[half_step]
        momenta[stage] = in_base = momentum.dot(attitude)
        found: Array = to_rate.dot(in_base - moving)
        base_rates[stage] = found
        return found

    for i in range(steps):
        at, stage = 2 * i, 4 * i
        rotations[i] = rotation
        v1 = rate(stage, at, rotation)
        first = step / 2 * v1
        v2 = rate(stage + 1, at + 1, rotation.dot(pin.exp3(first)))
        second = step / 2 * v2 + step**2 / 8 * _cross(v1, v2)
        v3 = rate(stage + 2, at + 1, rotation.dot(pin.exp3(second)))
        third = step * v3
        v4 = rate(stage + 3, at + 2, rotation.dot(pin.exp3(third)))
        whole = step / 6 * (v1 + 2 * v2 + 2 * v3 + v4) + step**2 / 12 * _cross(v1, v4)
        increments[i] = first, second, third, whole
        half_way[i] = rotation.dot(pin.exp3((first + second) / 2))
        rotation = rotation.dot(pin.exp3(whole))
    rotations[-1] = rotation
    rate(4 * steps, 2 * steps, rotation)
    return BaseTurn(maps, rotations, half_way, increments, base_rates, momenta)


class TurnDerivatives(NamedTuple):
    """Derivatives by x of a base's attitude, in its own axes, and of its rate."""

    turns: Array  # at the points; shape (points, 3, variables)
    half_way: Array  # shape (points - 1, 3, variables)
    rates: Array  # at the points; shape (points, 3, variables)
    # At the points, the derivatives of both momenta by the joints, all velocities being fixed: each
    # has the shape (points, 3, joints)
    of_linear: Array
    of_angular: Array


def turn_derivatives(
    robot: Robot,
    turn: BaseTurn,
    joints: tuple[Array, Array],
    by_x: tuple[Array, Array],
    step: float,
) -> TurnDerivatives:
    """Differentiate `base_turn`, exact as discretised, all steps at once.

    Every stage's turn and rate is affine in the derivative X of its step's first point: [F | G]
    stands for F X + G. Only the chain from point to point is sequential.

    Args:
        joints: Angles and rates. Each of shape (half steps, joints).
        by_x: Their derivatives. Each of shape (half steps, joints, variables).
    """
    steps, variables = len(turn.increments), by_x[0].shape[2]
    of_linear, of_angular = _by_joints(robot, turn, joints)
    at = turn.half_steps
    to_rate = turn.maps.to_rate[at]
    by_turn = to_rate @ skew(turn.momenta)
    of_x = -to_rate @ (of_angular @ by_x[0][at] + turn.maps.coupling[at] @ by_x[1][at])

    def rate(stage: int, turned: Array) -> Array:
        affine: Array = by_turn[stage:-1:4] @ turned
        affine[:, :, 3:] += of_x[stage:-1:4]
        return affine

    def turned(increments: Array, derivative: Array) -> Array:
        back = np.array([pin.exp3(-u) for u in increments])
        affine = np.array([pin.Jexp3(u) for u in increments]) @ derivative
        affine[:, :, :3] += back
        return affine

    start = np.zeros((steps, 3, 3 + variables))
    start[:, range(3), range(3)] = 1.0
    v1, v2, _, v4 = (turn.rates[k:-1:4] for k in range(4))
    first, second, third, whole = turn.increments.transpose(1, 0, 2)
    d1 = rate(0, start)
    d_first = step / 2 * d1
    d2 = rate(1, turned(first, d_first))
    d_second = step / 2 * d2 + step**2 / 8 * (skew(v1) @ d2 - skew(v2) @ d1)
    d3 = rate(2, turned(second, d_second))
    d4 = rate(3, turned(third, step * d3))
    d_whole = step / 6 * (d1 + 2 * d2 + 2 * d3 + d4)
    d_whole += step**2 / 12 * (skew(v1) @ d4 - skew(v4) @ d1)
    to_next = turned(whole, d_whole)
    to_half_way = turned((first + second) / 2, (d_first + d_second) / 2)
    turns = np.zeros((steps + 1, 3, variables))
    for i in range(steps):
        turns[i + 1] = to_next[i, :, :3] @ turns[i] + to_next[i, :, 3:]
    return TurnDerivatives(
        turns=turns,
        half_way=to_half_way[:, :, :3] @ turns[:-1] + to_half_way[:, :, 3:],
        rates=by_turn[::4] @ turns + of_x[::4],
        of_linear=of_linear[::4],
        of_angular=of_angular[::4],
    )


def _by_joints(robot: Robot, turn: BaseTurn, joints: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the derivatives of both momenta by the joints at fixed velocities, at all stages.

    Each of shape (stages, 3, joints).
    """
    model, data = robot.model, robot.model.createData()
    q, v, still = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
    angles, rates = joints
    found = np.empty((len(turn.rates), 6, robot.joints))
    for i, (half_step, base_rate) in enumerate(zip(turn.half_steps, turn.rates, strict=True)):
        q[7:], v[3:6], v[6:] = angles[half_step], base_rate, rates[half_step]
        by_q, *_ = pin.computeCentroidalDynamicsDerivatives(model, data, q, v, still)
        found[i] = by_q[:, 6:]
    return found[:, :3], found[:, 3:]


def _half_steps(steps: int) -> Indices:
    """Return 0, 1, 1, 2, 2, 3, 3, 4, ...: stages lie at 0, 1/2, 1/2 and 1 of their step."""
    stage = np.arange(4 * steps + 1)
    half_steps: Indices = 2 * (stage // 4) + (stage % 4 + 1) // 2
    return half_steps


def _cross(a: Array, b: Array) -> Array:
    """Return the cross product of two vectors, at a tenth of the price of numpy's."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
