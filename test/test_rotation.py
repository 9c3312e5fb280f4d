"""Rotations against their definitions."""

from __future__ import annotations

import numpy as np
import pytest

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.rotation import (
    cross,
    euler_from_rotation,
    euler_rate_map,
    euler_rate_map_derivative,
    rotation_from_euler,
    skew,
)


def elementary(axis: int, angle: float) -> Array:
    """The rotation about x, y or z: it takes the next axis towards the one after it."""
    after, last = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[after, after] = rotation[last, last] = np.cos(angle)
    rotation[last, after], rotation[after, last] = np.sin(angle), -np.sin(angle)
    return rotation


def random_eulers(seed: int) -> Array:
    """Anywhere but within half a degree of the singularity. Shape (4, 25, 3)."""
    limits = np.deg2rad([180.0, 89.5, 180.0])
    return np.random.default_rng(seed).uniform(-limits, limits, (4, 25, 3))


def test_euler_angles_turn_about_x_then_y_then_z_of_the_resting_frame() -> None:
    eulers = random_eulers(0)
    rotations = rotation_from_euler(eulers)
    assert rotations.shape == (4, 25, 3, 3)
    for index in np.ndindex(4, 25):
        phi, theta, psi = eulers[index]
        expected = elementary(2, psi) @ elementary(1, theta) @ elementary(0, phi)
        np.testing.assert_allclose(
            rotations[index], expected, rtol=0.0, atol=1e-15, err_msg=f"euler {eulers[index]}"
        )


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_each_euler_angle_alone_turns_about_its_own_axis(axis: int) -> None:
    euler = np.zeros(3)
    euler[axis] = 0.3
    np.testing.assert_array_equal(rotation_from_euler(euler), elementary(axis, 0.3))


def test_euler_angles_survive_the_round_trip() -> None:
    eulers = random_eulers(1)
    np.testing.assert_allclose(
        euler_from_rotation(rotation_from_euler(eulers)), eulers, rtol=0.0, atol=1e-13
    )


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_pitch_is_exact_even_next_to_the_singularity(side: float) -> None:
    pitch = side * (np.pi / 2 - 1e-6)
    found = euler_from_rotation(rotation_from_euler(np.array([0.4, pitch, -2.0])))
    # Its sine differs from one by 5e-13: an arc sine would be wrong in the tenth digit.
    assert abs(found[1] - pitch) < 1e-14, f"pitch {pitch!r} came back as {found[1]!r}"


def test_the_rate_map_gives_the_angular_velocity_in_the_resting_frame() -> None:
    eulers, rates = random_eulers(2), random_eulers(3)
    step = 1e-5
    ahead, behind = (rotation_from_euler(eulers + sign * step * rates) for sign in (1.0, -1.0))
    rotation_rate = (ahead - behind) / (2 * step)
    expected = rotation_rate @ rotation_from_euler(eulers).swapaxes(-2, -1)
    omega = np.einsum("...ij,...j->...i", euler_rate_map(eulers), rates)
    np.testing.assert_allclose(skew(omega), expected, rtol=0.0, atol=1e-8)


def test_the_rate_map_s_derivative_is_that_of_its_differences() -> None:
    eulers, rates = random_eulers(4), random_eulers(5)
    derivative = euler_rate_map_derivative(eulers, rates)
    step = 1e-5
    for k in range(3):
        aside = step * np.eye(3)[k]
        change = (euler_rate_map(eulers + aside) - euler_rate_map(eulers - aside)) / (2 * step)
        np.testing.assert_allclose(
            derivative[..., k],
            np.einsum("...ij,...j->...i", change, rates),
            rtol=0.0,
            atol=1e-9,
            err_msg=f"with respect to angle {k}",
        )


def test_the_cross_product_is_numpy_s_to_the_last_bit() -> None:
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(7, 3)), rng.normal(size=3)
    for one, other in ((a, b), (b, a), (b, a[0])):
        assert cross(one, other).tobytes() == np.cross(one, other).tobytes()


def test_the_skew_matrix_is_the_cross_product() -> None:
    a, b = np.random.default_rng(6).normal(size=(2, 7, 5, 3))
    np.testing.assert_allclose(
        np.einsum("...ij,...j->...i", skew(a), b), np.cross(a, b), rtol=0.0, atol=1e-14
    )


def test_the_skew_matrix_is_antisymmetric_linear_and_turns_with_its_vector() -> None:
    rng = np.random.default_rng(7)
    a, b = rng.normal(size=(2, 20, 3))
    rotation = rotation_from_euler(rng.uniform(-1.5, 1.5, 3))
    np.testing.assert_array_equal(skew(a).swapaxes(-2, -1), -skew(a))
    np.testing.assert_allclose(skew(2 * a + b), 2 * skew(a) + skew(b), rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(
        skew(a @ rotation.T), rotation @ skew(a) @ rotation.T, rtol=0.0, atol=1e-14
    )
