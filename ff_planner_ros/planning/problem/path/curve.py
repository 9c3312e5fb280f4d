"""The smooth curve through the points of a path, with its derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.quaternion import (
    angle_of_quaternion,
    quaternion_inverse,
    quaternion_product,
    rotation_from_quaternion,
)

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline


class Poses(NamedTuple):
    """Poses of a path at some times, with their derivatives; inertial axes, linear part first."""

    positions: Array  # shape (times, 3) [m]
    rotations: Array | None  # to inertial axes; shape (times, 3, 3); None: free
    twists: Array  # shape (times, 6) [m/s, rad/s]
    accelerations: Array  # shape (times, 6) [m/s2, rad/s2]
    quaternions: Array | None  # shape (times, 4)

    def apart(self, other: Poses) -> tuple[float, float]:
        """Return the largest distance [m] and angle [rad] to the poses of another curve."""
        place = np.linalg.norm(self.positions - other.positions, axis=1).max()
        if self.quaternions is None or other.quaternions is None:
            return float(place), 0.0
        turns = quaternion_product(quaternion_inverse(self.quaternions), other.quaternions)
        return float(place), float(angle_of_quaternion(turns).max())


@dataclass(frozen=True, eq=False)
class PathCurve:
    """The curve through the points of a path."""

    spline: CubicSpline  # of position and, where there is one, quaternion before scaling

    def at(self, times: Array) -> Poses:
        """Return the poses at times within the path's, (times,) [s]."""
        value, rate, change = (self.spline(times, order) for order in range(3))
        twists, accelerations = (np.zeros((len(times), 6)) for _ in range(2))
        twists[:, :3], accelerations[:, :3] = rate[:, :3], change[:, :3]
        if value.shape[1] == 3:
            return Poses(value, None, twists, accelerations, None)
        q, dq, ddq = (each[:, 3:] for each in (value, rate, change))
        length = np.linalg.norm(q, axis=1)[:, None]
        along = (q * dq).sum(axis=1)[:, None] / length**2  # rate of the length's logarithm
        # omega is the vector part of 2 q' q^-1, which no scaling changes.
        twists[:, 3:] = 2.0 * _vector_of_quotient(dq, q)
        turned = 2.0 * _vector_of_quotient(ddq, q)
        accelerations[:, 3:] = turned - 2.0 * along * twists[:, 3:]
        unit = q / length
        return Poses(value[:, :3], rotation_from_quaternion(unit), twists, accelerations, unit)


def _vector_of_quotient(one: Array, by: Array) -> Array:
    """Return the vector parts of quaternions one by^-1. Shape (times, 3)."""
    (v, w), (a, b) = (np.split(each, [3], axis=1) for each in (one, by))
    vectors: Array = (b * v - w * a - np.cross(v, a)) / (by * by).sum(axis=1)[:, None]
    return vectors
