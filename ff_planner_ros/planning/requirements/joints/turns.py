"""Extremes of joint positions and velocities between the points, as the search sees them.

Between two points the search takes the cubic through both positions and velocities, of which it has
derivatives. The value of an extreme does not change with its time to first order, so that its
derivative is that at a fixed time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.planning.paths.path_family import Motion, Sensitivity
from ff_planner_ros.planning.requirements.requirement import Rows


class Between(NamedTuple):
    """Joint positions or velocities within intervals, as weighted sums of those at both ends."""

    interval: Indices  # of each value; shape (values,)
    joint: Indices  # whose value it is; shape (values,)
    # Of the position at the interval's begin and end, then of the rate. Each of shape (values,)
    weights: Sequence[Array]
    weights_by_step: Sequence[Array]  # their derivatives by the time between two points


def turns(motion: Motion, step: float) -> Between:
    """Return the extreme positions of the joints within the intervals.

    Args:
        step: Time from point to point [s].
    """
    p, v = motion.q[:, 7:], motion.v[:, 6:]
    # The rate along a cubic, times the step: a s^2 + b s + c with s from 0 to 1.
    c, way = step * v[:-1], np.diff(p, axis=0)
    a, b = 3 * (c + step * v[1:]) - 6 * way, 6 * way - 4 * c - 2 * step * v[1:]
    square = b**2 - 4 * a * c
    q = -(b + np.copysign(np.sqrt(np.maximum(square, 0.0)), b)) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.stack([q / a, c / q])
    root, interval, joint = np.nonzero((s > 0.0) & (s < 1.0) & (square > 0.0))
    s = s[root, interval, joint]
    of_end = s**2 * (3 - 2 * s)
    weights = (1 - of_end, of_end, step * s * (1 - s) ** 2, step * s**2 * (s - 1))
    by_step = (0.0 * s, 0.0 * s, s * (1 - s) ** 2, s**2 * (s - 1))
    return Between(interval, joint, weights, by_step)


def peak_rates(motion: Motion, step: float) -> Between:
    """Return the extreme velocities of the joints within the intervals; see `turns`."""
    p, v = motion.q[:, 7:], motion.v[:, 6:]
    way = np.diff(p, axis=0) / step
    curvature, slope = 6 * (v[:-1] + v[1:] - 2 * way), 6 * way - 4 * v[:-1] - 2 * v[1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        s = -slope / curvature
    interval, joint = np.nonzero((s > 0.0) & (s < 1.0))
    s = s[interval, joint]
    of_way = 6 * s * (1 - s) / step
    weights = (-of_way, of_way, (1 - s) * (1 - 3 * s), s * (3 * s - 2))
    by_step = (of_way / step, -of_way / step, 0.0 * s, 0.0 * s)
    return Between(interval, joint, weights, by_step)


def beyond(
    between: Between,
    motion: Motion,
    sensitivity: Sensitivity,
    lower: Array,
    upper: Array,
    interest: Array | float,
) -> Rows:
    """Return the distances to both limits that are below `interest`, as rows; see `within`."""
    joint, value = between.joint, _weighted(between, motion.q[:, 7:], motion.v[:, 6:])
    margins = np.stack([upper[joint] - value, value - lower[joint]])
    side, row = np.nonzero(margins < np.broadcast_to(interest, lower.shape)[joint])
    weights, by_step = (
        tuple(one[row] for one in each) for each in (between.weights, between.weights_by_step)
    )
    near = Between(between.interval[row], joint[row], weights, by_step)
    jacobian = _weighted(near, sensitivity.q[:, 6:], sensitivity.v[:, 6:])
    if sensitivity.goal_motion is not None:
        of_step = _weighted(near._replace(weights=by_step), motion.q[:, 7:], motion.v[:, 6:])
        jacobian[:, -1] += of_step / (len(motion.q) - 1)
    # Below zero, where those at the points are above it.
    names = -1 - np.ravel_multi_index(
        (side, between.interval[row], joint[row]), (2, len(motion.q), len(lower))
    )
    return Rows(margins[side, row], np.where(side == 0, -1.0, 1.0)[:, None] * jacobian, names)


def joined(*rows: Rows) -> Rows:
    """Return several sets of rows as one."""
    values, jacobians, names = zip(*rows, strict=True)
    return Rows(np.concatenate(values), np.concatenate(jacobians), np.concatenate(names))


def _weighted(between: Between, positions: Array, rates: Array) -> Array:
    """Return the weighted sums of joint positions and velocities, or of their derivatives."""
    begin = between.interval, between.joint
    end = between.interval + 1, between.joint
    terms = positions[begin], positions[end], rates[begin], rates[end]
    total = np.zeros_like(terms[0])
    for weight, term in zip(between.weights, terms, strict=True):
        total += weight.reshape(-1, *[1] * (term.ndim - 1)) * term
    return total
