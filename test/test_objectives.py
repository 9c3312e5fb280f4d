"""The paper's objectives, by hand and against differences."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
import reference_objectives
from reference_program import joint_path, power_mean
from robots import end_effector_polynomial, random_state, random_urdf
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.motion import chaser_euler, joint_path_length
from ff_planner_ros.planning.paths.end_effector_polynomial import EndEffectorPaths
from ff_planner_ros.planning.paths.polynomial import EndEffectorMotion
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.configuration import configuration, system_state
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import smallest_singular_values, total_momentum

STEP = 0.25


@pytest.fixture(params=["lemur", "nine joints"])
def robot(request: pytest.FixtureRequest, lemur: Robot) -> Robot:
    if request.param == "lemur":
        return lemur
    return robot_from_urdf_text(random_urdf(9, seed=9), "bus", "tool")


def test_the_joint_path_of_a_constant_rate_is_rate_times_time() -> None:
    rates = np.tile([3.0, 0.0, -4.0, 0.0, 0.0, 0.0, 12.0], (5, 1))  # 13 rad/s for four steps
    assert joint_path_length(rates, STEP) == pytest.approx(13.0 * 4 * STEP, rel=1e-15)


def test_the_rectangle_rule_takes_every_point_but_the_last() -> None:
    rates = np.array([[1.0, 0.0], [0.0, -2.0], [4.0, 0.0], [1000.0, 0.0]])
    assert joint_path_length(rates, STEP) == pytest.approx((1.0 + 2.0 + 4.0) * STEP, rel=1e-15)


def test_the_paper_s_straight_line_has_the_values_that_others_found(
    lemur_capture: PlanningProblem,
) -> None:
    """By an independent implementation, from inputs rounded as printed: three digits and a bit."""
    robot, target = lemur_capture.robot, lemur_capture.target
    q, v = configuration(robot, lemur_capture.start)
    data = robot.model.createData()
    momentum = total_momentum(robot, data, q, v)
    pin.framesForwardKinematics(robot.model, data, q)
    placement = data.oMf[robot.tip_frame_id]
    zero = np.zeros(6)
    rotation = Rotation.from_quat(target.quaternion_xyzw.copy()).as_matrix()
    path = end_effector_polynomial(
        EndEffectorMotion(placement.translation, placement.rotation, zero, zero),
        EndEffectorMotion(target.position, rotation, zero, zero),
        lemur_capture.duration,
    )
    rollout = EndEffectorPaths(robot, q, momentum, path).motion(np.zeros(18), points=50)
    assert joint_path_length(rollout.v[:, 6:], 10.0 / 49) == pytest.approx(1.2194, abs=3e-4)
    euler_deg = np.rad2deg(chaser_euler(robot, rollout.q))
    np.testing.assert_allclose(euler_deg[-1], [3.66, 11.75, 13.08], rtol=0.0, atol=0.02)
    assert np.abs(euler_deg).max() == pytest.approx(13.08, abs=0.02)
    assert smallest_singular_values(robot, rollout.q).min() == pytest.approx(0.165, abs=1e-3)


def random_rates(seed: int) -> tuple[Array, Array]:
    """Joint rates of six points and seven joints, affine in four variables."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(6, 7)), rng.normal(size=(6, 7, 4))


def joint_path_length_derivatives(rates: Array, sensitivity: Array) -> tuple[Array, Array]:
    """Gradient and Hessian of the joint path; how the base moves does not matter."""
    v, by_x = (np.concatenate([np.ones_like(at)[:, :6], at], axis=1) for at in (rates, sensitivity))
    value, gradient, hessian = joint_path(v, by_x, STEP)
    assert value == pytest.approx(joint_path_length(rates, STEP), rel=1e-14)
    return gradient, hessian


@pytest.mark.parametrize("seed", range(4))
def test_the_joint_path_s_gradient_is_that_of_differences(seed: int) -> None:
    rates, sensitivity = random_rates(seed)
    gradient, _ = joint_path_length_derivatives(rates, sensitivity)
    step = 1e-5
    for k in range(4):
        ahead, behind = (
            joint_path_length(rates + sign * step * sensitivity[:, :, k], STEP) for sign in (1, -1)
        )
        expected = (ahead - behind) / (2 * step)
        assert gradient[k] == pytest.approx(expected, rel=1e-7, abs=1e-8), f"variable {k}"


@pytest.mark.parametrize("seed", range(4))
def test_the_hessian_is_the_integral_of_the_motion_across_the_path(seed: int) -> None:
    """Sum of T^T (1 - u u^T) T / |theta_dot|, u the direction of motion, point by point."""
    rates, sensitivity = random_rates(seed)
    expected = np.zeros((4, 4))
    for i in range(5):
        T, speed = sensitivity[i], np.sqrt(sum(rate**2 for rate in rates[i]))
        u = rates[i] / speed
        expected += T.T @ (np.eye(7) - np.outer(u, u)) @ T / speed * STEP
    _, hessian = joint_path_length_derivatives(rates, sensitivity)
    np.testing.assert_allclose(hessian, expected, rtol=1e-12, atol=1e-12)
    smallest = np.linalg.eigvalsh(hessian)[0]
    assert smallest >= -1e-12, f"smallest eigenvalue {smallest:.1e}"


