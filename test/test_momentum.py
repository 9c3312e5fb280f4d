"""Laws of momentum and generalised Jacobian; their formulas are compared elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from robots import random_state
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import (
    generalised_jacobian,
    smallest_singular_values,
    total_momenta,
    total_momentum,
)
from ff_planner_ros.robot.state import SystemState

SEEDS = range(5)


def momentum_of(robot: Robot, state: SystemState) -> Array:
    return total_momentum(robot, robot.model.createData(), *configuration(robot, state))


def near(found: Array, expected: Array) -> None:
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("seed", SEEDS)
def test_it_is_the_sum_over_all_bodies(robot: Robot, seed: int) -> None:
    """Each body's velocities by differences of where it is shortly before and after."""
    q, v = configuration(robot, random_state(robot, np.random.default_rng(seed)))
    model, step = robot.model, 1e-4
    placements = []
    for time in (-step, 0.0, step):
        data = model.createData()
        pin.forwardKinematics(model, data, pin.integrate(model, q, time * v))
        placements.append(data.oMi)
    linear, angular = np.zeros(3), np.zeros(3)
    for body in range(1, model.njoints):
        inertia = model.inertias[body]
        behind, now, ahead = (of_time[body] for of_time in placements)
        velocity = (ahead.act(inertia.lever) - behind.act(inertia.lever)) / (2 * step)
        omega = pin.log3(ahead.rotation @ behind.rotation.T) / (2 * step)
        linear += inertia.mass * velocity
        angular += now.rotation @ inertia.inertia @ now.rotation.T @ omega
        angular += np.cross(now.act(inertia.lever), inertia.mass * velocity)
    found = total_momentum(robot, model.createData(), q, v)
    np.testing.assert_allclose(found[:3], linear, rtol=0.0, atol=1e-8 * np.abs(linear).max())
    np.testing.assert_allclose(found[3:], angular, rtol=0.0, atol=1e-8 * np.abs(angular).max())


def test_at_many_points_it_is_that_at_each(robot: Robot) -> None:
    rng = np.random.default_rng(0)
    each = [configuration(robot, random_state(robot, rng)) for _ in range(4)]
    q, v = (np.array(rows) for rows in zip(*each, strict=True))
    data = robot.model.createData()
    near(total_momenta(robot, q, v), np.array([total_momentum(robot, data, *at) for at in each]))


@pytest.mark.parametrize("seed", SEEDS)
def test_about_an_origin_moved_by_d_the_angular_part_is_less_by_d_cross_p(
    robot: Robot, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    state, d = random_state(robot, rng), rng.normal(size=3)
    moved = replace(state, position_chaser_in_inertial=state.position_chaser_in_inertial - d)
    momentum = momentum_of(robot, state)
    linear, angular = momentum[:3], momentum[3:]
    near(momentum_of(robot, moved), np.concatenate([linear, angular - np.cross(d, linear)]))


@pytest.mark.parametrize("seed", SEEDS)
def test_it_turns_with_the_whole_system(robot: Robot, seed: int) -> None:
    rng = np.random.default_rng(seed)
    state, turn = random_state(robot, rng), Rotation.from_rotvec(rng.normal(size=3))
    matrix = turn.as_matrix()
    turned = SystemState(
        matrix @ state.position_chaser_in_inertial,
        (turn * Rotation.from_quat(state.quaternion_chaser_to_inertial_xyzw)).as_quat(),
        matrix @ state.linear_velocity_chaser_in_inertial,
        matrix @ state.angular_velocity_chaser_in_inertial,
        state.joint_positions,
        state.joint_velocities,
    )
    momentum = momentum_of(robot, state)
    expected = np.concatenate([matrix @ momentum[:3], matrix @ momentum[3:]])
    near(momentum_of(robot, turned), expected)


def test_the_smallest_singular_value_is_the_least_gain_from_joint_rates_to_twist(
    robot: Robot,
) -> None:
    """Its square is the least eigenvalue of J_D J_D^T; no direction of twist is harder."""
    rng = np.random.default_rng(0)
    q = np.array([configuration(robot, random_state(robot, rng))[0] for _ in SEEDS])
    found = smallest_singular_values(robot, q)
    assert found.shape == (len(SEEDS),)
    for i, one in enumerate(q):
        jacobian = generalised_jacobian(robot, robot.model.createData(), one)
        eigenvalues = np.linalg.eigvalsh(jacobian @ jacobian.T)
        assert found[i] ** 2 == pytest.approx(eigenvalues[0], rel=1e-6), f"posture {i}"
