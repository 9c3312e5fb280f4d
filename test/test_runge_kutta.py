"""How a base turns at a constant momentum, against an integrator of its own."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from straight_arms import straight_arm

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.runge_kutta import runge_kutta_step, turned_by_momentum
from ff_planner_ros.robot.rotation import skew

SECONDS = 10.0
AXES = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()


def of_momentum(time: Array) -> Array:
    """Inverse inertias whose principal axes and moments change; shape (times, 3, 3)."""
    moments = np.stack([0.5 + 0.2 * np.sin(time), 0.9 + 0.0 * time, 1.4 - 0.3 * np.sin(2 * time)])
    axes = Rotation.from_rotvec(0.4 * np.sin(time)[:, None] * [1.0, -2.0, 0.5]).as_matrix()
    return axes @ (moments.T[:, :, None] * axes.swapaxes(1, 2))


def of_rates(time: Array) -> Array:
    return np.stack([0.3 * np.sin(time), 0.2 * np.cos(2 * time), 0.4 * np.sin(3 * time)], axis=1)


def turned(momentum: Array, steps: int) -> Array:
    half_steps = np.linspace(0.0, SECONDS, 2 * steps + 1)
    found = turned_by_momentum(
        AXES,
        momentum,
        of_momentum(half_steps),
        of_rates(half_steps),
        np.full(steps, SECONDS / steps),
    )
    return np.asarray(Rotation.from_quat(found).as_matrix(), np.float64)


def truth(momentum: Array) -> Array:
    def rate(time: float, flat: Array) -> Array:
        rotation, now = flat.reshape(3, 3), np.array([time])
        omega = of_momentum(now)[0] @ rotation.T @ momentum - of_rates(now)[0]
        return (rotation @ skew(omega)).ravel()

    solved = solve_ivp(
        rate, (0.0, SECONDS), AXES.ravel(), "DOP853", rtol=1e-12, atol=1e-13, max_step=0.05
    )
    return np.asarray(solved.y[:, -1].reshape(3, 3), np.float64)


def off(one: Array, other: Array) -> float:
    return float(np.linalg.norm(Rotation.from_matrix(one.T @ other).as_rotvec()))


@pytest.mark.parametrize(
    ("size", "allowed"), [(0.0, 2e-6), (0.01, 2e-6), (0.3, 2e-6), (2.0, 1.5e-4)]
)
def test_a_base_turns_as_an_independent_integrator_says_to_the_fourth_order(
    size: float, allowed: float
) -> None:
    """At the largest momentum by three revolutions, at up to 0.3 rad a step."""
    momentum = size * np.array([0.6, 0.0, -0.8])
    expected = truth(momentum)
    coarse, fine = (turned(momentum, steps) for steps in (100, 200))
    assert coarse.shape == (101, 3, 3)
    assert coarse[0] == pytest.approx(AXES, abs=1e-15)
    assert off(coarse[-1], expected) < allowed
    assert off(fine[-1], expected) < off(coarse[-1], expected) / 12.0
    products = fine @ fine.swapaxes(1, 2)
    assert products == pytest.approx(np.broadcast_to(np.eye(3), products.shape), abs=1e-14)


def test_without_momentum_and_rates_a_base_stays() -> None:
    still = np.zeros((7, 3))
    found = turned_by_momentum(AXES, np.zeros(3), np.tile(np.eye(3), (7, 1, 1)), still, np.ones(3))
    assert Rotation.from_quat(found).as_matrix() == pytest.approx(
        np.broadcast_to(AXES, (4, 3, 3)), abs=1e-15
    )


def test_a_ball_turns_uniformly_about_its_momentum() -> None:
    momentum, inverse = np.array([0.0, 0.3, 0.4]), np.tile(2.0 * np.eye(3), (11, 1, 1))
    found = turned_by_momentum(AXES, momentum, inverse, np.zeros((11, 3)), np.full(5, 0.7))
    turns = Rotation.from_rotvec(np.arange(6)[:, None] * 0.7 * 2.0 * momentum)
    assert Rotation.from_quat(found).as_matrix() == pytest.approx(
        (turns * Rotation.from_matrix(AXES)).as_matrix()
    )


@pytest.mark.parametrize("rate", [1e2, 1e6, 1e15])
def test_steps_that_are_far_too_long_still_make_rotations(rate: float) -> None:
    """What comes of them is wrong, and refused elsewhere."""
    half_steps = np.linspace(0.0, SECONDS, 41)
    inverses, rates = of_momentum(half_steps), rate * of_rates(half_steps)
    turns = turned_by_momentum(AXES, np.ones(3), inverses, rates, np.full(20, 0.5))
    found = Rotation.from_quat(turns).as_matrix()
    products = found @ found.swapaxes(1, 2)
    assert products == pytest.approx(np.broadcast_to(np.eye(3), products.shape), abs=1e-12)


def drawn_velocity(time: float, rotation: Array, angle: float) -> Array:
    """A base that moves and turns in its own axes by time and attitude, and a joint that swings."""
    linear = np.array([0.4, 0.2 * time, -0.3]) + rotation.T @ [0.2, -0.1, 0.3]
    angular = np.array([0.5, -0.4 * np.cos(time), 0.3 * time]) + rotation.T @ [0.1, 0.6, -0.2]
    return np.concatenate([linear, angular, [np.cos(angle) + time]])


def test_steps_on_poses_and_joints_are_of_order_four() -> None:
    """Two seconds, against an integrator of rotation matrices: half the step, a sixteenth off."""
    model, seconds = straight_arm(0.4, 1.0).model, 2.0

    def rate(time: float, flat: Array) -> Array:
        rotation = flat[3:12].reshape(3, 3)
        v = drawn_velocity(time, rotation, flat[12])
        return np.concatenate([rotation @ v[:3], (rotation @ skew(v[3:6])).ravel(), v[6:]])

    begin = np.concatenate([[1.0, -2.0, 0.5], AXES.ravel(), [0.3]])
    end = solve_ivp(rate, (0.0, seconds), begin, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    errors = []
    for steps in (10, 20):
        step = seconds / steps
        q = np.concatenate([begin[:3], Rotation.from_matrix(AXES).as_quat(), [0.3]])
        for number in range(steps):
            stages = step * (number + np.array([0.0, 0.5, 0.5, 1.0]))

            def velocity(stage: int, at: Array, times: Array = stages) -> Array:
                rotation = Rotation.from_quat(at[3:7]).as_matrix()
                return drawn_velocity(times[stage], rotation, at[7])

            q = pin.integrate(model, q, runge_kutta_step(model, q, step, velocity))
        turn = off(Rotation.from_quat(q[3:7]).as_matrix(), end[3:12].reshape(3, 3))
        errors.append([np.linalg.norm(q[:3] - end[:3]), turn, abs(q[7] - end[12])])
    coarse, fine = np.array(errors)
    assert (coarse < 1e-3).all()
    assert (fine < coarse / 12.0).all()
