"""What a bag measured while plans ran, and how far that is from them, against looking at all."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn_plans import drawn_plan
from ff_planner_msgs.msg import ChaserState
from nav_msgs.msg import Odometry
from robots import random_state
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState

from ff_planner_ros.analysis.drawing.tracking import deviations
from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.reader import open_bag
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.parameters import NodeParameters, load_parameters
from ff_planner_ros.parameters.interfaces import OdometryParameters
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.messages.interfaces import type_name
from ff_planner_ros.ros.messages.to_messages import state_message, time_message
from ff_planner_ros.runs.measured import Window, fill_windows

FRAME, SENSOR, TOLERANCE = "inertial", "imu", 0.02
BEGIN = 1_000 * NANOSECONDS
SENSOR_AT = OdometryParameters(SENSOR, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
PARAMETERS: NodeParameters = replace(
    load_parameters(),
    inertial_frame=FRAME,
    odometry=SENSOR_AT,
    state_synchronization=TOLERANCE,
)


def filled(
    directory: Path, robot: Robot, source: str, messages: list[tuple[str, Any]], *windows: Window
) -> list[Window]:
    """Record messages in this order and fill the windows."""
    with BagWriter(directory, flush_interval=0.0) as bag:
        for topic, kind in {topic: type(message) for topic, message in messages}.items():
            bag.add_topic(topic, type_name(kind), [])
        for number, (topic, message) in enumerate(messages):
            bag.write(topic, encode(message), number, number)
    with open_bag(directory) as opened:
        fill_windows(opened, robot, replace(PARAMETERS, state_source=source), windows)
    return list(windows)


def window(begin: float, end: float) -> Window:
    start_ns, end_ns = (BEGIN + round(time * NANOSECONDS) for time in (begin, end))
    return Window("", FRAME, start_ns, end_ns)


def state(robot: Robot, time: float, first_joint: float = 0.0) -> tuple[str, ChaserState]:
    measured = random_state(robot, np.random.default_rng(0))
    joints = measured.joint_positions.copy()
    joints[0] = first_joint
    stamp_ns = BEGIN + round(time * NANOSECONDS)
    measured = replace(measured, joint_positions=joints)
    return "/chaser_state", state_message(measured, robot.joint_names, stamp_ns, FRAME)


def test_a_plan_gets_the_states_from_its_first_to_its_last_moment(
    lemur: Robot, tmp_path: Path
) -> None:
    """Whatever their order; what lies between two plans is of neither, what is of both of both."""
    times = [0.999, 3.0, 1.0, 2.0, 2.001, 1.5, 4.0, 4.001, 2.5]
    messages = [state(lemur, time) for time in times]
    first, second, both = filled(
        tmp_path / "bag",
        lemur,
        "chaser_state",
        messages,
        *(window(1.0, 2.0), window(2.5, 4.0), window(2.0, 3.0)),
    )

    def found(one: Window) -> list[float]:
        return [(stamp_ns - BEGIN) / NANOSECONDS for stamp_ns in sorted(one.states)]

    assert found(first) == [1.0, 1.5, 2.0]
    assert found(second) == [2.5, 3.0, 4.0]
    assert found(both) == [2.0, 2.001, 2.5, 3.0]
    assert [one.left_out for one in (first, second, both)] == [0, 0, 0]


def test_of_states_with_one_stamp_the_last_heard_counts(lemur: Robot, tmp_path: Path) -> None:
    messages = [state(lemur, 1.0, first_joint) for first_joint in (0.1, 0.2, 0.3)]
    (one,) = filled(tmp_path / "bag", lemur, "chaser_state", messages, window(0.0, 2.0))
    (measured,) = one.states.values()
    assert measured.joint_positions[0] == 0.3


def odometry(time: float) -> tuple[str, Odometry]:
    message = Odometry(child_frame_id=SENSOR)
    message.header.frame_id = FRAME
    message.header.stamp = time_message(BEGIN + round(time * NANOSECONDS))
    return "/odometry", message


def joint_states(robot: Robot, time: float) -> tuple[str, JointState]:
    message = JointState(name=list(robot.joint_names))
    message.header.stamp = time_message(BEGIN + round(time * NANOSECONDS))
    message.position, message.velocity = [time] * robot.joints, [0.0] * robot.joints
    return "/joint_states", message


def gripper_states(time: float) -> tuple[str, JointState]:
    message = JointState(name=["finger_l", "finger_r"], position=[0.01, 0.01])
    message.header.stamp = time_message(BEGIN + round(time * NANOSECONDS))
    return "/joint_states", message


@pytest.mark.parametrize("seed", range(8))
def test_odometry_is_paired_with_the_joint_states_nearest_to_it_before_or_after(
    lemur: Robot, tmp_path: Path, seed: int
) -> None:
    """Against every pair there is, looked through one by one."""
    draw = random.Random(seed)
    chasers = [draw.randrange(1000) / 1000 for _ in range(12)]
    arms = [draw.randrange(1000) / 1000 for _ in range(25)]
    messages = [odometry(t) for t in chasers] + [joint_states(lemur, t) for t in arms]
    # Of a gripper, whose publisher has the arm's times
    messages += [gripper_states(t) for t in chasers + arms]
    draw.shuffle(messages)
    (one,) = filled(tmp_path / "bag", lemur, "odometry", messages, window(0.0, 1.0))
    unpaired = 0
    for time in set(chasers):
        apart = min(abs(arm - time) for arm in arms)
        stamp_ns = BEGIN + round(time * NANOSECONDS)
        if apart > TOLERANCE + 1e-6:
            assert stamp_ns not in one.states
            unpaired += 1
        else:
            paired = one.states[stamp_ns].joint_positions[0]
            assert abs(paired - time) == pytest.approx(apart, abs=1e-9)
    assert len(one.unusable) == unpaired


def test_halves_of_the_arm_are_merged_where_both_are_near_enough(
    lemur: Robot, tmp_path: Path
) -> None:
    """Each of a controller of its own; the second half fails from 0.5 s on."""
    times, messages = [k / 10 for k in range(1, 10)], list[tuple[str, Any]]()
    for time in times:
        messages.append(odometry(time))
        for half, late in ((slice(0, 3), 0.001), (slice(3, 7), -0.002)):
            if half.start and time > 0.5:
                continue
            topic, message = joint_states(lemur, time + late)
            for field in ("name", "position", "velocity"):
                setattr(message, field, getattr(message, field)[half])
            messages.append((topic, message))
    (one,) = filled(tmp_path / "bag", lemur, "odometry", messages, window(0.0, 1.0))
    for time in times:
        state = one.states.get(BEGIN + round(time * NANOSECONDS))
        assert (state is None) == (time > 0.5)
        if state is not None:
            wanted = [time + 0.001] * 3 + [time - 0.002] * 4
            assert state.joint_positions.tolist() == pytest.approx(wanted)
    assert len(one.unusable) == 4


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("row", range(7))
def test_deviations_are_the_same_to_every_side(lemur: Robot, row: int, sign: float) -> None:
    planned = drawn_plan(lemur, seed=5).trajectory
    off = sign * 0.01 * np.eye(7)[row]
    turn = Rotation.from_rotvec(sign * 0.02 * np.eye(3)[row % 3])
    measured = replace(
        planned,
        joint_positions=planned.joint_positions + off,
        joint_velocities=planned.joint_velocities + 0.1 * off,
        chaser_positions=planned.chaser_positions + off[:3] + off[4:],
        ee_positions=planned.ee_positions - off[:3] - off[4:],
        chaser_quaternions_xyzw=(
            turn * Rotation.from_quat(planned.chaser_quaternions_xyzw)
        ).as_quat(),
        ee_quaternions_xyzw=(
            turn.inv() * Rotation.from_quat(planned.ee_quaternions_xyzw)
        ).as_quat(),
    )
    found = deviations(planned, measured)
    away = 0.0 if row == 3 else 0.01
    np.testing.assert_allclose(found.joint_position, 0.01, atol=1e-9)
    np.testing.assert_allclose(found.joint_velocity, 0.001, atol=1e-9)
    np.testing.assert_allclose(found.chaser_position, away, atol=1e-9)
    np.testing.assert_allclose(found.ee_position, away, atol=1e-9)
    np.testing.assert_allclose(found.chaser_angle, 0.02, atol=1e-9)
    np.testing.assert_allclose(found.ee_angle, 0.02, atol=1e-9)
