"""The velocity map: its constraints, its minimum, its derivatives. Eq. (31) itself is elsewhere."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from robots import one_line_urdf, random_state

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core.velocity_map import velocity
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import generalised_jacobian, total_momentum


class Case(NamedTuple):
    """A robot with several questions to the map."""

    robot: Robot
    questions: list[tuple[Array, Array, Array]]
    """Each a configuration, a momentum and a wanted twist."""


@pytest.fixture
def case(robot: Robot) -> Case:
    rng = np.random.default_rng(robot.joints)
    questions = []
    while len(questions) < 8:
        q, _ = configuration(robot, random_state(robot, rng))
        # A few decimetres and tenths of a radian per second, of a chaser and of a hand.
        question = q, rng.normal(scale=40.0, size=6), rng.normal(scale=0.2, size=6)
        if velocity(robot, *question) is not None:  # the arm can follow
            questions.append(question)
    return Case(robot, questions)


def test_the_solution_has_the_wanted_momentum(case: Case) -> None:
    data = case.robot.model.createData()
    for number, (q, momentum, twist) in enumerate(case.questions):
        v = velocity(case.robot, q, momentum, twist).v
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
        v = velocity(case.robot, q, momentum, twist).v
        pin.forwardKinematics(model, data, q, v)
        found = pin.getFrameVelocity(model, data, tip, pin.LOCAL_WORLD_ALIGNED).vector
        np.testing.assert_allclose(found, twist, rtol=0.0, atol=1e-10, err_msg=f"question {number}")


def test_no_joint_rates_are_spent_in_the_null_space(case: Case) -> None:
    data = case.robot.model.createData()
    for number, (q, momentum, twist) in enumerate(case.questions):
        rates = velocity(case.robot, q, momentum, twist).v[6:]
        _, _, rows = np.linalg.svd(generalised_jacobian(case.robot, data, q))
        wasted = rows[6:] @ rates
        assert wasted.shape == (case.robot.joints - 6,)
        assert np.abs(wasted).max(initial=0.0) < 1e-12 * np.abs(rates).max(), f"question {number}"


def test_derivatives_are_those_of_differences(case: Case) -> None:
    for number, question in enumerate(case.questions):
        solution = velocity(case.robot, *question)
        expected_of_q, expected_of_twist = differences(case.robot, *question)
        for name, found, expected in (
            ("configuration", solution.by_q, expected_of_q),
            ("twist", solution.by_twist, expected_of_twist),
        ):
            error = np.abs(found - expected).max() / np.abs(expected).max()
            assert error < 1e-6, f"question {number}, by {name}: relative error {error:.1e}"


def test_a_system_at_rest_stays_at_rest(case: Case) -> None:
    q, _, _ = case.questions[0]
    v = velocity(case.robot, q, np.zeros(6), np.zeros(6)).v
    np.testing.assert_array_equal(v, np.zeros_like(v))


def test_an_arm_whose_joints_all_turn_about_one_line_has_no_solution() -> None:
    robot = robot_from_urdf_text(one_line_urdf(), "base", "link_6")
    assert velocity(robot, pin.neutral(robot.model), np.zeros(6), np.ones(6)) is None


def differences(robot: Robot, q: Array, momentum: Array, twist: Array) -> tuple[Array, Array]:
    """Central differences by tangent steps of q and by twist, a column for each entry."""
    solve, step = partial(velocity, robot), 1e-5
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
