"""Steps of order four on the configuration manifold.

The base moves on SE(3), where Runge-Kutta's weighted sum of velocities alone has order two. The
brackets of Munthe-Kaas restore order four [Munthe-Kaas, High order Runge-Kutta methods on
manifolds, Appl. Numer. Math. 29, 1999].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin

from ff_planner_ros.arrays import Array


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
    """Return one tangent step of `step` seconds from a configuration, stage by stage.

    Args:
        velocity: Returns the tangent velocity, shape (6 + joints,), of a stage from its number and
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
    """Return how a base turns at omega = A R^T L - b: at the beginning and after each step.

    Args:
        rotation: Base to inertial axes at the beginning. Shape (3, 3).
        momentum: L, constant, inertial axes. Shape (3,).
        of_momentum: A at the steps' ends and half-way between. Shape (2 steps + 1, 3, 3).
        of_rates: b there. Shape (2 steps + 1, 3).
        steps: Shape (steps,) [s].

    Returns:
        Base to inertial axes. Shape (steps + 1, 3, 3).
    """
    prepared = list(zip(of_momentum, of_rates, strict=True))

    def rate(half_step: int, there: Array) -> Array:
        by_momentum, by_rates = prepared[half_step]
        omega: Array = by_momentum.dot(momentum.dot(there)) - by_rates
        return omega

    found = [rotation]
    for i, step in enumerate(steps.tolist()):
        v1 = rate(2 * i, rotation)
        v2 = rate(2 * i + 1, rotation.dot(pin.exp3(step / 2 * v1)))
        half = step / 2 * v2 + pin.skew(step**2 / 8 * v1).dot(v2)
        v3 = rate(2 * i + 1, rotation.dot(pin.exp3(half)))
        v4 = rate(2 * i + 2, rotation.dot(pin.exp3(step * v3)))
        whole = step / 6 * (v1 + 2 * (v2 + v3) + v4) + pin.skew(step**2 / 12 * v1).dot(v4)
        rotation = rotation.dot(pin.exp3(whole))
        found.append(rotation)
    return np.array(found)


def _bracket(a: Array, b: Array) -> Array:
    """Return the Lie bracket of the base twists of two tangent velocities. Shape (6,)."""
    bracket: Array = pin.Motion(a[:6]).cross(pin.Motion(b[:6])).vector
    return bracket
