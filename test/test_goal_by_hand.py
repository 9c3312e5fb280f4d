"""A goal that is missed by what is told, or by what comes of it, is refused by name."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from handmade_plans import DENSE, GOAL, POINTS, Made, made, resting
from robots import ROBOTS
from scipy.spatial.transform import Rotation
from test_check_by_hand import on_a_table, spoilt, without_momentum
from test_limits_by_hand import PLACE, POSTURE, TWIST, the_one

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import Status
from ff_planner_ros.planning.problem.problem import Orientation, Target
from ff_planner_ros.planning.requirements.goal import beside, miss
from ff_planner_ros.robot.model import robot_from_urdf_text

AXES = (*np.eye(3), *-np.eye(3))


@pytest.mark.law("PLAN-02")
@pytest.mark.parametrize("axis", range(6))
def test_a_goal_is_where_the_motion_comes_and_where_it_is_told_to_come(axis: int) -> None:
    """A system without momentum may be told to be elsewhere, and breaks nothing else."""
    found, aside = without_momentum(), AXES[axis] + 0.7 * np.roll(AXES[axis], 1)
    aside = aside / np.linalg.norm(aside)
    motion, target = found.plan.trajectory, found.problem.target
    for size, refused in ((1.01e-3, True), (0.99e-3, False)):
        told = spoilt(motion.chaser_positions, GOAL, size * aside)
        for at in (target.position, target.position + size * aside):  # what comes, what is told
            asked = replace(found.problem, target=replace(target, position=at))
            answer = replace(found, problem=asked, plan=found.spoilt(chaser_positions=told))
            assert answer.measured().final_position_error == pytest.approx(size, abs=1e-6)
            failures = answer.judged()
            assert bool(failures) is refused
            if refused:
                words = "final_position_error is 0.00101 m, allowed is 0.001 m"
                the_one(failures, Status.CHECK_FAILED, words)


@pytest.mark.parametrize("axis", range(6))
def test_the_turn_at_the_goal_is_that_which_comes_and_which_is_told(axis: int) -> None:
    """The chaser is told to be turned about the end effector, which stays where it is."""
    found = without_momentum()
    motion, target = found.plan.trajectory, found.problem.target
    for angle, refused in ((1.01e-3, True), (0.99e-3, False)):
        turn = Rotation.from_rotvec(angle * AXES[axis])
        tip, quaternions = motion.ee_positions[GOAL], motion.chaser_quaternions_xyzw.copy()
        quaternions[GOAL] = (turn * Rotation.from_quat(quaternions[GOAL])).as_quat()
        places = motion.chaser_positions.copy()
        places[GOAL] = tip + turn.apply(places[GOAL] - tip)
        told = found.spoilt(chaser_quaternions_xyzw=quaternions, chaser_positions=places)
        there = (turn * Rotation.from_quat(target.quaternion_xyzw.copy())).as_quat()
        for wanted in (target.quaternion_xyzw, there):
            asked = replace(found.problem, target=replace(target, quaternion_xyzw=wanted))
            answer = replace(found, problem=asked, plan=told)
            assert answer.measured().final_orientation_error == pytest.approx(angle, abs=1e-6)
            failures = answer.judged()
            assert bool(failures) is refused
            if refused:
                words = "final_orientation_error is 0.00101 rad, allowed is 0.001 rad"
                the_one(failures, Status.CHECK_FAILED, words)
            free = replace(asked.target, orientation=Orientation.FREE)
            assert not answer.judged(target=free)


@cache
def passing_by() -> Made:
    """The arm moves at the goal, before and after it."""
    joints = resting(POSTURE).stepping(0, GOAL - 1, 0.3).stepping(0, GOAL, 0.3)
    return made(robot_from_urdf_text(*ROBOTS["six joints"]), joints, TWIST, PLACE)


def test_the_goal_is_that_at_the_duration_and_not_the_end_of_the_tail() -> None:
    found = passing_by()
    assert not found.judged()
    for point in (GOAL - 1, GOAL + 1, POINTS - 1):
        tip = found.plan.trajectory.ee_positions[point]
        asked = replace(found.problem.target, position=tip)
        failures = found.judged(target=asked)
        the_one(failures, Status.CHECK_FAILED, "final_position_error is")


def frame(q: Array) -> pin.SE3:
    model = passing_by().problem.robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    return pin.updateFramePlacement(model, data, passing_by().problem.robot.tip_frame_id).copy()


@pytest.mark.parametrize("seed", range(4))
def test_the_miss_of_a_goal_is_the_way_and_the_turn_that_are_left(seed: int) -> None:
    """In inertial axes: what carries the end effector to the goal."""
    rng, q = np.random.default_rng(seed), passing_by().q[7 * DENSE]
    here, way = frame(q), rng.normal(size=3)
    turn = rng.normal(size=3)
    turn *= rng.uniform(0.1, 3.0) / np.linalg.norm(turn)
    there = Rotation.from_rotvec(turn) * Rotation.from_matrix(here.rotation)
    target = Target(here.translation + way, there.as_quat())
    found = miss(passing_by().problem.robot, q, target)
    np.testing.assert_allclose(found, [way, turn], rtol=0.0, atol=1e-9)
    # A target beside the end effector is missed by what it is beside.
    at_tip = Target(here.translation.copy(), Rotation.from_matrix(here.rotation).as_quat())
    found = miss(passing_by().problem.robot, q, beside(at_tip, way, turn))
    np.testing.assert_allclose(found, [way, turn], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    "angle", [0.0, 1e-9, 1e-3, 1.0, 2.5, np.pi - 1e-6, np.pi - 1e-7, np.pi - 1e-9, np.pi]
)
@pytest.mark.parametrize("about", [0.0, 2.0, -1.2])
def test_about_a_free_axis_the_axis_alone_counts(angle: float, about: float) -> None:
    """The end effector may turn about it; the least turn brings the axis there."""
    rng, q = np.random.default_rng(3), passing_by().q[0]
    here, axis = Rotation.from_matrix(frame(q).rotation), np.array([0.6, 0.0, -0.8])
    across = np.cross(here.apply(axis), rng.normal(size=3))
    across /= np.linalg.norm(across)
    there = Rotation.from_rotvec(angle * across) * here * Rotation.from_rotvec(about * axis)
    target = Target(
        frame(q).translation.copy(),
        there.as_quat(),
        orientation=Orientation.ABOUT_AXIS,
        free_axis_in_ee=axis,
    )
    _, turn = miss(passing_by().problem.robot, q, target)
    assert np.linalg.norm(turn) == pytest.approx(angle, abs=1e-7)
    brought = Rotation.from_rotvec(turn).apply(here.apply(axis))
    np.testing.assert_allclose(brought, there.apply(axis), rtol=0.0, atol=1e-7)
    if angle < 3.0:  # about which axis an opposite one is turned does not matter
        np.testing.assert_allclose(turn, angle * across, rtol=0.0, atol=1e-7)


def test_on_a_table_the_height_of_the_goal_does_not_count() -> None:
    found = on_a_table()
    robot, target, q = found.problem.robot, found.problem.target, found.q[GOAL * DENSE]
    higher = replace(target, position=target.position + np.array([0.0, 0.0, 0.3]))
    tilt = Rotation.from_rotvec([0.2, 0.0, 0.0]) * Rotation.from_quat(target.quaternion_xyzw)
    for asked in (higher, replace(target, quaternion_xyzw=tilt.as_quat())):
        assert np.abs(miss(robot, q, asked)).max() < 1e-9
    aside = replace(target, position=target.position + np.array([0.0, -0.01, 0.0]))
    assert miss(robot, q, aside)[0, 1] == pytest.approx(-0.01, abs=1e-9)
    turned = Rotation.from_rotvec([0.0, 0.0, -0.02]) * Rotation.from_quat(target.quaternion_xyzw)
    asked = replace(target, quaternion_xyzw=turned.as_quat())
    assert miss(robot, q, asked)[1, 2] == pytest.approx(-0.02, abs=1e-9)
