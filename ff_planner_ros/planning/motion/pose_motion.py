"""The motion of chaser and end effector between the points of a trajectory."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.quaternion import (
    quaternion_from_rotation_vector,
    quaternion_inverse,
    quaternion_product,
    rotation_from_quaternion,
    rotation_vector_from_quaternion,
)


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
    from scipy.interpolate import CubicHermiteSpline  # slow to load, and no check comes here

    spline = CubicHermiteSpline(times, positions, linear_velocities)
    return spline(at), attitudes_between(times, quaternions_xyzw, angular_velocities, at)


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
    turns = quaternion_product(quaternion_inverse(quaternions_xyzw[:-1]), quaternions_xyzw[1:])
    # In axes of the point before; a rotation vector's rate is Jlog3 times the body's own.
    rates_before = np.einsum("pi,pij->pj", angular_velocities[:-1], rotations[:-1])
    body_rates = np.einsum("pi,pij->pj", angular_velocities[1:], rotations[1:])
    rates_after = np.array(
        [
            pin.Jlog3(turn) @ rate
            for turn, rate in zip(rotation_from_quaternion(turns), body_rates, strict=True)
        ]
    )
    before = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    step = np.diff(times)[before, None]
    s = (at - times[before])[:, None] / step
    rotation_vectors = s**2 * (3.0 - 2.0 * s) * rotation_vector_from_quaternion(turns)[
        before
    ] + step * (s * (1.0 - s) ** 2 * rates_before[before] - s**2 * (1.0 - s) * rates_after[before])
    return quaternion_product(
        quaternions_xyzw[before], quaternion_from_rotation_vector(rotation_vectors)
    )
