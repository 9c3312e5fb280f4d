"""The velocity map: its constraints, its minimum, its derivatives. Eq. (31) itself is elsewhere."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from robots import random_state

from ff_planner_ros.arrays import Array
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import generalised_jacobian, total_momentum
from ff_planner_ros.robot.velocity_map import VelocityMap, stacked


class Case(NamedTuple):
    """A robot with several questions to the map."""

    robot: Robot
    questions: list[tuple[Array, Array, Array]]
    """Each a configuration, a momentum and a wanted twist."""


@pytest.fixture
def case(robot: Robot) -> Case:
    rng = np.random.default_rng(robot.joints)
    questions = []
    for _ in range(8):
        q, _ = configuration(robot, random_state(robot, rng))
        # A few decimetres and tenths of a radian per second, of a chaser and of a hand.
        questions.append((q, rng.normal(scale=40.0, size=6), rng.normal(scale=0.2, size=6)))
    return Case(robot, questions)


def test_the_solution_has_the_wanted_momentum(case: Case) -> None:
    data = case.robot.model.createData()
    for number, (q, momentum, twist) in enumerate(case.questions):
        v = VelocityMap(case.robot).solve(q, momentum, twist).v
        np.testing.assert_allclose(
            total_momentum(case.robot, data, q, v),
            momentum,
            rtol=0.0,
            atol=1e-10 * np.abs(momentum).max(),
            err_msg=f"question {number}",
        )


def test_the_solution_moves_the_end_effector_as_wanted(case: Case) -> None:
    model, tip = case.robot.model, case.robot.tip_frame_id
    data = model.createData()
    for number, (q, momentum, twist) in enumerate(case.questions):
        v = VelocityMap(case.robot).solve(q, momentum, twist).v
        pin.forwardKinematics(model, data, q, v)
        found = pin.getFrameVelocity(model, data, tip, pin.LOCAL_WORLD_ALIGNED).vector
        np.testing.assert_allclose(found, twist, rtol=0.0, atol=1e-10, err_msg=f"question {number}")


def test_no_joint_rates_are_spent_in_the_null_space(case: Case) -> None:
    data = case.robot.model.createData()
    for number, (q, momentum, twist) in enumerate(case.questions):
        rates = VelocityMap(case.robot).solve(q, momentum, twist).v[6:]
        _, _, rows = np.linalg.svd(generalised_jacobian(case.robot, data, q))
        wasted = rows[6:] @ rates
        assert wasted.shape == (case.robot.joints - 6,)
        assert np.abs(wasted).max(initial=0.0) < 1e-12 * np.abs(rates).max(), f"question {number}"


def test_derivatives_are_those_of_differences(case: Case) -> None:
    velocity_map = VelocityMap(case.robot)
    of_q, of_twist = velocity_map.derivatives(
        stacked([velocity_map.solve(*q) for q in case.questions])
    )
    for number, question in enumerate(case.questions):
        expected_of_q, expected_of_twist = differences(case.robot, *question)
        for name, found, expected in (
            ("configuration", of_q[number], expected_of_q),
            ("twist", of_twist[number], expected_of_twist),
        ):
            error = np.abs(found - expected).max() / np.abs(expected).max()
            assert error < 1e-6, f"question {number}, by {name}: relative error {error:.1e}"


def test_a_batch_has_the_derivatives_of_each_alone(case: Case) -> None:
    velocity_map = VelocityMap(case.robot)
    solutions = [velocity_map.solve(*question) for question in case.questions]
    batch = velocity_map.derivatives(stacked(solutions))
    for number, solution in enumerate(solutions):
        for together, alone in zip(
            batch, velocity_map.derivatives(stacked([solution])), strict=True
        ):
            np.testing.assert_allclose(
                together[number], alone[0], rtol=1e-9, atol=1e-12, err_msg=f"question {number}"
            )


def test_a_system_at_rest_stays_at_rest(case: Case) -> None:
    q, _, _ = case.questions[0]
    v = VelocityMap(case.robot).solve(q, np.zeros(6), np.zeros(6)).v
    np.testing.assert_array_equal(v, np.zeros_like(v))


def test_an_arm_whose_joints_all_turn_about_one_line_has_no_solution() -> None:
    robot = robot_from_urdf_text(one_line_urdf(), "base", "link_6")
    with pytest.raises(np.linalg.LinAlgError):
        VelocityMap(robot).solve(pin.neutral(robot.model), np.zeros(6), np.ones(6))


def differences(robot: Robot, q: Array, momentum: Array, twist: Array) -> tuple[Array, Array]:
    """Central differences by tangent steps of q and by twist, a column for each entry."""
    solve, step = VelocityMap(robot).solve, 1e-5
    of_q = [
        solve(pin.integrate(robot.model, q, aside), momentum, twist).v
        - solve(pin.integrate(robot.model, q, -aside), momentum, twist).v
        for aside in step * np.eye(6 + robot.joints)
    ]
    of_twist = [
        solve(q, momentum, twist + aside).v - solve(q, momentum, twist - aside).v
        for aside in step * np.eye(6)
    ]
    return np.array(of_q).T / (2 * step), np.array(of_twist).T / (2 * step)


def one_line_urdf() -> str:
    """Six joints about the base's z axis, every centre of mass on it: nothing but turns about z."""
    inertial = (
        '<inertial><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    parts = [f'<link name="base">{inertial}</link>']
    parent = "base"
    for number in range(1, 7):
        parts.append(
            f'<link name="link_{number}">{inertial}</link>'
            f'<joint name="joint_{number}" type="revolute"><parent link="{parent}"/>'
            f'<child link="link_{number}"/><axis xyz="0 0 1"/>'
            '<limit lower="-3" upper="3" velocity="1" effort="1"/></joint>'
        )
        parent = f"link_{number}"
    return f'<robot name="one_line">{"".join(parts)}</robot>'
