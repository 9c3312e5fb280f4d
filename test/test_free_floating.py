"""The system without errors: momentum stays, joints obey, and plans come true in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from robots import random_state

from ff_planner_ros.baselines.beliefs import executed
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.joint_motion import JointMotion, joint_motion
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import total_momentum
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.simulation.free_floating import FreeFloatingSystem, carried_back


def momentum(robot: Robot, state: SystemState) -> Array:
    return total_momentum(robot, robot.model.createData(), *configuration(robot, state))


def pose(state: SystemState) -> Array:
    """Position, and attitude with the sign that makes it comparable."""
    q = state.quaternion_chaser_to_inertial_xyzw
    return np.concatenate([state.position_chaser_in_inertial, q * np.sign(q[3])])


def swing(robot: Robot, begin: float, state: SystemState) -> JointMotion:
    """From where a state's joints are at its rates to somewhere else, in three seconds."""
    rates = state.joint_velocities
    positions = state.joint_positions + np.linspace(0.0, 0.4, 4)[:, None]
    return JointMotion(
        begin + np.arange(4.0), positions, np.tile(rates, (4, 1)), np.zeros((4, robot.joints))
    )


def test_whatever_the_joints_do_momentum_stays(robot: Robot) -> None:
    start = random_state(robot, np.random.default_rng(2))
    system = FreeFloatingSystem(robot, start, time=5.0)
    system.follow(swing(robot, 5.31, start))
    before = momentum(robot, start)
    for time in (5.2, 5.31, 5.9, 8.5, 9.0):
        now = momentum(robot, system.advance(time))
        np.testing.assert_allclose(now, before, rtol=1e-9, atol=1e-9)


def test_a_plan_comes_true(lemur_capture: PlanningProblem, lemur_plan: Plan) -> None:
    system = FreeFloatingSystem(lemur_capture.robot, lemur_capture.start, time=0.0)
    system.follow(joint_motion(lemur_plan.trajectory))
    truth = executed(lemur_capture, lemur_plan, load_parameters().planner).trajectory
    for time, position, joints in zip(
        truth.time, truth.chaser_positions, truth.joint_positions, strict=True
    ):
        state = system.advance(float(time))
        np.testing.assert_allclose(state.position_chaser_in_inertial, position, atol=1e-7)
        np.testing.assert_allclose(state.joint_positions, joints, atol=1e-12)


def test_how_often_one_looks_changes_nothing(lemur_capture: PlanningProblem) -> None:
    robot, start = lemur_capture.robot, lemur_capture.start
    ends = []
    for looks in (1, 7, 400):
        system = FreeFloatingSystem(robot, start, time=-1.0)
        system.follow(swing(robot, 0.5, start))
        ends.append(pose([system.advance(t) for t in np.linspace(-1.0, 5.0, looks + 1)][-1]))
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-8)
    np.testing.assert_allclose(ends[2], ends[0], atol=1e-8)


def test_joints_keep_their_rates_then_follow_then_are_held(lemur_capture: PlanningProblem) -> None:
    robot, start = lemur_capture.robot, lemur_capture.start
    system = FreeFloatingSystem(robot, start, time=0.0)
    motion = swing(robot, 2.0, replace(start, joint_positions=start.joint_positions + 0.5))
    system.follow(motion)
    coasting = system.advance(1.9)
    expected = start.joint_positions + 1.9 * start.joint_velocities
    np.testing.assert_allclose(coasting.joint_positions, expected, atol=1e-12)
    np.testing.assert_allclose(coasting.joint_velocities, start.joint_velocities, atol=1e-12)
    following = system.advance(3.0)
    np.testing.assert_allclose(following.joint_positions, motion.positions[1], atol=1e-12)
    for time in (5.0 + 1e-9, 5.5, 90.0):
        held = system.advance(time)
        np.testing.assert_allclose(held.joint_positions, motion.positions[-1], atol=1e-9)
        np.testing.assert_allclose(held.joint_velocities, 0.0, atol=1e-9)


def test_a_motion_replaces_those_that_begin_later_and_not_the_one_that_runs(
    lemur_capture: PlanningProblem,
) -> None:
    robot, start = lemur_capture.robot, lemur_capture.start
    shifted = [replace(start, joint_positions=start.joint_positions + off) for off in (0, 1, 2)]
    running, dropped, next_one = (
        swing(robot, begin, state) for begin, state in zip((0.0, 2.5, 2.0), shifted, strict=True)
    )
    system = FreeFloatingSystem(robot, start, time=0.0)
    for motion in (running, dropped, next_one):
        system.follow(motion)
    at = [system.advance(time).joint_positions for time in (1.0, 3.0, 9.0)]
    np.testing.assert_allclose(at[0], running.positions[1], atol=1e-12)
    np.testing.assert_allclose(at[1], next_one.positions[1], atol=1e-12)
    np.testing.assert_allclose(at[2], next_one.positions[-1], atol=1e-12)


def test_time_does_not_run_backwards(lemur_capture: PlanningProblem) -> None:
    system = FreeFloatingSystem(lemur_capture.robot, lemur_capture.start, time=3.0)
    there = pose(system.advance(4.0))
    assert np.array_equal(pose(system.advance(3.5)), there)
    assert system.time == 4.0


def test_what_is_carried_back_comes_through_again(robot: Robot) -> None:
    state = random_state(robot, np.random.default_rng(11))
    system = FreeFloatingSystem(robot, carried_back(robot, state, 2.0), time=-2.0)
    again = system.advance(0.0)
    np.testing.assert_allclose(pose(again), pose(state), atol=1e-7)
    np.testing.assert_allclose(again.joint_positions, state.joint_positions, atol=1e-12)
    np.testing.assert_allclose(again.joint_velocities, state.joint_velocities, atol=1e-12)
    for name in ("linear_velocity_chaser_in_inertial", "angular_velocity_chaser_in_inertial"):
        np.testing.assert_allclose(getattr(again, name), getattr(state, name), atol=1e-7)


def test_nothing_pushes_it_so_its_centre_of_mass_goes_straight(robot: Robot) -> None:
    start = random_state(robot, np.random.default_rng(3))
    system = FreeFloatingSystem(robot, start, time=0.0)
    system.follow(swing(robot, 0.0, start))
    mass = sum(inertia.mass for inertia in robot.model.inertias)
    velocity = momentum(robot, start)[:3] / mass

    def centre_of_mass(state: SystemState) -> Array:
        data = robot.model.createData()
        return np.array(pin.centerOfMass(robot.model, data, configuration(robot, state)[0]))

    origin = centre_of_mass(start)
    for time in (0.1, 1.7, 4.0):
        found = centre_of_mass(system.advance(time))
        assert found == pytest.approx(origin + time * velocity, abs=1e-6)
