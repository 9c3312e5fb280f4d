"""The chaser between the points of a plan, against motions known in closed form."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from drawn_plans import drawn_plan
from robots import random_state
from scipy.spatial.transform import Rotation

from ff_planner_ros.baselines.beliefs import executed
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.times import nanoseconds
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.outputs.prediction import (
    Deviation,
    deviations,
    predicted_chaser_pose,
    predicted_pose,
    too_far,
)

START_NS = 1_700_000_000_123_456_789
START = np.array([1.0, -2.0, 0.5])
VELOCITY = np.array([0.02, -0.01, 0.05])
OMEGA = np.array([0.3, -0.5, 0.2])  # [rad/s] inertial axes
FIRST = Rotation.from_rotvec([0.4, 2.0, -1.0])
BETWEEN = np.linspace(0.0, 10.0, 173)


def spinning(robot: Robot) -> Trajectory:
    """A chaser that drifts and spins at constant rates, on points that are not evenly spaced."""
    time = 10.0 * np.linspace(0.0, 1.0, 12) ** 1.5
    drawn = drawn_plan(robot, seed=1).trajectory
    rows = {
        name: getattr(drawn, name)[: len(time)]
        for name in drawn.__dataclass_fields__
        if name.startswith(("joint", "ee"))
    }
    return Trajectory(
        time=time,
        chaser_positions=START + time[:, None] * VELOCITY,
        chaser_quaternions_xyzw=(Rotation.from_rotvec(time[:, None] * OMEGA) * FIRST).as_quat(),
        chaser_linear_velocities=np.tile(VELOCITY, (len(time), 1)),
        chaser_angular_velocities=np.tile(OMEGA, (len(time), 1)),
        **rows,
    )


def test_a_constant_spin_and_drift_is_met_exactly_everywhere(lemur: Robot) -> None:
    motion = spinning(lemur)
    for time in BETWEEN:
        pose = predicted_pose(motion, "chaser", time)
        assert pose is not None
        np.testing.assert_allclose(pose.position, START + time * VELOCITY, atol=1e-14)
        assert (
            pose.rotation.inv() * Rotation.from_rotvec(time * OMEGA) * FIRST
        ).magnitude() < 1e-14


def test_at_the_points_it_is_the_points_own_pose(lemur: Robot) -> None:
    motion = drawn_plan(lemur, seed=3).trajectory
    for time, position, quaternion in zip(
        motion.time, motion.chaser_positions, motion.chaser_quaternions_xyzw, strict=True
    ):
        pose = predicted_pose(motion, "chaser", time)
        assert pose is not None
        np.testing.assert_allclose(pose.position, position, atol=1e-15)
        assert (pose.rotation.inv() * Rotation.from_quat(quaternion)).magnitude() < 1e-14


def test_where_the_spin_changes_the_error_falls_with_the_fourth_power() -> None:
    # Coning: about z, then about the x axis that z has turned, at rates that grow.
    def rotation(t: Array) -> Rotation:
        return Rotation.from_euler("ZX", np.column_stack([0.3 * t, 0.1 * t**2]))

    def omega(t: Array) -> Array:
        x = Rotation.from_euler("Z", 0.3 * t[:, None]).apply([1.0, 0.0, 0.0])
        return np.array([0.0, 0.0, 0.3]) + 0.2 * t[:, None] * x

    def worst(points: int) -> tuple[float, float]:
        t = np.linspace(0.0, 4.0, points)
        drawn = {
            name: np.zeros((points, 7))
            for name in Trajectory.__dataclass_fields__
            if name.startswith(("joint", "ee"))
        }
        motion = Trajectory(
            time=t,
            chaser_positions=np.sin(np.outer(t, [0.5, 0.4, 0.3])),
            chaser_quaternions_xyzw=rotation(t).as_quat(),
            chaser_linear_velocities=np.cos(np.outer(t, [0.5, 0.4, 0.3])) * [0.5, 0.4, 0.3],
            chaser_angular_velocities=omega(t),
            **drawn,
        )
        between = np.linspace(0.0, 4.0, 301)
        poses = [predicted_pose(motion, "chaser", time) for time in between]
        assert None not in poses
        angles = [
            (pose.rotation.inv() * true).magnitude()
            for pose, true in zip(poses, rotation(between), strict=True)
        ]
        offsets = [p.position for p in poses] - np.sin(np.outer(between, [0.5, 0.4, 0.3]))
        return max(angles), float(np.abs(offsets).max())

    (angle, offset), (finer_angle, finer_offset) = worst(11), worst(21)
    assert angle / finer_angle == pytest.approx(16.0, rel=0.25)
    assert offset / finer_offset == pytest.approx(16.0, rel=0.25)


def test_a_planned_chaser_is_met_within_a_few_micrometres(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    """The truth is the same joint motion, executed on four times the points."""
    problem = replace(lemur_capture, points=4 * (lemur_capture.points - 1) + 1)
    fine = executed(problem, lemur_plan, load_parameters().planner).trajectory
    for time, position, quaternion in zip(
        fine.time, fine.chaser_positions, fine.chaser_quaternions_xyzw, strict=True
    ):
        pose = predicted_pose(lemur_plan.trajectory, "chaser", time)
        assert pose is not None
        assert np.linalg.norm(pose.position - position) < 5e-6
        assert (pose.rotation.inv() * Rotation.from_quat(quaternion)).magnitude() < 2e-5


@pytest.mark.parametrize("time", [-1e-9, 10.0 + 1e-9, float("inf"), float("nan")])
def test_there_is_no_pose_outside_the_plan(lemur: Robot, time: float) -> None:
    assert predicted_pose(spinning(lemur), "chaser", time) is None


def test_the_message_carries_the_pose_of_its_stamp_in_the_inertial_frame(lemur: Robot) -> None:
    now_ns = START_NS + 2_500_000_000
    message = predicted_chaser_pose(spinning(lemur), START_NS, now_ns, "world")
    assert message is not None
    assert nanoseconds(message.header.stamp) == now_ns
    assert message.header.frame_id == "world"
    position, q = message.pose.position, message.pose.orientation
    np.testing.assert_allclose([position.x, position.y, position.z], START + 2.5 * VELOCITY)
    turn = Rotation.from_quat([q.x, q.y, q.z, q.w])
    assert (turn.inv() * Rotation.from_rotvec(2.5 * OMEGA) * FIRST).magnitude() < 1e-14


def test_there_is_no_message_while_no_plan_runs(lemur: Robot) -> None:
    motion = spinning(lemur)
    for time_ns in (START_NS - 1, START_NS + 10_000_000_001):
        assert predicted_chaser_pose(motion, START_NS, time_ns, "world") is None


def test_tracking_error_is_the_distance_and_the_turn_from_the_prediction(lemur: Robot) -> None:
    off, turn = np.array([0.03, -0.04, 0.12]), Rotation.from_rotvec([0.0, 0.06, -0.08])
    time = 3.7
    state = replace(
        random_state(lemur, np.random.default_rng(5)),
        position_chaser_in_inertial=START + time * VELOCITY + off,
        quaternion_chaser_to_inertial_xyzw=(
            turn * Rotation.from_rotvec(time * OMEGA) * FIRST
        ).as_quat(),
    )
    position, angle, *_ = deviations(state, spinning(lemur), time, lemur)
    assert position.amount == pytest.approx(0.13, abs=1e-9)
    assert angle.amount == pytest.approx(0.1, abs=1e-9)
    for outside in (-1e-9, 10.0 + 1e-9):
        assert deviations(state, spinning(lemur), outside, lemur) == []


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("axis", range(3))
def test_a_tracking_error_is_the_same_to_every_side(lemur: Robot, axis: int, sign: float) -> None:
    off = sign * np.eye(3)[axis]
    for time in (0.0, 10.0):  # at the first and at the last moment of the plan, too
        attitude = Rotation.from_rotvec(time * OMEGA) * FIRST
        state = replace(
            random_state(lemur, np.random.default_rng(5)),
            position_chaser_in_inertial=START + time * VELOCITY + 0.02 * off,
            quaternion_chaser_to_inertial_xyzw=(
                Rotation.from_rotvec(0.3 * off) * attitude
            ).as_quat(),
        )
        position, angle, *_ = deviations(state, spinning(lemur), time, lemur)
        assert position.amount == pytest.approx(0.02, abs=1e-9)
        assert angle.amount == pytest.approx(0.3, abs=1e-9)


def test_every_velocity_and_joint_is_held_against_the_plan_at_any_time(
    lemur: Robot, lemur_plan: Plan
) -> None:
    """At the points, from the plan's own numbers; a joint that slides counts by its weight."""
    motion, rng = lemur_plan.trajectory, np.random.default_rng(7)
    weights = rng.uniform(0.5, 3.0, lemur.joints)
    robot = replace(lemur, joint_weights=weights)
    for point in (0, 17, len(motion.time) - 1):
        moved = rng.normal(size=(2, 3)), rng.normal(size=(2, lemur.joints)) / 10.0
        state = SystemState(
            motion.chaser_positions[point],
            motion.chaser_quaternions_xyzw[point],
            motion.chaser_linear_velocities[point] + moved[0][0],
            motion.chaser_angular_velocities[point] + moved[0][1],
            motion.joint_positions[point] + moved[1][0],
            motion.joint_velocities[point] + moved[1][1],
        )
        found = deviations(state, motion, float(motion.time[point]), robot)
        amounts = [one.amount for one in found]
        wanted = [
            *(0.0, 0.0, *np.linalg.norm(moved[0], axis=1)),
            *np.abs(weights * moved[1]).ravel(),
        ]
        np.testing.assert_allclose(amounts, wanted, rtol=0.0, atol=1e-8)


def test_what_is_within_its_tolerance_is_not_told_and_no_number_is() -> None:
    allowed = load_parameters().tracking
    for tolerance in vars(allowed):
        limit = getattr(allowed, tolerance)
        found = [Deviation("this", tolerance, share * limit, "m") for share in (0.5, 1.0)]
        assert too_far(found, allowed, at_rates=True) == ""
        for amount in (1.1 * limit, math.nan):
            told = too_far(
                [*found, Deviation("that", tolerance, amount, "m")], allowed, at_rates=True
            )
            assert told.startswith(f"that by {amount:.3g} m, more than tracking.{tolerance}, ")
