"""The rollout: against an independent integration of the paper's equations, and its laws."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from core_rows import sensitivity_of
from oracle import golden
from paper_equations import PaperTerms, paper_terms
from reference_end_effector import twist_of
from robots import ROBOTS, one_line_urdf, random_path, random_state
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import Status
from ff_planner_ros.planning.paths.end_effector_polynomial import EndEffectorPaths
from ff_planner_ros.planning.paths.path_family import Motion, singular_refusal
from ff_planner_ros.planning.paths.polynomial import (
    EndEffectorPolynomial,
)
from ff_planner_ros.robot.configuration import configuration, system_state
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import total_momentum
from ff_planner_ros.robot.state import SystemState

DURATION = 5.0
# Of states drawn at random, ones from which these motions stay away from singularities.
STATE_SEEDS = {"six joints": 8, "lemur": 2, "nine joints": 7, "canadarm2": 4}


class Case(NamedTuple):
    """A drifting, tumbling robot whose hand goes a few decimetres on a bent way."""

    name: str
    robot: Robot
    start: SystemState
    q: Array
    momentum: Array
    polynomial: EndEffectorPolynomial
    coefficients: Array

    @property
    def paths(self) -> EndEffectorPaths:
        return EndEffectorPaths(self.robot, self.q, self.momentum, self.polynomial)

    def roll_out(self, points: int) -> Motion:
        return self.paths.motion(self.coefficients.ravel(), points)


def case_of(name: str, reach: float = 0.15) -> Case:
    robot = robot_from_urdf_text(*ROBOTS[name])
    rng = np.random.default_rng(STATE_SEEDS[name])
    start = random_state(robot, rng)
    q, v = configuration(robot, start)
    path = random_path(robot, start, rng, DURATION, reach)
    return Case(
        name,
        robot,
        start,
        q,
        total_momentum(robot, robot.model.createData(), q, v),
        path,
        rng.normal(scale=0.05, size=(6, 3)),
    )


@pytest.fixture(params=list(ROBOTS), scope="module")
def case(request: pytest.FixtureRequest) -> Case:
    return case_of(request.param)


@pytest.fixture(scope="module")
def exact_end(case: Case) -> SystemState:
    return golden(f"the rollout of {case.name}")


def integrate_paper_equations(name: str) -> SystemState:
    """The end state by an eighth-order method."""
    case = case_of(name)
    y_start, velocities = paper_equations_of_motion(case)
    solved = solve_ivp(
        lambda t, y: rates(y, velocities(t, y)),
        (0.0, DURATION),
        y_start,
        method="DOP853",
        rtol=1e-11,
        atol=1e-11,
    )
    y = solved.y[:, -1]
    v = velocities(DURATION, y)
    return SystemState(y[:3], y[3:7] / np.linalg.norm(y[3:7]), v[:3], v[3:6], y[7:], v[6:])


INTEGRATIONS = {
    f"the rollout of {name}": partial(integrate_paper_equations, name) for name in ROBOTS
}


def paper_equations_of_motion(case: Case) -> tuple[Array, Callable[[float, Array], Array]]:
    """Eqs. (23), (27) and (31), nothing of it from the package but the end effector's twist.

    Returns:
        The start in plain coordinates (chaser centre of mass, quaternion, joints), and the
        function of time and coordinates that gives chaser twist and joint rates.
    """
    start = case.start

    def terms_at(y: Array) -> PaperTerms:
        attitude = Rotation.from_quat(y[3:7]).as_matrix()
        return paper_terms(*ROBOTS[case.name], r_ch=y[:3], rotation_ch=attitude, theta=y[7:])

    y_start = np.concatenate(
        [
            start.position_chaser_in_inertial,
            start.quaternion_chaser_to_inertial_xyzw,
            start.joint_positions,
        ]
    )
    chaser_twist = np.concatenate(
        [start.linear_velocity_chaser_in_inertial, start.angular_velocity_chaser_in_inertial]
    )
    at_start = terms_at(y_start)
    momentum = at_start.H_ch @ chaser_twist + at_start.H_m @ start.joint_velocities  # (24)

    def velocities(t: float, y: Array) -> Array:
        paper = terms_at(y)
        twist = twist_of(case.polynomial, case.coefficients, np.array([t / DURATION]))[0]
        drift = np.linalg.solve(paper.H_ch, momentum)
        theta_dot = np.linalg.pinv(paper.J_D) @ (twist - paper.J_ch @ drift)  # (31)
        chaser = drift - np.linalg.solve(paper.H_ch, paper.H_m @ theta_dot)  # (27)
        return np.concatenate([chaser, theta_dot])

    return y_start, velocities


def rates(y: Array, v: Array) -> Array:
    """How fast the plain coordinates change."""
    vector, scalar, omega = y[3:6], y[6], v[3:6]
    quaternion_rate = [*(scalar * omega + np.cross(omega, vector)) / 2, -omega @ vector / 2]
    return np.concatenate([v[:3], quaternion_rate, v[6:]])


def test_a_fine_rollout_ends_where_the_paper_s_equations_end(
    case: Case, exact_end: SystemState
) -> None:
    rollout = case.roll_out(points=301)
    end = system_state(case.robot, rollout.q[-1], rollout.v[-1])
    for name in end.__dataclass_fields__:
        if name in ("joint_accelerations", "wheel_momenta"):
            continue
        expected, found = getattr(exact_end, name), getattr(end, name)
        if name == "quaternion_chaser_to_inertial_xyzw":
            found = found * np.sign(found @ expected)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=3e-9, err_msg=name)


def test_halving_the_step_cuts_the_error_of_base_and_joints_sixteenfold(
    case: Case, exact_end: SystemState
) -> None:
    exact, _ = configuration(case.robot, exact_end)
    errors = np.array(
        [
            pin.difference(case.robot.model, exact, case.roll_out(points).q[-1])
            for points in (21, 41, 81)
        ]
    )
    for name, part in (
        ("base position", slice(0, 3)),
        ("base attitude", slice(3, 6)),
        ("joints", slice(6, None)),
    ):
        sizes = np.linalg.norm(errors[:, part], axis=1)
        ratios = sizes[:-1] / sizes[1:]
        assert np.all(np.abs(ratios - 16.0) <= 1.0), f"{name}: errors {sizes}, ratios {ratios}"


def test_halving_the_step_cuts_the_distance_from_the_wanted_path_sixteenfold(case: Case) -> None:
    wanted_position, wanted_rotation = case.polynomial.pose(case.coefficients, np.array([1.0]))
    wanted = pin.SE3(wanted_rotation[0], wanted_position[0])
    data = case.robot.model.createData()
    errors = []
    for points in (21, 41, 81):
        pin.framesForwardKinematics(case.robot.model, data, case.roll_out(points).q[-1])
        placement = data.oMf[case.robot.tip_frame_id]
        errors.append(np.linalg.norm(pin.log6(wanted.actInv(placement))))
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.all(np.abs(ratios - 16.0) <= 1.5), f"errors {errors}, ratios {ratios}"


def test_the_end_effector_has_the_wanted_twist_at_every_point(case: Case) -> None:
    rollout = case.roll_out(points=21)
    wanted = twist_of(case.polynomial, case.coefficients, np.linspace(0.0, 1.0, 21))
    model, tip, data = case.robot.model, case.robot.tip_frame_id, case.robot.model.createData()
    for i, (q, v) in enumerate(zip(rollout.q, rollout.v, strict=True)):
        pin.forwardKinematics(model, data, q, v)
        found = pin.getFrameVelocity(model, data, tip, pin.LOCAL_WORLD_ALIGNED).vector
        np.testing.assert_allclose(found, wanted[i], rtol=0.0, atol=1e-11, err_msg=f"point {i}")


@pytest.mark.law("PLAN-03")
def test_momentum_is_constant_along_the_rollout(case: Case) -> None:
    rollout = case.roll_out(points=21)
    data = case.robot.model.createData()
    for i, (q, v) in enumerate(zip(rollout.q, rollout.v, strict=True)):
        change = total_momentum(case.robot, data, q, v) - case.momentum
        relative = np.linalg.norm(change) / np.linalg.norm(case.momentum)
        assert relative < 1e-9, f"point {i}: relative change {relative:.1e}"


def test_the_first_point_is_the_start_and_half_way_lies_between_the_points(case: Case) -> None:
    rollout = case.roll_out(points=7)
    np.testing.assert_array_equal(rollout.q[0], case.q)
    assert rollout.q.shape == (7, 7 + case.robot.joints)
    assert rollout.q_half_way.shape == (6, 7 + case.robot.joints)


def test_configurations_half_way_are_of_order_three(case: Case) -> None:
    def largest_error(points: int) -> float:
        coarse, fine = case.roll_out(points=points), case.roll_out(points=2 * points - 1)
        pairs = zip(fine.q[1::2], coarse.q_half_way, strict=True)
        errors = [np.linalg.norm(pin.difference(case.robot.model, *pair)) for pair in pairs]
        return float(np.max(errors))

    ratio = largest_error(41) / largest_error(81)
    assert 7.0 < ratio < 9.0, ratio


@pytest.mark.law("PLAN-27")
def test_sensitivities_are_those_of_differences(case: Case) -> None:
    step, x = 1e-5, case.coefficients.ravel()
    centre = case.roll_out(points=9)
    sensitivity = sensitivity_of(case.paths, centre)

    def tangent(q: Array, origin: Array) -> Array:
        pairs = zip(origin, q, strict=True)
        return np.array([pin.difference(case.robot.model, *pair) for pair in pairs])

    expected: dict[str, list[Array]] = {"q": [], "v": [], "q_half_way": []}
    for aside in step * np.eye(18):
        ahead, behind = (case.paths.motion(x + sign * aside, points=9) for sign in (1, -1))
        for name, columns in expected.items():
            if name == "v":
                difference = ahead.v - behind.v
            else:
                origin = getattr(centre, name)
                difference = tangent(getattr(ahead, name), origin) - tangent(
                    getattr(behind, name), origin
                )
            columns.append(difference / (2 * step))
    for name, columns in expected.items():
        truth, found = np.stack(columns, axis=-1), getattr(sensitivity, name)
        assert found.shape == truth.shape, name
        error = np.abs(found - truth).max() / np.abs(truth).max()
        assert error < 1e-6, f"{name}: relative error {error:.1e}"


def test_accelerations_are_the_rates_of_a_fine_rollout_s_velocities(case: Case) -> None:
    points = 401
    step = DURATION / (points - 1)
    rollout = case.roll_out(points)
    v = rollout.v
    # Five points: exact to the fourth order.
    expected = (v[:-4] - 8 * v[1:-3] + 8 * v[3:-1] - v[4:]) / (12 * step)
    found = sensitivity_of(case.paths, rollout).acceleration
    assert found.shape == v.shape
    error = np.abs(found[2:-2] - expected).max() / np.abs(expected).max()
    assert error < 1e-6, f"relative error {error:.1e}"


def test_a_path_out_of_the_workspace_ends_there_and_says_when() -> None:
    """The time is that at which an adaptive integration finds the joints running away."""
    case = case_of("lemur", reach=5.0)
    points = 101
    time = case.roll_out(points).singular_at
    assert time is not None
    runaway = time_of_runaway(case)
    assert abs(time - runaway) < 2 * DURATION / (points - 1), f"{time} s is not {runaway} s"


def test_a_velocity_map_without_solution_ends_the_motion_likewise(case: Case) -> None:
    """No joint can move this hand but about one line."""
    robot = robot_from_urdf_text(one_line_urdf(), "base", "link_6")
    paths = EndEffectorPaths(robot, pin.neutral(robot.model), np.zeros(6), case.polynomial)
    assert paths.motion(np.ones(18), points=5).singular_at == 0.0


def test_the_words_of_a_singularity_name_its_time() -> None:
    refusal = singular_refusal(1.234, 5.0)
    assert refusal.status is Status.SINGULAR
    assert "dynamic singularity at t = 1.23 s of 5 s" in str(refusal)


def time_of_runaway(case: Case) -> float:
    """When the paper's equations ask for joint rates of more than 10 rad/s in all."""
    y_start, velocities = paper_equations_of_motion(case)

    def reserve(t: float, y: Array) -> float:
        return 10.0 - float(np.linalg.norm(velocities(t, y)[6:]))

    reserve.terminal = True
    solved = solve_ivp(
        lambda t, y: rates(y, velocities(t, y)), (0.0, DURATION), y_start, events=reserve, rtol=1e-5
    )
    assert solved.status == 1, solved.message
    return float(solved.t[-1])
