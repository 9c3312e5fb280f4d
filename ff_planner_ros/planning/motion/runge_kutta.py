"""Steps of order four on the configuration manifold.

The base moves on SE(3), where Runge-Kutta's weighted sum of velocities alone has order two. The
brackets of Munthe-Kaas restore order four [Munthe-Kaas, High order Runge-Kutta methods on
manifolds, Appl. Numer. Math. 29, 1999].
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import accumulate

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.configuration import eigen_quaternion
from ff_planner_ros.robot.quaternion import quaternion_from_rotation_vector, unit_quaternion
from ff_planner_ros.robot.rotation import cross


def increment(step: float, velocities: Sequence[Array]) -> Array:
    """Return the tangent step from a step's beginning to its next stage, or to its end.

    The stages lie at 0, 1/2, 1/2 and 1 of the step, which takes `step` seconds.

    Args:
        velocities: Tangent velocities of the stages so far, one to four.
    """
    match velocities:
        case [v1]:
            return step / 2 * v1
        case [v1, v2]:
            second: Array = step / 2 * v2
            second[:6] += step**2 / 8 * _bracket(v1, v2)
            return second
        case [_, _, v3]:
            return step * v3
    v1, v2, v3, v4 = velocities
    whole: Array = step / 6 * (v1 + 2 * v2 + 2 * v3 + v4)
    whole[:6] += step**2 / 12 * _bracket(v1, v4)
    return whole


def runge_kutta_step(
    model: pin.Model, q: Array, step: float, velocity: Callable[[int, Array], Array]
) -> Array:
    """Return the tangent step of one Runge-Kutta step of `step` seconds. Shape (6 + joints,).

    Args:
        velocity: Returns the tangent velocity, shape (6 + joints,), from the number of a stage and
            its configuration. It is called for the stages 0 to 3 in this order.
    """
    velocities = [velocity(0, q)]
    for stage in range(1, 4):
        there = pin.integrate(model, q, increment(step, velocities))
        velocities.append(velocity(stage, there))
    return increment(step, velocities)


def turned_by_momentum(
    rotation: Array, momentum: Array, of_momentum: Array, of_rates: Array, steps: Array
) -> Array:
    """Return the attitude of a base with omega = A R^T L - b, at the beginning and after each step.

    The momentum in base axes, l = R^T L, changes by l x omega. It is integrated by Runge-Kutta, and
    interpolated half-way by the cubic through both ends of a step; the Magnus series of order four
    then integrates omega to rotations.

    Args:
        rotation: Base to inertial axes at the beginning. Shape (3, 3).
        momentum: L, constant, inertial axes. Shape (3,).
        of_momentum: A at the steps' ends and half-way between. Shape (2 steps + 1, 3, 3).
        of_rates: b there. Shape (2 steps + 1, 3).
        steps: Shape (steps,) [s].

    Returns:
        Quaternions (x, y, z, w), base to inertial axes. Shape (steps + 1, 4).
    """
    step, seen = steps[:, None], np.empty_like(of_rates)
    seen[::2] = _momentum_seen(momentum @ rotation, of_momentum, of_rates, steps)
    rates = cross(seen[::2], _omega(seen[::2], of_momentum[::2], of_rates[::2]))
    seen[1::2] = (seen[:-1:2] + seen[2::2]) / 2 + step / 8 * (rates[:-1] - rates[1:])
    omega = _omega(seen, of_momentum, of_rates)
    begin, middle, end = omega[:-1:2], omega[1::2], omega[2::2]
    whole = step / 6 * (begin + 4 * middle + end) + step**2 / 12 * cross(begin, end)
    turns = quaternion_from_rotation_vector(np.vstack([np.zeros(3), whole]))
    turns[0] = eigen_quaternion(rotation)
    return unit_quaternion(np.array(list(accumulate(turns.tolist(), _product))))


def _product(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float, float]:
    """Return the product of two quaternions, their scalars last."""
    (x, y, z, w), (i, j, k, s) = a, b
    return (
        w * i + s * x + y * k - z * j,
        w * j + s * y + z * i - x * k,
        w * k + s * z + x * j - y * i,
        w * s - x * i - y * j - z * k,
    )


def _omega(seen: Array, of_momentum: Array, of_rates: Array) -> Array:
    turning: Array = (of_momentum @ seen[:, :, None])[:, :, 0] - of_rates
    return turning


def _momentum_seen(seen: Array, of_momentum: Array, of_rates: Array, steps: Array) -> Array:
    """Return l after each Runge-Kutta step, by plain numbers: arrays of three take longer.

    Its norm is constant, and restored after each step: with too long steps it would diverge.
    """
    x, y, z = seen.tolist()
    found, size = [(x, y, z)], math.hypot(x, y, z)
    rows = np.hstack([of_momentum.reshape(-1, 9), of_rates]).tolist()
    for h, begin, middle, end in zip(
        steps.tolist(), rows[:-1:2], rows[1::2], rows[2::2], strict=True
    ):
        x1, y1, z1 = _change(begin, x, y, z)
        x2, y2, z2 = _change(middle, x + h / 2 * x1, y + h / 2 * y1, z + h / 2 * z1)
        x3, y3, z3 = _change(middle, x + h / 2 * x2, y + h / 2 * y2, z + h / 2 * z2)
        x4, y4, z4 = _change(end, x + h * x3, y + h * y3, z + h * z3)
        x += h / 6 * (x1 + 2 * (x2 + x3) + x4)
        y += h / 6 * (y1 + 2 * (y2 + y3) + y4)
        z += h / 6 * (z1 + 2 * (z2 + z3) + z4)
        back = size / (math.hypot(x, y, z) or 1.0)
        x, y, z = back * x, back * y, back * z
        found.append((x, y, z))
    return np.array(found)


def _change(row: Sequence[float], x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return l x (A l - b), with A and b in one row."""
    a, b, c, d, e, f, g, h, i, u, v, w = row
    p = a * x + b * y + c * z - u
    q = d * x + e * y + f * z - v
    r = g * x + h * y + i * z - w
    return y * r - z * q, z * p - x * r, x * q - y * p


def _bracket(a: Array, b: Array) -> Array:
    """Return the Lie bracket of the base twists of two tangent velocities. Shape (6,)."""
    bracket: Array = pin.Motion(a[:6]).cross(pin.Motion(b[:6])).vector
    return bracket
