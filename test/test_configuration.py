"""States to configurations and back."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from robots import random_state, random_urdf
from scipy.spatial.transform import Rotation

from ff_planner_ros.robot.configuration import configuration, system_state
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text

SEEDS = range(5)


@pytest.mark.parametrize("joints", [6, 9])
def test_the_random_robots_are_worth_testing(joints: int) -> None:
    robot = robot_from_urdf_text(random_urdf(joints, seed=joints), "bus", "tool")
    assert np.linalg.norm(robot.position_chaser_in_base) > 0.1
    assert np.linalg.norm(pin.log3(robot.rotation_chaser_to_base)) > 0.1


@pytest.mark.parametrize("seed", SEEDS)
def test_a_state_survives_the_round_trip(robot: Robot, seed: int) -> None:
    state = random_state(robot, np.random.default_rng(seed))
    back = system_state(robot, *configuration(robot, state))
    for name in state.__dataclass_fields__:
        expected, found = getattr(state, name), getattr(back, name)
        if name in ("joint_accelerations", "wheel_momenta"):  # a configuration holds none
            assert found is None
            continue
        if name == "quaternion_chaser_to_inertial_xyzw":
            found = found * np.sign(found @ expected)  # both signs are the same attitude
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-13, err_msg=name)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_configuration_puts_the_chaser_where_the_state_says(robot: Robot, seed: int) -> None:
    state = random_state(robot, np.random.default_rng(seed))
    q, _ = configuration(robot, state)
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    np.testing.assert_allclose(
        data.oMi[1].act(robot.model.inertias[1].lever),
        state.position_chaser_in_inertial,
        rtol=0.0,
        atol=1e-13,
        err_msg="centre of mass of the first body",
    )
    np.testing.assert_allclose(
        data.oMf[robot.model.getFrameId(robot.base_link)].rotation,
        Rotation.from_quat(state.quaternion_chaser_to_inertial_xyzw).as_matrix(),
        rtol=0.0,
        atol=1e-13,
        err_msg="axes of the base link",
    )
    np.testing.assert_array_equal(q[7:], state.joint_positions)


@pytest.mark.parametrize("seed", SEEDS)
def test_velocities_are_the_rates_of_the_positions(robot: Robot, seed: int) -> None:
    state = random_state(robot, np.random.default_rng(seed))
    q, v = configuration(robot, state)
    step = 1e-4
    behind, ahead = (
        system_state(robot, pin.integrate(robot.model, q, time * v), v) for time in (-step, step)
    )

    def rate(name: str) -> np.ndarray:
        return (getattr(ahead, name) - getattr(behind, name)) / (2 * step)

    turn = (
        Rotation.from_quat(ahead.quaternion_chaser_to_inertial_xyzw)
        * Rotation.from_quat(behind.quaternion_chaser_to_inertial_xyzw).inv()
    )
    for name, found, expected in (
        (
            "linear velocity",
            rate("position_chaser_in_inertial"),
            state.linear_velocity_chaser_in_inertial,
        ),
        (
            "angular velocity",
            turn.as_rotvec() / (2 * step),
            state.angular_velocity_chaser_in_inertial,
        ),
        ("joint rates", rate("joint_positions"), state.joint_velocities),
    ):
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9, err_msg=name)
