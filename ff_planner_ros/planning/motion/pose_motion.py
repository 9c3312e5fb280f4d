"""The motion of chaser and end effector between the points of a trajectory."""

from __future__ import annotations

import numpy as np

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.robot.quaternion import (
    quaternion_from_rotation_vector,
    quaternion_inverse,
    quaternion_product,
    rotation_from_quaternion,
    rotation_vector_from_quaternion,
)
from ff_planner_ros.robot.rotation import cross

# Least angle that is divided by [rad].
_TINY = 1e-9


def poses_between(
    times: Array,
    positions: Array,
    quaternions_xyzw: Array,
    linear_velocities: Array,
    angular_velocities: Array,
    at: Array,
) -> tuple[Array, Array]:
    """Interpolate the poses of a frame, given with its twists in the inertial frame.

    Positions by cubic Hermite polynomials between neighbours, attitudes by `attitudes_between`.

    Args:
        times: Strictly increasing, two or more. Shape (points,) [s].
        positions: Shape (points, 3) [m].
        quaternions_xyzw: Axes of the frame to inertial axes. Shape (points, 4).
        linear_velocities: Shape (points, 3) [m/s].
        angular_velocities: Shape (points, 3) [rad/s].
        at: Between the first and the last of `times`. Shape (times,) [s].

    Returns:
        Positions, shape (times, 3) [m], and quaternions to inertial axes, shape (times, 4).
    """
    places, _ = cubics_between(times, positions, linear_velocities, at)
    return places, attitudes_between(times, quaternions_xyzw, angular_velocities, at)


def cubics_between(times: Array, values: Array, slopes: Array, at: Array) -> tuple[Array, Array]:
    """Interpolate by the cubic Hermite polynomials between neighbours.

    Args:
        times: Strictly increasing, two or more. Shape (points,) [s].
        values: Shape (points, components).
        slopes: Shape (points, components) [1/s].
        at: Between the first and the last of `times`. Shape (times,) [s].

    Returns:
        Values and slopes, each of shape (times, components).
    """
    before = _interval_of(times, at)
    step = np.diff(times)[before, None]
    first, begin, end = values[before], slopes[before], slopes[before + 1]
    mean = (values[before + 1] - first) / step
    bend = (begin + end - 2.0 * mean) / step
    square, cube = (mean - begin) / step - bend, bend / step
    t = (at - times[before])[:, None]
    return (
        first + begin * t + square * (t * t) + cube * (t * t * t),
        begin + square * t * 2.0 + cube * (t * t) * 3.0,
    )


def _interval_of(times: Array, at: Array) -> Indices:
    """Return the index of the last of `times` but one that is not after each time."""
    return np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)


def attitudes_between(
    times: Array, quaternions_xyzw: Array, angular_velocities: Array, at: Array
) -> Array:
    """Interpolate the attitudes of a frame, given with its angular velocities in inertial axes.

    A cubic Hermite polynomial between two neighbours, on the rotation vector from the first of
    them: exact for a constant spin; else the error falls with the fourth power of the time between
    the points.

    Args:
        times: Strictly increasing, two or more. Shape (points,) [s].
        quaternions_xyzw: Axes of the frame to inertial axes. Shape (points, 4).
        angular_velocities: Shape (points, 3) [rad/s].
        at: Between the first and the last of `times`. Shape (times,) [s].

    Returns:
        Quaternions (x, y, z, w) to inertial axes. Shape (times, 4).
    """
    rotations = rotation_from_quaternion(quaternions_xyzw)
    body_rates = np.einsum("pi,pij->pj", angular_velocities, rotations)
    return attitudes_by_body_rates(times, quaternions_xyzw, body_rates, at)


def attitudes_by_body_rates(
    times: Array, quaternions_xyzw: Array, body_rates: Array, at: Array
) -> Array:
    """Return `attitudes_between`, from angular velocities in the frame's own axes."""
    turns = quaternion_product(quaternion_inverse(quaternions_xyzw[:-1]), quaternions_xyzw[1:])
    whole = rotation_vector_from_quaternion(turns)
    rates_before, rates_after = body_rates[:-1], _rates_of_vectors(whole, body_rates[1:])
    before = _interval_of(times, at)
    step = np.diff(times)[before, None]
    s = (at - times[before])[:, None] / step
    rotation_vectors = s**2 * (3.0 - 2.0 * s) * whole[before] + step * (
        s * (1.0 - s) ** 2 * rates_before[before] - s**2 * (1.0 - s) * rates_after[before]
    )
    return quaternion_product(
        quaternions_xyzw[before], quaternion_from_rotation_vector(rotation_vectors)
    )


def _rates_of_vectors(vectors: Array, body_rates: Array) -> Array:
    """Return the rates of rotation vectors, from angular velocities in axes that they rotate to.

    v' = w + v x w / 2 + (1 - h cot h) / (2 h)^2 v x (v x w), with h half the angle. The last term
    is exact to rounding however small the angle is. Shape (vectors, 3) [rad/s].
    """
    half = np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True) / 2, _TINY)
    turned = cross(vectors, body_rates)
    twice = (1.0 - half / np.tan(half)) / (2 * half) ** 2 * cross(vectors, turned)
    rates: Array = body_rates + turned / 2 + twice
    return rates
