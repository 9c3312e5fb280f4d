"""What the independent engine says of a plan, in the frame of the plan, and what is failed."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from handmade_plans import DENSE, GOAL, POINTS, Made, made, resting
from robots import ROBOTS
from scipy.spatial.transform import Rotation
from test_limits_by_hand import PLACE, POSTURE, TWIST

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.model import robot_from_urdf_text
from ff_planner_ros.simulation import verification
from ff_planner_ros.simulation.capture import Capture, Corridor
from ff_planner_ros.simulation.contacts import Contact
from ff_planner_ros.simulation.deviation import POSITION_TOLERANCE, Deviation, deviation
from ff_planner_ros.simulation.engine import Engine
from ff_planner_ros.simulation.verification import (
    MOMENTUM_TOLERANCE,
    MOST_STEPS,
    Verification,
    steps_per_point,
    verify,
)

NOTHING = Deviation(0.0, 0.0, 0.0, 0.0)
SOFT = Capture(0.0, 0.0, 0.0, 0.0)


@cache
def tumbling() -> tuple[Made, Verification]:
    """Far from the origin, fast and turned; its arm swings both ways."""
    joints = resting(POSTURE).swelling(1, 3, -0.02).swelling(0, 5, 0.02).stepping(3, 6, -0.05)
    twist = TWIST + np.array([3.0, -2.0, 1.0, 0.0, 0.0, 0.0])
    robot = robot_from_urdf_text(*ROBOTS["six joints"])
    found = made(robot, joints, twist, 20.0 * PLACE, Rotation.from_rotvec([0.7, -1.1, 1.9]))
    return found, verify(robot, found.plan.trajectory)


def test_a_motion_made_by_hand_comes_true() -> None:
    _, found = tumbling()
    assert found.passed, (found.deviation, found.momentum_drift)
    assert found.capture is found.corridor is None
    assert found.contacts == ()


def test_what_the_system_did_is_told_in_the_frame_of_the_plan() -> None:
    made_by_hand, found = tumbling()
    motion, did = made_by_hand.plan.trajectory, found.execution
    linear, angular = np.split(did.ee_twists, 2, axis=1)
    for told, wanted in (
        (did.time, motion.time),
        (did.joint_positions, motion.joint_positions),
        (did.joint_velocities, motion.joint_velocities),
        (did.chaser_positions, motion.chaser_positions),
        (did.ee_positions, motion.ee_positions),
        (linear, motion.ee_linear_velocities),
        (angular, motion.ee_angular_velocities),
    ):
        np.testing.assert_allclose(told, wanted, rtol=0.0, atol=2e-5)
    model, data = made_by_hand.problem.robot.model, made_by_hand.problem.robot.model.createData()
    for q, v, momentum in zip(made_by_hand.q[::DENSE], made_by_hand.v, did.momentum, strict=True):
        pin.computeCentroidalMomentum(model, data, q, v)
        about_origin = data.hg.angular + np.cross(data.com[0], data.hg.linear)
        np.testing.assert_allclose(momentum, np.append(data.hg.linear, about_origin), rtol=1e-6)


@pytest.mark.parametrize("point", [0, 5, POINTS - 1])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_chaser_counts_at_every_point_and_the_end_effector_at_the_last(
    point: int, sign: float
) -> None:
    made_by_hand, found = tumbling()
    motion, did = made_by_hand.plan.trajectory, found.execution
    here = deviation(did, motion)
    moved = np.zeros((POINTS, 3))
    moved[point] = sign * np.array([0.0, 0.0, 0.4])
    off = deviation(replace(did, chaser_positions=did.chaser_positions + moved), motion)
    assert off.max_chaser_position_error == pytest.approx(0.4, abs=1e-4)
    assert off.final_position_error == here.final_position_error
    off = deviation(replace(did, ee_positions=did.ee_positions + moved), motion)
    wanted = 0.4 if point == POINTS - 1 else 0.0
    assert off.final_position_error == pytest.approx(wanted, abs=1e-4)
    for angle in (0.3, 2.0, 3.1):
        turn = Rotation.from_rotvec(sign * angle * np.array([0.6, 0.0, -0.8]))
        for name, key in (
            ("chaser_quaternions_xyzw", "max_chaser_orientation_error"),
            ("ee_quaternions_xyzw", "final_orientation_error"),
        ):
            values = getattr(did, name).copy()
            values[point] = (turn * Rotation.from_quat(values[point])).as_quat()
            off = deviation(replace(did, **{name: values}), motion)
            counts = name.startswith("chaser") or point == POINTS - 1
            assert getattr(off, key) == pytest.approx(angle if counts else 0.0, abs=1e-4)


def test_deviations_of_parts_are_added_times_their_number() -> None:
    made_by_hand, found = tumbling()
    motion, did = made_by_hand.plan.trajectory, found.execution
    moved = np.zeros((POINTS, 3))
    moved[[0, 1, POINTS - 1], 2] = 0.3, 0.2, 0.1  # one part ends at the second point
    places = {"chaser_positions": did.chaser_positions + moved}
    places["ee_positions"] = did.ee_positions + moved
    off = deviation(replace(did, **places), motion, [1, POINTS - 1])
    assert off.final_position_error == pytest.approx(2.0 * (0.2 + 0.1), abs=1e-4)
    assert off.max_chaser_position_error == pytest.approx(2.0 * (0.3 + 0.1), abs=1e-4)


def verdict(**changes: object) -> Verification:
    _, found = tumbling()
    kept = Verification(found.execution, NOTHING, 0.0, capture=SOFT)
    return replace(kept, **changes)  # type: ignore[arg-type]


def test_contacts_corridor_and_capture_are_judged() -> None:
    assert verdict().passed
    contact = Contact("hand/bolt", 1.0, 2.0, 1e-9)
    assert not verdict(contacts=(contact,)).passed
    assert verdict(contacts=(contact,)).came_true
    for margin, kept in ((-0.99, True), (-1.01, False), (5.0, True), (np.nan, False)):
        found = verdict(corridor=Corridor(margin * POSITION_TOLERANCE, 1.0, 1.0))
        assert found.kept_corridor is kept
        assert found.passed is kept
        assert found.came_true
    for name in vars(SOFT):
        assert not verdict(capture=replace(SOFT, **{name: 2e-3})).came_true
        assert verdict(capture=replace(SOFT, **{name: 8e-4})).came_true
    assert verdict(capture=None).passed


@cache
def without_swings(turns: bool) -> tuple[Made, Engine]:
    robot = robot_from_urdf_text(*ROBOTS["six joints"])
    twist = np.array([0.0, 0.0, 0.0, 0.3, -0.2, 0.25]) * turns
    return made(robot, resting(POSTURE), twist, PLACE), Engine(robot)


def drift_of(changes: Array, turns: bool) -> float:
    """What is told of an execution whose momentum is spoilt."""
    found, engine = without_swings(turns)
    momentum = np.tile(total(found), (POINTS, 1)) + changes
    did = replace(tumbling()[1].execution, momentum=momentum)
    planned = verification.beside_center_of_mass(engine, found.plan.trajectory)
    return verification._momentum_drift(found.problem.robot, engine, planned, did)


def total(found: Made) -> Array:
    """In the frame of the centre of mass: what the whole turns by."""
    model, data = found.problem.robot.model, found.problem.robot.model.createData()
    pin.computeCentroidalMomentum(model, data, found.q[0], found.v[0])
    return np.append(np.zeros(3), data.hg.angular)


@pytest.mark.parametrize("point", [1, 6, POINTS - 1])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_change_of_momentum_is_told_in_parts_of_what_there_is(point: int, sign: float) -> None:
    found, engine = without_swings(True)
    whole = float(np.linalg.norm(total(found)))
    changes = np.zeros((POINTS, 6))
    changes[point, 1], changes[point, 5] = sign * 3e-6 * whole, sign * 4e-6 * whole
    planned = verification.beside_center_of_mass(engine, found.plan.trajectory)
    speed = np.linalg.norm(planned.chaser_linear_velocities, axis=1).max()
    scale = max(whole, found.problem.robot.model.inertias[1].mass * speed)
    assert drift_of(changes, True) == pytest.approx(5e-6 * whole / scale, rel=1e-6)


def test_of_a_system_at_rest_a_change_of_momentum_is_told_in_parts_of_almost_none() -> None:
    robot = robot_from_urdf_text(*ROBOTS["six joints"])
    mass = pin.computeTotalMass(robot.model)
    changes = np.zeros((POINTS, 6))
    changes[GOAL, 2] = -1e-6 * 1e-6 * mass
    assert drift_of(changes, False) == pytest.approx(1e-6, rel=1e-3)
    assert MOMENTUM_TOLERANCE == 1e-6


def test_more_steps_than_ten_thousand_points_need_are_refused() -> None:
    motion = tumbling()[0].plan.trajectory
    still = replace(
        motion,
        joint_velocities=np.zeros((POINTS, 6)),
        chaser_angular_velocities=np.zeros((POINTS, 3)),
    )
    fastest = MOST_STEPS / (POINTS - 1) * 0.01 / 0.5  # [rad/s]
    for sign in (1.0, -1.0):
        rates = np.zeros((POINTS, 6))
        rates[-1, 2] = 0.999 * sign * fastest
        assert steps_per_point(replace(still, joint_velocities=rates)) <= MOST_STEPS / (POINTS - 1)
        rates[-1, 2] = 1.001 * sign * fastest
        with pytest.raises(InvalidInput) as refused:
            steps_per_point(replace(still, joint_velocities=rates))
        assert refused.value.status is Status.OUT_OF_RANGE
    # The longest time between two points counts, wherever it is.
    late = motion.time.copy()
    late[-1] += 0.5
    turning = replace(still, time=late, joint_velocities=np.full((POINTS, 6), -0.4))
    assert steps_per_point(turning) == 40
