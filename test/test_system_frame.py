"""The frame that a plan is made in: everything in it is where the user has it, seen from there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from drawn_plans import drawn_plan
from robots import random_state
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.system_frame import SystemFrame, in_own_frame, system_frame
from ff_planner_ros.planning.problem.problem import DurationRange, Obstacle, PlanningProblem, Target
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState

SEEDS = pytest.mark.parametrize("seed", range(4))


def start_of(robot: Robot, seed: int) -> SystemState:
    """Far from the origin, turned to any side, moving and turning."""
    state = random_state(robot, np.random.default_rng(seed))
    return replace(
        state,
        position_chaser_in_inertial=np.array([5.0, -30.0, 12.0]) * (-1.0) ** seed,
        linear_velocity_chaser_in_inertial=np.array([-0.7, 0.4, 0.2]) * (-1.0) ** seed,
    )


def center_of_mass(robot: Robot, state: SystemState) -> tuple[Array, Array]:
    """Its place and velocity in the user's frame, body by body."""
    model, data = robot.model, robot.model.createData()
    pin.forwardKinematics(model, data, *configuration(robot, state))
    mass, place, velocity = 0.0, np.zeros(3), np.zeros(3)
    for number, inertia in enumerate(model.inertias):
        pose, twist = data.oMi[number], data.v[number]
        mass += inertia.mass
        place = place + inertia.mass * pose.act(inertia.lever)
        of_lever = twist.linear + np.cross(twist.angular, inertia.lever)
        velocity = velocity + inertia.mass * (pose.rotation @ of_lever)
    return place / mass, velocity / mass


def frame_of(robot: Robot, seed: int) -> tuple[SystemFrame, Array, Array, Array]:
    """The frame, and its origin, velocity and axes as they should be."""
    state = start_of(robot, seed)
    attitude = Rotation.from_quat(state.quaternion_chaser_to_inertial_xyzw).as_matrix()
    return system_frame(robot, state), *center_of_mass(robot, state), attitude


@SEEDS
def test_the_frame_moves_with_the_systems_centre_of_mass_and_has_the_chasers_axes(
    lemur: Robot, seed: int
) -> None:
    frame, origin, velocity, axes = frame_of(lemur, seed)
    np.testing.assert_allclose(frame.origin, origin, atol=1e-12)
    np.testing.assert_allclose(frame.velocity, velocity, atol=1e-12)
    np.testing.assert_allclose(frame.rotation, axes, atol=1e-14)
    place, drift = center_of_mass(lemur, frame.start)
    np.testing.assert_allclose(place, np.zeros(3), atol=1e-12)
    np.testing.assert_allclose(drift, np.zeros(3), atol=1e-12)


@SEEDS
def test_the_user_sees_the_start_as_it_was_measured(lemur: Robot, seed: int) -> None:
    frame, measured = frame_of(lemur, seed)[0], start_of(lemur, seed)
    seen = frame.state_seen_by_user(frame.start, 0.0)
    for name in (
        "position_chaser_in_inertial",
        "linear_velocity_chaser_in_inertial",
        "angular_velocity_chaser_in_inertial",
        "joint_positions",
        "joint_velocities",
    ):
        np.testing.assert_allclose(getattr(seen, name), getattr(measured, name), atol=1e-9)
    turn = Rotation.from_quat(seen.quaternion_chaser_to_inertial_xyzw).inv()
    turn = turn * Rotation.from_quat(measured.quaternion_chaser_to_inertial_xyzw)
    assert turn.magnitude() < 1e-9
    later = frame.state_seen_by_user(frame.start, 10.0)
    gone = later.position_chaser_in_inertial - seen.position_chaser_in_inertial
    np.testing.assert_allclose(gone, 10.0 * frame.velocity, atol=1e-9)