def test_the_hessian_is_that_of_differences_where_rates_are_affine() -> None:
    """There Gauss and Newton agree."""
    rates, sensitivity = random_rates(9)
    _, hessian = joint_path_length_derivatives(rates, sensitivity)
    step = 1e-5
    for k in range(4):
        ahead, behind = (
            joint_path_length_derivatives(rates + sign * step * sensitivity[:, :, k], sensitivity)[
                0
            ]
            for sign in (1, -1)
        )
        np.testing.assert_allclose(
            hessian[:, k], (ahead - behind) / (2 * step), rtol=0.0, atol=1e-7, err_msg=f"column {k}"
        )


def test_arms_at_standstill_have_finite_derivatives() -> None:
    _, sensitivity = random_rates(3)
    gradient, hessian = joint_path_length_derivatives(np.zeros((6, 7)), sensitivity)
    np.testing.assert_array_equal(gradient, np.zeros(4))
    assert np.isfinite(hessian).all()


def test_the_chaser_s_euler_angles_are_those_of_its_attitude(robot: Robot) -> None:
    rng = np.random.default_rng(10)
    states = [random_state(robot, rng) for _ in range(10)]
    q = np.array([configuration(robot, state)[0] for state in states])
    expected = [
        Rotation.from_quat(s.quaternion_chaser_to_inertial_xyzw.copy()).as_euler("ZYX")[::-1]
        for s in states
    ]
    np.testing.assert_allclose(chaser_euler(robot, q), expected, rtol=0.0, atol=1e-12)


def test_a_chaser_in_the_axes_of_the_inertial_frame_has_no_euler_angles(robot: Robot) -> None:
    q = pin.neutral(robot.model)
    q[3:7] = pin.Quaternion(robot.rotation_chaser_to_base.T.copy()).coeffs()
    np.testing.assert_allclose(chaser_euler(robot, q[None])[0], np.zeros(3), rtol=0.0, atol=1e-14)
    state = system_state(robot, q, np.zeros(6 + robot.joints))
    np.testing.assert_allclose(np.abs(state.quaternion_chaser_to_inertial_xyzw[3]), 1.0)


def test_the_chaser_s_euler_derivatives_are_those_of_differences(robot: Robot) -> None:
    rng = np.random.default_rng(11)
    points, columns, step = 10, 4, 1e-5
    q = np.array([configuration(robot, random_state(robot, rng))[0] for _ in range(points)])
    sensitivity = rng.normal(size=(points, 6 + robot.joints, columns))
    euler, found = reference_objectives.chaser_euler(q, sensitivity, robot.rotation_chaser_to_base)
    np.testing.assert_allclose(euler, chaser_euler(robot, q), rtol=0.0, atol=1e-14)
    assert found.shape == (points, 3, columns)
    for k in range(columns):
        ahead, behind = (
            np.array(
                [
                    pin.integrate(robot.model, q[i], sign * step * sensitivity[i, :, k])
                    for i in range(points)
                ]
            )
            for sign in (1, -1)
        )
        expected = (chaser_euler(robot, ahead) - chaser_euler(robot, behind)) / (2 * step)
        error = np.abs(found[:, :, k] - expected).max() / np.abs(expected).max()
        assert error < 1e-6, f"column {k}: relative error {error:.1e}"


@pytest.mark.parametrize("p", [2.0, 3.0, 8.0])
def test_a_power_mean_and_its_derivatives_are_those_of_the_formula(p: float) -> None:
    """Of values that are linear in x, the Hessian is exact, too."""
    rng = np.random.default_rng(7)
    values, jacobian, x = rng.normal(size=39), rng.normal(size=(39, 5)), rng.normal(size=5)

    def formula(at: Array) -> float:
        return float(np.mean(np.abs(values + jacobian @ at) ** p) ** (1.0 / p))

    found, gradient, hessian = power_mean(values + jacobian @ x, jacobian, p)
    assert found == pytest.approx(formula(x), rel=1e-14)
    step, axes = 1e-4, np.eye(5)
    for i, one in enumerate(step * axes):
        slope = (formula(x + one) - formula(x - one)) / (2 * step)
        assert gradient[i] == pytest.approx(slope, rel=1e-6, abs=1e-8)
        for j, other in enumerate(step * axes):
            corners = (
                formula(x + one + other)
                - formula(x + one - other)
                - formula(x - one + other)
                + formula(x - one - other)
            )
            assert hessian[i, j] == pytest.approx(corners / (4 * step**2), rel=1e-4, abs=1e-5)
    assert np.linalg.eigvalsh(hessian).min() > -1e-12


def test_a_power_mean_comes_near_the_largest_modulus_and_is_zero_where_all_are() -> None:
    values, jacobian = np.array([0.1, -0.4, 0.2]), np.eye(3)
    assert power_mean(values, jacobian, 200.0)[0] == pytest.approx(0.4, rel=1e-2)
    value, gradient, hessian = power_mean(0.0 * values, jacobian, 8.0)
    assert value == 0.0
    assert not gradient.any()
    assert not hessian.any()
