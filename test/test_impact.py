"""What a grasp does, against the equations of both bodies, conservation laws and random errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from robots import CONFIG, random_state, random_urdf
from scipy.optimize import minimize

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.impact import Impact, impact, largest_impulses
from ff_planner_ros.robot.model import Base, Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import total_momentum
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.robot.wheels import Wheels

INERTIA = pin.Inertia(
    80.0,
    np.array([0.3, -0.2, 0.5]),
    np.array([[12.0, 1.0, -0.5], [1.0, 9.0, 0.7], [-0.5, 0.7, 15.0]]),
)


def arm(seed: int, base: Base = Base.FREE_FLYER) -> Robot:
    wheels = Wheels(np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]]))
    return robot_from_urdf_text(
        random_urdf(6, seed, sliding=(3,)),
        "bus",
        "tool",
        base,
        wheels=wheels if base is Base.ATTITUDE_HELD else None,
    )


def tip(robot: Robot, state: SystemState) -> tuple[pin.SE3, Array, Array]:
    """Return placement, Jacobian in axes of the tip, and twist there in inertial axes."""
    model, data = robot.model, robot.model.createData()
    q, v = configuration(robot, state)
    pin.computeJointJacobians(model, data, q)
    place = pin.updateFramePlacement(model, data, robot.tip_frame_id)
    jacobian = np.array(pin.getFrameJacobian(model, data, robot.tip_frame_id, pin.LOCAL))
    twist = (jacobian @ v).reshape(2, 3) @ place.rotation.T
    return place.copy(), jacobian, twist.ravel()


def momentum_of_body(place: pin.SE3, twist_in_ee: Array) -> Array:
    """Linear, and angular about the inertial origin, in inertial axes, by the textbook."""
    velocity, rate = (twist_in_ee.reshape(2, 3)) @ place.rotation.T
    arm = place.rotation @ INERTIA.lever
    linear = INERTIA.mass * (velocity + np.cross(rate, arm))
    spin = place.rotation @ INERTIA.inertia @ place.rotation.T @ rate
    return np.concatenate([linear, np.cross(place.translation + arm, linear) + spin])


def in_ee(place: pin.SE3, twist: Array) -> Array:
    return (twist.reshape(2, 3) @ place.rotation).ravel()


@pytest.fixture(params=range(10))
def case(request: pytest.FixtureRequest) -> tuple[Robot, SystemState, Array, Impact]:
    rng = np.random.default_rng(request.param)
    robot = arm(request.param)
    state = random_state(robot, rng)
    twist = rng.normal(scale=0.3, size=6)
    state = replace(state, joint_accelerations=rng.normal(scale=0.1, size=robot.joints))
    return robot, state, twist, impact(robot, INERTIA, state, twist)


@pytest.mark.law("PLAN-18")
def test_it_solves_the_equations_of_both_bodies(
    case: tuple[Robot, SystemState, Array, Impact],
) -> None:
    """[M 0; 0 I] [v; w] = before + [J^T; -1] f with J v = w: the bodies and what joins them."""
    robot, state, twist, found = case
    place, jacobian, _ = tip(robot, state)
    q, v = configuration(robot, state)
    mass = pin.crba(robot.model, robot.model.createData(), q)
    mass = np.triu(mass) + np.triu(mass, 1).T
    inertia, n = INERTIA.matrix(), len(v)
    system = np.zeros((n + 12, n + 12))
    system[:n, :n], system[n : n + 6, n : n + 6] = mass, inertia
    system[:n, n + 6 :], system[n : n + 6, n + 6 :] = -jacobian.T, np.eye(6)
    system[n + 6 :, :n], system[n + 6 :, n : n + 6] = jacobian, -np.eye(6)
    before = np.concatenate([mass @ v, inertia @ in_ee(place, twist), np.zeros(6)])
    solved = np.linalg.solve(system, before)
    _, after = configuration(robot, found.after)
    np.testing.assert_allclose(after, solved[:n], atol=1e-9)
    np.testing.assert_allclose(found.twist_body_in_ee, solved[n : n + 6], atol=1e-9)
    np.testing.assert_allclose(found.impulse_in_ee, -solved[n + 6 :], atol=1e-9)


def test_in_the_moment_of_a_contact_nothing_but_velocities_changes(
    case: tuple[Robot, SystemState, Array, Impact],
) -> None:
    _, state, _, found = case
    for name in ("position_chaser_in_inertial", "joint_positions", "joint_accelerations"):
        before, after = getattr(state, name), getattr(found.after, name)
        np.testing.assert_allclose(after, before, atol=1e-12, err_msg=name)
    turns = [one.quaternion_chaser_to_inertial_xyzw for one in (state, found.after)]
    assert abs(turns[0] @ turns[1]) == pytest.approx(1.0, abs=1e-12)
    moved = found.after.joint_velocities - state.joint_velocities
    assert np.abs(moved).min() > 0.0


def test_momentum_stays_and_energy_does_not_grow(
    case: tuple[Robot, SystemState, Array, Impact],
) -> None:
    robot, state, twist, found = case
    place, _, _ = tip(robot, state)
    data = robot.model.createData()

    def both(state: SystemState, of_body: Array) -> tuple[Array, float]:
        q, v = configuration(robot, state)
        energy = pin.computeKineticEnergy(robot.model, data, q, v)
        energy += of_body @ INERTIA.matrix() @ of_body / 2.0
        return total_momentum(robot, data, q, v) + momentum_of_body(place, of_body), energy

    before, energy_before = both(state, in_ee(place, twist))
    after, energy_after = both(found.after, found.twist_body_in_ee)
    np.testing.assert_allclose(after, before, atol=1e-9)
    assert energy_after < energy_before
    _, _, moves = tip(robot, found.after)
    np.testing.assert_allclose(in_ee(place, moves), found.twist_body_in_ee, atol=1e-10)


@pytest.mark.parametrize("base", [Base.FREE_FLYER, Base.ATTITUDE_HELD])
def test_what_moves_alike_goes_on(base: Base) -> None:
    robot = arm(3, base)
    state = random_state(robot, np.random.default_rng(3))
    if base is Base.ATTITUDE_HELD:
        state = replace(state, angular_velocity_chaser_in_inertial=np.zeros(3))
    _, _, twist = tip(robot, state)
    found = impact(robot, INERTIA, state, twist)
    np.testing.assert_allclose(found.impulse_in_ee, 0.0, atol=1e-10)
    for name in ("linear_velocity_chaser_in_inertial", "joint_velocities"):
        np.testing.assert_allclose(getattr(found.after, name), getattr(state, name), atol=1e-12)


def test_wheels_take_what_turns() -> None:
    robot = arm(5, Base.ATTITUDE_HELD)
    rng = np.random.default_rng(5)
    state = replace(
        random_state(robot, rng),
        angular_velocity_chaser_in_inertial=np.zeros(3),
        wheel_momenta=rng.normal(size=4),
    )
    twist, data = rng.normal(scale=0.3, size=6), robot.model.createData()
    found = impact(robot, INERTIA, state, twist)
    place, _, _ = tip(robot, state)
    assert robot.wheels is not None
    axes = pin.Quaternion(state.quaternion_chaser_to_inertial_xyzw).toRotationMatrix()

    def total(state: SystemState, of_body: Array) -> Array:
        assert robot.wheels is not None
        momentum = total_momentum(robot, data, *configuration(robot, state))
        stored = axes @ robot.wheels.axes.T @ state.wheel_momenta
        return momentum + momentum_of_body(place, of_body) + [0, 0, 0, *stored]

    np.testing.assert_allclose(
        total(found.after, found.twist_body_in_ee), total(state, in_ee(place, twist)), atol=1e-9
    )
    assert not found.after.angular_velocity_chaser_in_inertial.any()


@pytest.mark.sampled
@pytest.mark.parametrize("seed", range(5))
def test_no_error_of_the_twist_does_more_than_is_told_and_one_does_as_much(seed: int) -> None:
    robot, rng = arm(seed), np.random.default_rng(seed)
    state, errors = random_state(robot, rng), (0.05, 0.08)
    told = largest_impulses(robot, INERTIA, state, errors)
    _, _, alike = tip(robot, state)

    def sizes(error: Array) -> Array:
        """Of the impulses that one error causes: linear, angular."""
        impulse = impact(robot, INERTIA, state, alike + error).impulse_in_ee
        return np.linalg.norm(impulse.reshape(2, 3), axis=1)

    def on_spheres(directions: Array) -> Array:
        first, second = np.split(directions, 2)
        unit = first / np.linalg.norm(first), second / np.linalg.norm(second)
        return np.concatenate([errors[0] * unit[0], errors[1] * unit[1]])

    for which in range(2):
        found = [
            -minimize(lambda x, w=which: -sizes(on_spheres(x))[w], rng.normal(size=6)).fun
            for _ in range(6)
        ]
        assert max(found) == pytest.approx(told[which], rel=1e-4)
    for error in rng.normal(size=(300, 6)):
        share = rng.uniform(0.0, 1.0, 2).repeat(3)
        assert (sizes(share * on_spheres(error)) <= np.array(told) * (1.0 + 1e-9)).all()


def test_no_error_no_impulse() -> None:
    robot = arm(1)
    state = random_state(robot, np.random.default_rng(1))
    assert largest_impulses(robot, INERTIA, state, (0.0, 0.0)) == (0.0, 0.0)


def test_on_a_table_nothing_leaves_the_plane() -> None:
    problem = load_scenario(CONFIG / "scenarios/planar_capture.yaml")
    robot, state = problem.robot, problem.start
    place, _, alike = tip(robot, state)
    twist = alike + np.array([0.1, -0.05, 0.0, 0.0, 0.0, 0.2])
    found = impact(robot, INERTIA, state, twist)
    data = robot.model.createData()
    total = {
        when: total_momentum(robot, data, *configuration(robot, at)) + momentum_of_body(place, of)
        for when, at, of in (
            ("before", state, in_ee(place, twist)),
            ("after", found.after, found.twist_body_in_ee),
        )
    }
    rows = robot.base.rows
    np.testing.assert_allclose(total["after"][rows], total["before"][rows], atol=1e-9)
    moved = np.concatenate(
        [
            found.after.linear_velocity_chaser_in_inertial,
            found.after.angular_velocity_chaser_in_inertial,
        ]
    )
    np.testing.assert_allclose(moved[2:5], 0.0, atol=1e-12)