@SEEDS
def test_target_and_obstacles_are_where_the_user_has_them(
    lemur_capture: PlanningProblem, seed: int
) -> None:
    """A target at the goal, an obstacle at the first point; with all that moves and turns."""
    robot, rng = lemur_capture.robot, np.random.default_rng(seed)
    frame, origin, velocity, axes = frame_of(robot, seed)
    vectors = {
        name: rng.normal(size=3)
        for name in (
            *("position", "linear_velocity", "angular_velocity"),
            *("linear_acceleration", "angular_acceleration"),
        )
    }
    attitude = Rotation.random(random_state=seed)
    sphere = Obstacle.sphere("ball", rng.normal(size=3) * 50.0, 0.1, rng.normal(size=3))
    problem = replace(
        lemur_capture,
        start=start_of(robot, seed),
        target=Target(quaternion_xyzw=attitude.as_quat(), **vectors),
        obstacles=(sphere,),
        duration_range=DurationRange(5.0, lemur_capture.duration, rng.normal(size=3)),
    )
    seen = frame.problem(problem)
    end, target = problem.duration, seen.target
    place = axes @ target.position + origin + end * velocity
    np.testing.assert_allclose(place, vectors["position"], atol=2e-6)
    np.testing.assert_allclose(
        axes @ target.linear_velocity + velocity, vectors["linear_velocity"], atol=1e-8
    )
    for name in ("angular_velocity", "linear_acceleration", "angular_acceleration"):
        np.testing.assert_allclose(axes @ getattr(target, name), vectors[name], atol=1e-11)
    there = Rotation.from_matrix(axes) * Rotation.from_quat(target.quaternion_xyzw)
    assert (there.inv() * attitude).magnitude() < 1e-10
    (ball,) = seen.obstacles
    np.testing.assert_allclose(axes @ ball.center + origin, sphere.center, atol=2e-6)
    np.testing.assert_allclose(
        axes @ ball.motion.velocity + velocity, sphere.motion.velocity, atol=1e-8
    )
    assert seen.duration_range is not None
    assert problem.duration_range is not None
    moving = axes @ seen.duration_range.target_velocity + velocity
    np.testing.assert_allclose(moving, problem.duration_range.target_velocity, atol=1e-8)
    np.testing.assert_allclose(in_own_frame(problem).target.position, target.position, atol=1e-12)


@SEEDS
def test_a_target_body_turns_as_the_user_has_it(seed: int) -> None:
    problem = tumbling.problem("tumbling", 0)
    frame, origin, velocity, axes = frame_of(problem.robot, seed)
    body = problem.target_body
    assert body is not None
    body = replace(body, linear_velocity=np.array([0.1, -0.3, 0.2]))
    asked = replace(problem, start=start_of(problem.robot, seed), target_body=body)
    seen = frame.problem(asked).target_body
    assert seen is not None
    for time in (0.0, 3.0, 8.0):
        there, here = body.after(time), seen.after(time)
        place = axes @ here.position + origin + time * velocity
        np.testing.assert_allclose(place, there.position, atol=2e-6)
        np.testing.assert_allclose(axes @ here.angular_velocity, there.angular_velocity, atol=1e-9)
        turn = Rotation.from_matrix(axes) * Rotation.from_quat(here.quaternion_xyzw)
        assert (turn.inv() * Rotation.from_quat(there.quaternion_xyzw)).magnitude() < 1e-9


@SEEDS
def test_a_plan_goes_there_and_back_and_is_where_the_frame_has_it(lemur: Robot, seed: int) -> None:
    frame, origin, velocity, axes = frame_of(lemur, seed)
    plan = drawn_plan(lemur, seed)
    motion, seen = plan.trajectory, frame.plan_seen_by_user(plan)
    back = frame.plan(seen).trajectory
    for part in ("chaser", "ee"):
        x, q, v, omega = (
            getattr(motion, f"{part}_{name}")
            for name in (
                *("positions", "quaternions_xyzw"),
                *("linear_velocities", "angular_velocities"),
            )
        )
        there = seen.trajectory
        place = origin + np.outer(motion.time, velocity) + x @ axes.T
        np.testing.assert_allclose(getattr(there, f"{part}_positions"), place, atol=1e-9)
        np.testing.assert_allclose(
            getattr(there, f"{part}_linear_velocities"), v @ axes.T + velocity, atol=1e-9
        )
        np.testing.assert_allclose(
            getattr(there, f"{part}_angular_velocities"), omega @ axes.T, atol=1e-9
        )
        turn = Rotation.from_matrix(axes) * Rotation.from_quat(q)
        told = Rotation.from_quat(getattr(there, f"{part}_quaternions_xyzw"))
        assert (turn.inv() * told).magnitude().max() < 1e-9
        for name, rows in (
            ("positions", x),
            ("linear_velocities", v),
            ("angular_velocities", omega),
        ):
            np.testing.assert_allclose(getattr(back, f"{part}_{name}"), rows, atol=1e-9)
    np.testing.assert_array_equal(back.joint_positions, motion.joint_positions)
