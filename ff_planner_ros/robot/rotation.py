"""Rotations: the cross-product matrix and the paper's Euler angles.

Euler angles are [phi_x, theta_y, psi_z] with R = Rz(psi) Ry(theta) Rx(phi): the ZYX convention,
its first number the rotation about X, as the paper prints them. Vectors have the shape (..., 3),
angles in rad, and matrices (..., 3, 3).
"""

from __future__ import annotations

import numpy as np

from ff_planner_ros.common.arrays import Array


def cross(a: Array, b: Array) -> Array:
    """Return a x b; for a few vectors, numpy's `cross` takes four times as long."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    product[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    product[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    product[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def skew(a: Array) -> Array:
    """Return the matrices of the cross product with a, Eq. (10)."""
    matrix = np.zeros((*a.shape, 3))
    matrix[..., 0, 1], matrix[..., 0, 2] = -a[..., 2], a[..., 1]
    matrix[..., 1, 0], matrix[..., 1, 2] = a[..., 2], -a[..., 0]
    matrix[..., 2, 0], matrix[..., 2, 1] = -a[..., 1], a[..., 0]
    return matrix


def rotation_from_euler(euler: Array) -> Array:
    """Return Rz(psi) Ry(theta) Rx(phi)."""
    (sx, sy, sz), (cx, cy, cz) = (np.moveaxis(f(euler), -1, 0) for f in (np.sin, np.cos))
    rows = [
        [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
        [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
        [-sy, cy * sx, cy * cx],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def euler_from_rotation(rotation: Array) -> Array:
    """Return phi, theta, psi [rad]; theta within +-90 deg, where phi and psi are ill-defined."""
    phi = np.arctan2(rotation[..., 2, 1], rotation[..., 2, 2])
    theta = np.arctan2(-rotation[..., 2, 0], np.hypot(rotation[..., 2, 1], rotation[..., 2, 2]))
    psi = np.arctan2(rotation[..., 1, 0], rotation[..., 0, 0])
    return np.stack([phi, theta, psi], axis=-1)


def euler_rate_map(euler: Array) -> Array:
    """Return W with omega = W euler_rate, omega in the frame that the rotation maps to."""
    sy, cy = np.sin(euler[..., 1]), np.cos(euler[..., 1])
    sz, cz = np.sin(euler[..., 2]), np.cos(euler[..., 2])
    rate_map = np.zeros((*euler.shape, 3))
    rate_map[..., 0, 0], rate_map[..., 1, 0], rate_map[..., 2, 0] = cz * cy, sz * cy, -sy
    rate_map[..., 0, 1], rate_map[..., 1, 1] = -sz, cz
    rate_map[..., 2, 2] = 1.0
    return rate_map


def euler_rate_map_derivative(euler: Array, rate: Array) -> Array:
    """Return d(W rate)/d euler at fixed Euler rates [rad/s]; the first column is zero."""
    sy, cy = np.sin(euler[..., 1]), np.cos(euler[..., 1])
    sz, cz = np.sin(euler[..., 2]), np.cos(euler[..., 2])
    phi_rate, theta_rate = rate[..., 0], rate[..., 1]
    derivative = np.zeros((*euler.shape, 3))
    derivative[..., 0, 1] = -cz * sy * phi_rate
    derivative[..., 1, 1] = -sz * sy * phi_rate
    derivative[..., 2, 1] = -cy * phi_rate
    derivative[..., 0, 2] = -sz * cy * phi_rate - cz * theta_rate
    derivative[..., 1, 2] = cz * cy * phi_rate - sz * theta_rate
    return derivative


def euler_rate_map_second_derivative(euler: Array, rate: Array) -> Array:
    """Return the derivative of (d(W rate)/d euler) rate by euler; the first column is zero."""
    sy, cy = np.sin(euler[..., 1]), np.cos(euler[..., 1])
    sz, cz = np.sin(euler[..., 2]), np.cos(euler[..., 2])
    phi_rate, theta_rate, psi_rate = rate[..., 0], rate[..., 1], rate[..., 2]
    first, second, third = phi_rate * theta_rate, phi_rate * psi_rate, theta_rate * psi_rate
    derivative = np.zeros((*euler.shape, 3))
    derivative[..., 0, 1] = -cz * cy * first + sz * sy * second
    derivative[..., 1, 1] = -sz * cy * first - cz * sy * second
    derivative[..., 2, 1] = sy * first
    derivative[..., 0, 2] = sz * sy * first - cz * cy * second + sz * third
    derivative[..., 1, 2] = -cz * sy * first - sz * cy * second - cz * third
    return derivative
