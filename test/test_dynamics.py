"""Inverse dynamics: against the paper's equations written out, and the laws of mechanics."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from core_rows import sensitivity_of
from dense_motion import truth
from paper_equations import PaperTerms, coriolis_matrix, paper_terms
from robots import ROBOTS, paper_velocity, random_path, random_state, tangent_per_paper_velocity
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.paths.end_effector_polynomial import EndEffectorPaths
from ff_planner_ros.planning.paths.path_family import Motion as Rollout
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.configuration import configuration, system_state
from ff_planner_ros.robot.dynamics import base_acceleration, inverse_dynamics, joint_torques
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import total_momentum
from ff_planner_ros.robot.state import SystemState

DURATION = 5.0
STATES = range(3)
MOTIONS = 3


class Case(NamedTuple):
    """One robot at one state: Pinocchio's coordinates and the paper's.

    Attributes:
        tangent_per_q_v: Pinocchio's velocity per entry of the paper's q_v.
        bias: Pinocchio's acceleration where q_v' is zero: the base frame turns.
        C: Of Eq. (21).
        M_dot: Rate of the paper's mass matrix.
    """

    robot: Robot
    data: pin.Data
    q: Array
    v: Array
    q_v: Array
    tangent_per_q_v: Array
    bias: Array
    M: Array
    C: Array
    M_dot: Array


@pytest.fixture(params=[f"{name}-{seed}" for name in ROBOTS for seed in STATES], scope="module")
def case(request: pytest.FixtureRequest) -> Case:
    """Every robot at several states."""
    name, seed = request.param.split("-")
    robot = robot_from_urdf_text(*ROBOTS[name])
    state = random_state(robot, np.random.default_rng(int(seed)))
    q, v = configuration(robot, state)
    C, M_dot = paper_coriolis(ROBOTS[name], state)
    return Case(
        robot,
        robot.model.createData(),
        q,
        v,
        paper_velocity(state),
        tangent_per_paper_velocity(robot, state),
        turning_base(q, v, state),
        terms_at(ROBOTS[name], state).M,
        C,
        M_dot,
    )


def terms_at(urdf: tuple[str, str, str], state: SystemState) -> PaperTerms:
    return paper_terms(
        *urdf,
        r_ch=state.position_chaser_in_inertial,
        rotation_ch=Rotation.from_quat(state.quaternion_chaser_to_inertial_xyzw).as_matrix(),
        theta=state.joint_positions,
    )


def paper_coriolis(urdf: tuple[str, str, str], state: SystemState) -> tuple[Array, Array]:
    attitude = Rotation.from_quat(state.quaternion_chaser_to_inertial_xyzw)
    return coriolis_matrix(
        *urdf,
        r_ch=state.position_chaser_in_inertial,
        Theta_ch=attitude.as_euler("ZYX")[::-1],
        theta=state.joint_positions,
        q_v=paper_velocity(state),
    )


def turning_base(q: Array, v: Array, state: SystemState) -> Array:
    """A constant inertial velocity turns backwards in the frame of a base that turns."""
    to_base = Rotation.from_quat(q[3:7]).as_matrix().T
    bias = np.zeros_like(v)
    bias[:3] = -np.cross(v[3:6], to_base @ state.linear_velocity_chaser_in_inertial)
    return bias


def near(found: Array, expected: Array, tolerance: float = 1e-9) -> None:
    """Within a part of the largest entry."""
    assert found.shape == expected.shape
    error = np.abs(found - expected).max() / np.abs(expected).max()
    assert error < tolerance, f"relative error {error:.1e}"


@pytest.mark.sampled
def test_forces_are_those_of_eq_20(case: Case) -> None:
    """Wrench on the chaser's centre of mass and torques; both sides do the same work."""
    q_v_dot = np.random.default_rng(1).normal(scale=0.1, size=len(case.q_v))
    acceleration = case.tangent_per_q_v @ q_v_dot + case.bias
    found = inverse_dynamics(case.robot, case.data, case.q, case.v, acceleration)
    expected = case.M @ q_v_dot + case.C @ case.q_v
    near(case.tangent_per_q_v.T @ found, expected)
    # The joints' rows are the same in both, and much smaller than a heavy base's.
    near(found[6:], expected[6:])


def test_coriolis_and_centrifugal_forces_are_those_of_eq_21(case: Case) -> None:
    """C is not unique, C v is: Pinocchio's, ours and the paper's agree."""
    by_matrix = pin.computeCoriolisMatrix(case.robot.model, case.data, case.q, case.v) @ case.v
    none = np.zeros_like(case.v)
    near(inverse_dynamics(case.robot, case.data, case.q, case.v, none), by_matrix, 1e-12)
    mass_matrix = pin.crba(case.robot.model, case.data, case.q)
    in_paper_s_coordinates = case.tangent_per_q_v.T @ (by_matrix + mass_matrix @ case.bias)
    near(in_paper_s_coordinates, case.C @ case.q_v)


def test_coriolis_and_centrifugal_forces_do_no_work(case: Case) -> None:
    """M' - 2C is skew-symmetric with Pinocchio's C.

    Eq. (21) splits the same forces otherwise: its matrix is not skew-symmetric, and still no
    power comes of it along the motion that it belongs to.
    """
    model, data, step = case.robot.model, case.data, 1e-4
    C = pin.computeCoriolisMatrix(model, data, case.q, case.v).copy()
    behind, ahead = (
        pin.crba(model, data, pin.integrate(model, case.q, time * case.v)).copy()
        for time in (-step, step)
    )
    skew = (ahead - behind) / (2 * step) - 2 * C
    assert np.abs(skew + skew.T).max() < 1e-7 * np.abs(skew).max()

    half_power = case.q_v @ case.C @ case.q_v
    assert case.q_v @ case.M_dot @ case.q_v == pytest.approx(2 * half_power, rel=1e-8)


