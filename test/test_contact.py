"""The contact of the simulated system: two bodies before, one after, and nothing pushes them."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pinocchio as pin
import pytest
from robots import random_state, random_urdf
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.simulation.capture import captured, end_effector_motion
from ff_planner_ros.simulation.free_floating import FreeFloatingSystem

INERTIA = np.array([[90.0, 3.0, 0.0], [3.0, 35.0, 1.0], [0.0, 1.0, 100.0]])


def momentum_of_links(robot: Robot, state: SystemState) -> Array:
    """Linear, and angular about the inertial origin: the sum over the links, each by Newton."""
    model, data, total = robot.model, robot.model.createData(), np.zeros(6)
    pin.forwardKinematics(model, data, *configuration(robot, state))
    for joint in range(1, model.njoints):
        link, place, moves = model.inertias[joint], data.oMi[joint], data.v[joint]
        turn = place.rotation
        center, rate = place.act(link.lever), turn @ moves.angular
        linear = link.mass * (turn @ (moves.linear + np.cross(moves.angular, link.lever)))
        spin = turn @ link.inertia @ turn.T @ rate
        total += [*linear, *(np.cross(center, linear) + spin)]
    return total


def momentum_of_body(body: TargetBody) -> Array:
    """The same of a body by itself."""
    turn = Rotation.from_quat(body.quaternion_xyzw.copy()).as_matrix()
    linear = body.mass * body.linear_velocity
    spin = turn @ body.inertia @ turn.T @ body.angular_velocity
    return np.concatenate([linear, np.cross(body.position, linear) + spin])


def body_near(robot: Robot, state: SystemState, rng: np.random.Generator) -> TargetBody:
    """A body whose grasp is within a centimetre of the end effector, and that moves by itself."""
    pose, _ = end_effector_motion(robot, state)
    grasp = Rotation.from_rotvec(rng.normal(size=3))
    off = Rotation.from_rotvec(rng.normal(scale=0.01, size=3))
    attitude = off * Rotation.from_matrix(pose.rotation) * grasp.inv()
    place = rng.normal(scale=0.5, size=3)
    return TargetBody(
        position=pose.translation - attitude.apply(place) + rng.normal(scale=0.004, size=3),
        quaternion_xyzw=attitude.as_quat(),
        inertia=INERTIA,
        grasp_position=place,
        grasp_quaternion_xyzw=grasp.as_quat(),
        linear_velocity=rng.normal(scale=0.1, size=3),
        angular_velocity=rng.normal(scale=0.1, size=3),
        mass=150.0,
    )


@pytest.fixture(params=range(4))
def case(request: pytest.FixtureRequest) -> tuple[Robot, JointMotion, SystemState, TargetBody]:
    """A robot, its joints' motion, and where it is after a second of that, beside a body."""
    rng = np.random.default_rng(request.param)
    robot = robot_from_urdf_text(random_urdf(6, request.param, sliding=(3,)), "bus", "tool")
    start = random_state(robot, rng)
    way = start.joint_positions + np.linspace(0.0, 0.2, 16)[:, None]
    still = np.zeros_like(way)
    motion = JointMotion(np.linspace(0.0, 3.0, 16), way, still + start.joint_velocities, still)
    system = FreeFloatingSystem(robot, start, time=0.0)
    system.follow(motion)
    return robot, motion, start, body_near(robot, system.advance(1.0), rng)


def in_contact(case: tuple[Robot, JointMotion, SystemState, TargetBody]) -> FreeFloatingSystem:
    robot, motion, start, body = case
    system = FreeFloatingSystem(robot, start, time=0.0)
    system.follow(motion)
    system.advance(1.0)
    system.grasp(body)
    return system


def test_momentum_of_robot_and_body_stays_across_the_contact_and_after_it(
    case: tuple[Robot, JointMotion, SystemState, TargetBody],
) -> None:
    robot, _, start, body = case
    before = momentum_of_links(robot, start) + momentum_of_body(body)
    system = in_contact(case)
    for time in (1.0, 1.3, 2.0, 5.0):
        state, held = system.advance(time), system.body
        assert held is not None
        after = momentum_of_links(robot, state) + momentum_of_body(held)
        np.testing.assert_allclose(after, before, rtol=1e-8, atol=1e-7)


def test_the_body_is_held_as_it_was_at_contact(
    case: tuple[Robot, JointMotion, SystemState, TargetBody],
) -> None:
    robot, _, _, body = case
    system = in_contact(case)
    first = captured(robot, system.advance(1.0), body)
    assert 0.0 < first.position_error < 0.02
    for time in (1.0, 2.5, 5.0):
        state, held = system.advance(time), system.body
        assert held is not None
        apart, turned, *moves = astuple(captured(robot, state, held))
        assert (apart, turned) == pytest.approx(astuple(first)[:2], abs=1e-9)
        np.testing.assert_allclose(moves, 0.0, atol=1e-9)


def test_joints_go_on_as_the_impact_leaves_them_and_come_back_to_their_motion(
    case: tuple[Robot, JointMotion, SystemState, TargetBody],
) -> None:
    robot, motion, start, body = case
    system = FreeFloatingSystem(robot, start, time=0.0)
    system.follow(motion)
    before = system.advance(1.0)
    impulse = system.grasp(body)
    at_contact = system.advance(1.0)
    assert np.abs(at_contact.joint_velocities - before.joint_velocities).max() > 1e-3
    np.testing.assert_allclose(at_contact.joint_velocities, impulse.after.joint_velocities)
    np.testing.assert_allclose(at_contact.joint_positions, before.joint_positions, atol=1e-12)
    # One quartic brings them back, at the points of the motion and between them.
    off = impulse.after.joint_velocities - before.joint_velocities
    for time in (1.1, 1.2, 1.37, 1.49):
        (positions,), _, _ = motion.at(np.array([time]))
        s = (time - 1.0) / 0.5
        expected = positions + 0.5 * off * s * (1.0 - s) ** 3
        np.testing.assert_allclose(system.advance(time).joint_positions, expected, atol=1e-12)
    for time in (1.5, 2.2, 2.9):
        (positions,), (rates,), _ = motion.at(np.array([time]))
        state = system.advance(time)
        np.testing.assert_allclose(state.joint_positions, positions, atol=1e-12)
        np.testing.assert_allclose(state.joint_velocities, rates, atol=1e-12)


def test_one_who_holds_nothing_has_no_body(robot: Robot) -> None:
    start = random_state(robot, np.random.default_rng(1))
    assert FreeFloatingSystem(robot, start, time=0.0).body is None
