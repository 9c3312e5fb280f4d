"""The robot's mathematics against the paper's equations, several robots, random states."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from paper_equations import Array, PaperTerms, paper_terms
from robots import ROBOTS, paper_velocity, random_state, tangent_per_paper_velocity
from scipy.spatial.transform import Rotation

from ff_planner_ros.core.velocity_map import velocity
from ff_planner_ros.robot.configuration import configuration, system_state
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import generalised_jacobian, total_momentum
from ff_planner_ros.robot.state import SystemState

STATES = 5


class Case(NamedTuple):
    """One robot at one state, both ways."""

    robot: Robot
    data: pin.Data
    state: SystemState
    q: Array
    v: Array
    paper: PaperTerms

    @property
    def chaser_twist(self) -> Array:
        """v_ch and omega_ch."""
        return np.concatenate(
            [
                self.state.linear_velocity_chaser_in_inertial,
                self.state.angular_velocity_chaser_in_inertial,
            ]
        )

    @property
    def q_v(self) -> Array:
        """The paper's generalised velocities."""
        return paper_velocity(self.state)

    @property
    def tangent_per_q_v(self) -> Array:
        """Pinocchio's velocity per entry of q_v."""
        return tangent_per_paper_velocity(self.robot, self.state)


@pytest.fixture(params=[f"{name}-{seed}" for name in ROBOTS for seed in range(STATES)])
def case(request: pytest.FixtureRequest) -> Case:
    """Every robot at several states."""
    name, seed = request.param.split("-")
    robot = robot_from_urdf_text(*ROBOTS[name])
    state = random_state(robot, np.random.default_rng(int(seed)))
    q, v = configuration(robot, state)
    paper = paper_terms(
        *ROBOTS[name],
        r_ch=state.position_chaser_in_inertial,
        rotation_ch=Rotation.from_quat(state.quaternion_chaser_to_inertial_xyzw).as_matrix(),
        theta=state.joint_positions,
    )
    return Case(robot, robot.model.createData(), state, q, v, paper)


def agree(ours: Array, expected: Array) -> None:
    """1e-10 of the largest entry, or of one."""
    assert ours.shape == expected.shape
    assert np.max(np.abs(ours - expected)) <= 1e-10 * max(1.0, np.max(np.abs(expected)))


def test_the_end_effector_is_where_the_urdf_puts_it(case: Case) -> None:
    pin.framesForwardKinematics(case.robot.model, case.data, case.q)
    placement = case.data.oMf[case.robot.tip_frame_id]
    agree(placement.translation, case.paper.r_ee)
    agree(placement.rotation, case.paper.rotation_ee)


def test_link_velocities_are_those_of_eqs_8_to_11(case: Case) -> None:
    v_ch, omega_ch = case.chaser_twist[:3], case.chaser_twist[3:]
    pin.forwardKinematics(case.robot.model, case.data, case.q, case.v)
    for i in range(1 + case.robot.joints):
        lever, joint_twist = case.robot.model.inertias[i + 1].lever, case.data.v[i + 1]
        rotation = case.data.oMi[i + 1].rotation
        velocity = joint_twist.linear + np.cross(joint_twist.angular, lever)
        offset = case.paper.r[i] - case.paper.r[0]
        agree(
            rotation @ velocity,
            v_ch + np.cross(omega_ch, offset) + case.paper.J_t[i] @ case.state.joint_velocities,
        )
        agree(
            rotation @ joint_twist.angular,
            omega_ch + case.paper.J_r[i] @ case.state.joint_velocities,
        )


def test_the_mass_matrix_is_that_of_eqs_13_to_19(case: Case) -> None:
    mass_matrix = pin.crba(case.robot.model, case.data, case.q)
    agree(case.tangent_per_q_v.T @ mass_matrix @ case.tangent_per_q_v, case.paper.M)


def test_kinetic_energy_is_that_of_eq_12(case: Case) -> None:
    energy = pin.computeKineticEnergy(case.robot.model, case.data, case.q, case.v)
    agree(np.array([energy]), np.array([case.q_v @ case.paper.M @ case.q_v / 2]))


def test_total_momentum_is_that_of_eqs_24_to_26(case: Case) -> None:
    expected = case.paper.H_ch @ case.chaser_twist + case.paper.H_m @ case.state.joint_velocities
    agree(total_momentum(case.robot, case.data, case.q, case.v), expected)


def test_the_end_effector_jacobians_are_those_of_eqs_28_and_29(case: Case) -> None:
    jacobian = pin.computeFrameJacobian(
        case.robot.model,
        case.data,
        case.q,
        case.robot.tip_frame_id,
        pin.LOCAL_WORLD_ALIGNED,
    )
    agree(jacobian @ case.tangent_per_q_v, np.hstack([case.paper.J_ch, case.paper.J_m]))


def test_the_generalised_jacobian_is_that_of_eq_32(case: Case) -> None:
    agree(generalised_jacobian(case.robot, case.data, case.q), case.paper.J_D)


def test_the_velocity_map_is_that_of_eqs_27_and_31_with_momentum(case: Case) -> None:
    rng = np.random.default_rng(7)
    momentum, twist_ee = rng.normal(size=6), rng.normal(scale=0.1, size=6)
    paper = case.paper
    drift = np.linalg.solve(paper.H_ch, momentum)
    theta_dot = np.linalg.pinv(paper.J_D) @ (twist_ee - paper.J_ch @ drift)  # (31)
    chaser_twist = drift - np.linalg.solve(paper.H_ch, paper.H_m @ theta_dot)  # (27)

    solution = velocity(case.robot, case.q, momentum, twist_ee)
    state = system_state(case.robot, case.q, solution.v)
    agree(state.joint_velocities, theta_dot)
    agree(state.linear_velocity_chaser_in_inertial, chaser_twist[:3])
    agree(state.angular_velocity_chaser_in_inertial, chaser_twist[3:])