class Motion(NamedTuple):
    """A rollout of a drifting, tumbling robot along a random path."""

    urdf: tuple[str, str, str]
    robot: Robot
    rollout: Rollout
    acceleration: Array


@pytest.fixture(params=list(ROBOTS), scope="module")
def motions(request: pytest.FixtureRequest) -> list[Motion]:
    """The first random problems of a robot that meet no singularity."""
    found: list[Motion] = []
    seed = 0
    while len(found) < MOTIONS:
        seed += 1
        motion = motion_of(ROBOTS[request.param], seed, points=11)
        if motion is not None:
            found.append(motion)
    return found


def motion_of(urdf: tuple[str, str, str], seed: int, points: int) -> Motion | None:
    robot, rng = robot_from_urdf_text(*urdf), np.random.default_rng(seed)
    start = random_state(robot, rng)
    q, v = configuration(robot, start)
    momentum = total_momentum(robot, robot.model.createData(), q, v)
    paths = EndEffectorPaths(robot, q, momentum, random_path(robot, start, rng, DURATION))
    rollout = paths.motion(rng.normal(scale=0.05, size=18), points)
    if rollout.singular_at is not None:
        return None
    return Motion(urdf, robot, rollout, sensitivity_of(paths, rollout).acceleration)


def test_nothing_pushes_the_base_along_a_rollout(motions: list[Motion]) -> None:
    """Relative to the wrench that would hold the base against the moving arm."""
    for robot, q, v, acceleration in points_of(motions):
        data, held = robot.model.createData(), acceleration.copy()
        held[:6] = 0.0
        wrench = inverse_dynamics(robot, data, q, v, acceleration)[:6]
        holding = inverse_dynamics(robot, data, q, v, held)[:6]
        for part in (slice(0, 3), slice(3, 6)):
            assert np.linalg.norm(wrench[part]) < 1e-9 * np.linalg.norm(holding[part])


def test_a_base_that_nothing_pushes_accelerates_as_constant_momentum_demands(
    motions: list[Motion],
) -> None:
    for robot, q, v, acceleration in points_of(motions):
        found = base_acceleration(robot, robot.model.createData(), q, v, acceleration[6:])
        near(found, acceleration[:6])


def test_torques_from_joint_accelerations_alone_are_those_of_the_whole_motion(
    motions: list[Motion],
) -> None:
    for motion in motions:
        q, v, robot = motion.rollout.q, motion.rollout.v, motion.robot
        found = joint_torques(robot, q, v, motion.acceleration[:, 6:])
        data = robot.model.createData()
        expected = [
            inverse_dynamics(robot, data, *at)[6:]
            for at in zip(q, v, motion.acceleration, strict=True)
        ]
        near(found, np.array(expected))


def test_the_power_of_the_torques_is_the_rate_of_kinetic_energy(motions: list[Motion]) -> None:
    """Energy by Eq. (12), its rate by differences along the motion's own tangent."""
    step = 1e-3
    for motion in motions:
        q, v, a = motion.rollout.q, motion.rollout.v, motion.acceleration
        torques = joint_torques(motion.robot, q, v, a[:, 6:])
        for i in range(len(q)):
            energies = []
            for time in (-step, step):
                # Of second order in time, which is all that a central difference sees.
                there = pin.integrate(motion.robot.model, q[i], time * v[i] + time**2 / 2 * a[i])
                state = system_state(motion.robot, there, v[i] + time * a[i])
                q_v = paper_velocity(state)
                energies.append(q_v @ terms_at(motion.urdf, state).M @ q_v / 2)
            rate = (energies[1] - energies[0]) / (2 * step)
            scale = np.abs(v[i, 6:]) @ np.abs(torques[i])
            assert abs(v[i, 6:] @ torques[i] - rate) < 1e-5 * scale


def points_of(motions: list[Motion]) -> list[tuple[Robot, Array, Array, Array]]:
    return [
        (motion.robot, *at)
        for motion in motions
        for at in zip(motion.rollout.q, motion.rollout.v, motion.acceleration, strict=True)
    ]


@pytest.mark.nightly
def test_the_torques_of_a_plan_are_those_of_eq_20_without_a_wrench_on_the_chaser(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    """Chaser accelerations from the first six rows, torques from the others."""
    robot, motion = lemur_capture.robot, lemur_plan.trajectory
    expected = []
    q, v = from_trajectory(robot, motion)
    for i in range(0, len(motion.time), 7):
        state = system_state(robot, q[i], v[i])
        M = terms_at(ROBOTS["lemur"], state).M
        C, _ = paper_coriolis(ROBOTS["lemur"], state)
        of_joints = M[:, 6:] @ motion.joint_accelerations[i] + C @ paper_velocity(state)
        of_chaser = -np.linalg.solve(M[:6, :6], of_joints[:6])
        expected.append(M[6:, :6] @ of_chaser + of_joints[6:])
    near(motion.joint_torques[::7], np.array(expected), 1e-8)


def test_the_peak_torques_of_a_plan_are_the_largest_at_any_time(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    peaks = truth(lemur_capture, lemur_plan.trajectory).torques
    np.testing.assert_allclose(lemur_plan.metrics.peak_joint_torques, peaks, rtol=5e-4)
    assert lemur_plan.metrics.torque_error < 1e-12
