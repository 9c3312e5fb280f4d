"""Our few functions of quaternions do what SciPy's `Rotation` does."""

from __future__ import annotations

import os

import numpy as np
import pinocchio as pin
import pytest
from managed_node import holdings
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.configuration import eigen_quaternion
from ff_planner_ros.robot.quaternion import (
    canonical_quaternion,
    quaternion_from_rotation,
    quaternion_from_rotation_vector,
    quaternion_inverse,
    quaternion_product,
    rotation_from_quaternion,
    rotation_vector_from_quaternion,
)

COUNT = 500
ROUNDING = 2e-15


def attitudes() -> Rotation:
    """Of all directions; turns about an axis, half and whole ones, and hardly any turn at all."""
    axes = np.vstack([np.eye(3), -np.eye(3)])
    angles = np.array([0.0, 1e-12, 1e-3, 0.0010001, np.pi / 2, np.pi, 2 * np.pi])
    about_axes = Rotation.from_rotvec((angles[:, None, None] * axes).reshape(-1, 3))
    return Rotation.concatenate([Rotation.random(COUNT, np.random.default_rng(5)), about_axes])


def same(found: Array, expected: Array, off: float = ROUNDING) -> None:
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=off)


def test_matrices_of_quaternions_of_any_length() -> None:
    expected = attitudes()
    lengths = np.random.default_rng(6).uniform(0.1, 10.0, len(expected))
    same(rotation_from_quaternion(lengths[:, None] * expected.as_quat()), expected.as_matrix())
    same(rotation_from_quaternion(expected.as_quat()[7]), expected.as_matrix()[7])


def test_quaternions_of_matrices() -> None:
    expected = attitudes()
    same(quaternion_from_rotation(expected.as_matrix()), expected_signs(expected))
    same(quaternion_from_rotation(expected.as_matrix()[7]), expected_signs(expected)[7])


def expected_signs(of: Rotation) -> Array:
    return np.asarray(Rotation.from_matrix(of.as_matrix()).as_quat(), np.float64)


def test_eigens_quaternion_to_the_last_bit() -> None:
    for rotation in attitudes().as_matrix():
        for one in (rotation, rotation.T):
            assert np.array_equal(eigen_quaternion(one), pin.Quaternion(one).coeffs())


def test_eigens_quaternion_keeps_no_memory() -> None:
    rotation = attitudes().as_matrix()[7]
    eigen_quaternion(rotation)
    before = holdings(os.getpid()).memory
    for _ in range(50_000):
        eigen_quaternion(rotation)
    assert holdings(os.getpid()).memory - before < 1_000  # [kB]; 3,900 by pin.Quaternion(rotation)


@pytest.mark.parametrize("size", [0.0, 1e-200, 1e-9, 0.999e-3, 1.001e-3, 1.0, np.pi, 7.0, 1e3])
def test_quaternions_of_rotation_vectors(size: float) -> None:
    directions = np.random.default_rng(7).normal(size=(COUNT, 3))
    vectors = size * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    found = quaternion_from_rotation_vector(vectors)
    same(found, Rotation.from_rotvec(vectors).as_quat())


def test_rotation_vectors_of_quaternions_of_both_signs() -> None:
    quaternions = attitudes().as_quat()
    for sign in (1.0, -1.0):
        found = rotation_vector_from_quaternion(sign * quaternions)
        same(found, Rotation.from_quat(sign * quaternions).as_rotvec(), 1e-14)


def test_products_and_inverses() -> None:
    one = attitudes()
    other = Rotation.random(len(one), np.random.default_rng(8))
    product = quaternion_product(one.as_quat(), other.as_quat())
    same(rotation_from_quaternion(product), (one * other).as_matrix())
    single = quaternion_product(one.as_quat()[0], other.as_quat())
    same(rotation_from_quaternion(single), (one[0] * other).as_matrix())
    same(rotation_from_quaternion(quaternion_inverse(one.as_quat())), one.inv().as_matrix())


def test_of_two_quaternions_of_an_attitude_one_is_canonical() -> None:
    quaternions = attitudes().as_quat()
    for sign in (1.0, -1.0):
        expected = Rotation.from_quat(sign * quaternions).as_quat(canonical=True)
        same(canonical_quaternion(sign * quaternions), expected)
