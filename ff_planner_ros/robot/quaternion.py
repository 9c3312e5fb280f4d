"""Rotations as quaternions (x, y, z, w), many at once.

In place of SciPy's `Rotation`, which takes half a second to load. Quaternions have the shape
(..., 4), matrices (..., 3, 3), rotation vectors (..., 3) [rad].
"""

from __future__ import annotations

import numpy as np

from ff_planner_ros.common.arrays import Array

_SMALL = 1e-3  # [rad]: below, sines are replaced by their series, which are exact to rounding there


def rotation_from_quaternion(quaternions: Array) -> Array:
    """Return the rotation matrices of quaternions of any norm but zero."""
    unit = unit_quaternion(quaternions)
    x, y, z, w = (unit[..., k] for k in range(4))
    xx, yy, zz, ww = x * x, y * y, z * z, w * w
    xy, xz, yz, xw, yw, zw = x * y, x * z, y * z, x * w, y * w, z * w
    rows = [
        [xx - yy - zz + ww, 2.0 * (xy - zw), 2.0 * (xz + yw)],
        [2.0 * (xy + zw), -xx + yy - zz + ww, 2.0 * (yz - xw)],
        [2.0 * (xz - yw), 2.0 * (yz + xw), -xx - yy + zz + ww],
    ]
    return np.array(rows).transpose(*range(2, unit.ndim + 1), 0, 1)


def quaternion_from_rotation(rotations: Array) -> Array:
    """Return unit quaternions of rotation matrices, their largest entry positive."""
    R = np.moveaxis(rotations, (-2, -1), (0, 1))
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    x, y, z, w = (
        1.0 - trace + 2.0 * R[0, 0],
        1.0 - trace + 2.0 * R[1, 1],
        1.0 - trace + 2.0 * R[2, 2],
        1.0 + trace,
    )
    xy, xz, yz = R[1, 0] + R[0, 1], R[2, 0] + R[0, 2], R[2, 1] + R[1, 2]
    xw, yw, zw = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    # Four times the products of a quaternion's entries: those with the largest entry lose no digit.
    products = np.array([[x, xy, xz, xw], [xy, y, yz, yw], [xz, yz, z, zw], [xw, yw, zw, w]])
    largest = np.argmax(np.array([R[0, 0], R[1, 1], R[2, 2], trace]), axis=0)
    chosen = np.take_along_axis(products, largest[None, None], axis=0)[0]
    return unit_quaternion(np.moveaxis(chosen, 0, -1))


def quaternion_from_rotation_vector(rotation_vectors: Array) -> Array:
    """Return the unit quaternions of rotation vectors."""
    angle = _length(rotation_vectors)
    small = angle <= _SMALL
    series = 0.5 - angle**2 / 48.0 + angle**4 / 3840.0
    scale = np.where(small, series, np.sin(angle / 2.0) / np.where(small, 1.0, angle))
    return np.concatenate([rotation_vectors * scale, np.cos(angle / 2.0)], axis=-1)


def rotation_vector_from_quaternion(quaternions: Array) -> Array:
    """Return the rotation vectors, of length pi at most, of unit quaternions."""
    short = canonical_quaternion(quaternions)
    angle = 2.0 * np.arctan2(_length(short[..., :3]), short[..., 3:])
    small = angle <= _SMALL
    series = 2.0 + angle**2 / 12.0 + 7.0 * angle**4 / 2880.0
    scale = np.where(small, series, angle / np.where(small, 1.0, np.sin(angle / 2.0)))
    vectors: Array = short[..., :3] * scale
    return vectors


def angle_of_quaternion(quaternions: Array) -> Array:
    """Return the rotation angles, from 0 to pi, of unit quaternions. Shape (...)."""
    sine = _length(quaternions[..., :3])[..., 0]
    angles: Array = 2.0 * np.arctan2(sine, np.abs(quaternions[..., 3]))
    return angles


def quaternion_product(after: Array, before: Array) -> Array:
    """Return the unit quaternions of R(after) R(before): the rotation `before` comes first."""
    x, y, z, w = (after[..., k] for k in range(4))
    a, b, c, d = (before[..., k] for k in range(4))
    whole = [
        w * a + d * x + (y * c - z * b),
        w * b + d * y + (z * a - x * c),
        w * c + d * z + (x * b - y * a),
        w * d - (x * a + y * b + z * c),
    ]
    return unit_quaternion(np.stack(whole, axis=-1))


def quaternion_inverse(quaternions: Array) -> Array:
    """Return the inverses of unit quaternions."""
    back: Array = quaternions * np.array([-1.0, -1.0, -1.0, 1.0])
    return back


def canonical_quaternion(quaternions: Array) -> Array:
    """Return q or -q, whichever has a positive first non-zero entry in the order w, x, y, z."""
    w_first = np.roll(quaternions, 1, axis=-1)
    deciding = np.take_along_axis(w_first, np.argmax(w_first != 0.0, axis=-1)[..., None], axis=-1)
    return np.where(deciding < 0.0, -quaternions, quaternions)


def unit_quaternion(quaternions: Array) -> Array:
    """Return quaternions normalised to unit norm."""
    return quaternions / _length(quaternions)


def _length(vectors: Array) -> Array:
    # numpy's sum along so short an axis takes three times as long.
    squares = vectors * vectors
    square = sum((squares[..., k] for k in range(1, squares.shape[-1])), squares[..., 0])
    length: Array = np.sqrt(square)[..., None]
    return length
