"""Odometry and joint states to a state: the rigid body's formulas, and every refusal."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters.interfaces import OdometryParameters
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.messages.from_odometry import (
    chaser_from_odometry,
    joints_from_joint_state,
)

FRAME, SENSOR = "inertial", "marker_frame"
NAN, INF = math.nan, math.inf
AT_CENTRE = OdometryParameters(
    child_frame_id=SENSOR,
    sensor_position_in_chaser=(0.0, 0.0, 0.0),
    sensor_quaternion_in_chaser_xyzw=(0.0, 0.0, 0.0, 1.0),
)
# A quarter turn about z: the sensor's x axis is the chaser's y axis.
QUARTER = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))


def _odometry(
    position: Any = (0.0, 0.0, 0.0),
    quaternion_xyzw: Any = (0.0, 0.0, 0.0, 1.0),
    linear: Any = (0.0, 0.0, 0.0),
    angular: Any = (0.0, 0.0, 0.0),
) -> Odometry:
    message = Odometry(child_frame_id=SENSOR)
    message.header.frame_id = FRAME
    pose, twist = message.pose.pose, message.twist.twist
    pose.position.x, pose.position.y, pose.position.z = map(float, position)
    q = pose.orientation
    q.x, q.y, q.z, q.w = map(float, quaternion_xyzw)
    twist.linear.x, twist.linear.y, twist.linear.z = map(float, linear)
    twist.angular.x, twist.angular.y, twist.angular.z = map(float, angular)
    return message


def test_a_sensor_that_circles_a_chaser_that_turns_on_the_spot() -> None:
    # The chaser turns about z at rate w, its centre of mass at rest at c. A sensor d ahead of it
    # on its x axis runs on a circle: along its own y axis at w d, whatever the angle.
    w, d, c = 0.3, 0.5, np.array([1.0, 2.0, 3.0])
    parameters = replace(AT_CENTRE, sensor_position_in_chaser=(d, 0.0, 0.0))
    for angle in (0.0, 0.7, 2.0, -3.0):
        message = _odometry(
            c + np.array([d * math.cos(angle), d * math.sin(angle), 0.0]),
            (0.0, 0.0, math.sin(angle / 2.0), math.cos(angle / 2.0)),
            (0.0, w * d, 0.0),
            (0.0, 0.0, w),
        )
        position, quaternion, linear, angular = chaser_from_odometry(message, FRAME, parameters)
        np.testing.assert_allclose(position, c, atol=1e-15)
        np.testing.assert_allclose(linear, 0.0, atol=1e-15)
        np.testing.assert_allclose(angular, [0.0, 0.0, w], atol=1e-15)
        assert Rotation.from_quat(quaternion).as_euler("zyx")[0] == pytest.approx(angle)


def test_the_twist_is_in_axes_of_the_sensor() -> None:
    # The sensor is a quarter turn off: what it feels along its x is along the chaser's y; and the
    # chaser itself lies a quarter turn off in the inertial frame, which makes that minus x.
    parameters = replace(AT_CENTRE, sensor_quaternion_in_chaser_xyzw=QUARTER)
    half_turn = (0.0, 0.0, 1.0, 0.0)
    message = _odometry((0.0, 0.0, 0.0), half_turn, (0.1, 0.0, 0.0), (0.2, 0.0, 0.0))
    _, quaternion, linear, angular = chaser_from_odometry(message, FRAME, parameters)
    np.testing.assert_allclose(linear, [-0.1, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(angular, [-0.2, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(quaternion, QUARTER, atol=1e-15)


def test_any_mounting_gives_the_motion_whose_derivatives_the_twists_are() -> None:
    # A tumbling chaser as a function of time; what its sensor sees is written out from the two
    # transforms and differentiated numerically, twists of the sensor and of the chaser alike.
    random = np.random.default_rng(5)
    r = random.normal(size=3)
    sensor_to_chaser = Rotation.random(rng=random)
    start, drift, spin, wobble = (random.normal(size=3) for _ in range(4))
    attitude = Rotation.random(rng=random)
    parameters = replace(
        AT_CENTRE,
        sensor_position_in_chaser=tuple(r.tolist()),
        sensor_quaternion_in_chaser_xyzw=tuple(sensor_to_chaser.as_quat().tolist()),
    )

    def chaser(t: float) -> tuple[Any, Rotation]:
        return start + drift * t + wobble * t**2, attitude * Rotation.from_rotvec(
            spin * t + wobble * math.sin(t)
        )

    def sensor(t: float) -> tuple[Any, Rotation]:
        position, rotation = chaser(t)
        return position + rotation.apply(r), rotation * sensor_to_chaser

    def inertial_twist(body: Callable[[float], tuple[Any, Rotation]], t: float) -> tuple[Any, Any]:
        h = 1e-5
        (before, turned_before), (after, turned_after) = body(t - h), body(t + h)
        turn = (turned_after * turned_before.inv()).as_rotvec()
        return (after - before) / (2.0 * h), turn / (2.0 * h)

    for t in (0.0, 0.4, 1.3):
        position_sensor, rotation_sensor = sensor(t)
        linear_sensor, angular_sensor = inertial_twist(sensor, t)
        message = _odometry(
            position_sensor,
            rotation_sensor.as_quat(),
            rotation_sensor.inv().apply(linear_sensor),
            rotation_sensor.inv().apply(angular_sensor),
        )
        position, quaternion, linear, angular = chaser_from_odometry(message, FRAME, parameters)
        position_chaser, rotation_chaser = chaser(t)
        linear_chaser, angular_chaser = inertial_twist(chaser, t)
        np.testing.assert_allclose(position, position_chaser, atol=1e-12)
        assert (Rotation.from_quat(quaternion) * rotation_chaser.inv()).magnitude() < 1e-12
        np.testing.assert_allclose(linear, linear_chaser, atol=1e-8)
        np.testing.assert_allclose(angular, angular_chaser, atol=1e-8)


def _spoilt_odometry(path: str, value: Any) -> Odometry:
    message = _odometry()
    *owners, name = path.split(".")
    owner: Any = message
    for step in owners:
        owner = getattr(owner, step)
    setattr(owner, name, value)
    return message


@pytest.mark.parametrize(
    ("path", "value", "status", "field", "words"),
    [
        ("header.frame_id", "map", Status.WRONG_FRAME, "header.frame_id", "'inertial'"),
        ("header.frame_id", "", Status.WRONG_FRAME, "header.frame_id", "'inertial'"),
        ("child_frame_id", "base_link", Status.WRONG_FRAME, "child_frame_id", "'marker_frame'"),
        ("pose.pose.position.y", NAN, Status.NOT_FINITE, "pose.pose.position", "finite"),
        ("pose.pose.orientation.x", INF, Status.NOT_FINITE, "pose.pose.orientation", "finite"),
        ("pose.pose.orientation.w", 0.0, Status.BAD_QUATERNION, "pose.pose.orientation", "norm"),
        ("pose.pose.orientation.w", 1.01, Status.BAD_QUATERNION, "pose.pose.orientation", "1.01"),
        ("twist.twist.linear.z", -INF, Status.NOT_FINITE, "twist.twist.linear", "finite"),
        ("twist.twist.angular.x", NAN, Status.NOT_FINITE, "twist.twist.angular", "finite"),
    ],
)
def test_odometry_that_cannot_be_used_is_refused_by_its_field(
    path: str, value: Any, status: Status, field: str, words: str
) -> None:
    with pytest.raises(InvalidInput) as refusal:
        chaser_from_odometry(_spoilt_odometry(path, value), FRAME, AT_CENTRE)
    assert refusal.value.status is status
    assert refusal.value.field == f"odometry.{field}"
    assert words in refusal.value.allowed


def test_a_quaternion_in_single_precision_is_good_enough() -> None:
    single = np.array([0.1, -0.2, 0.3, 0.9], dtype=np.float32)
    single /= np.linalg.norm(single)
    _, quaternion, *_ = chaser_from_odometry(_odometry((0, 0, 0), single), FRAME, AT_CENTRE)
    assert np.linalg.norm(quaternion) == pytest.approx(1.0, abs=1e-15)


def test_covariances_are_not_looked_at() -> None:
    message = _odometry()
    message.pose.covariance[0] = message.twist.covariance[7] = NAN
    chaser_from_odometry(message, FRAME, AT_CENTRE)


def _joint_state(robot: Robot) -> JointState:
    """Joint i stands at i and turns at 10 i."""
    return JointState(
        name=list(robot.joint_names),
        position=[float(i) for i in range(robot.joints)],
        velocity=[10.0 * i for i in range(robot.joints)],
    )


@pytest.mark.parametrize("seed", range(10))
def test_joints_come_in_any_order_with_others_among_them(lemur: Robot, seed: int) -> None:
    random = np.random.default_rng(seed)
    message = _joint_state(lemur)
    rows = list(zip(message.name, message.position, message.velocity, strict=True))
    # Fingers may be named twice, and need not be measured.
    rows += [("finger", NAN, NAN), ("finger", INF, 0.0), ("", -1.0, -1.0)]
    random.shuffle(rows)
    names, positions, velocities = zip(*rows, strict=True)
    shuffled = JointState(name=list(names), position=list(positions), velocity=list(velocities))
    q, rates = joints_from_joint_state(shuffled, lemur)
    assert q.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert rates.tolist() == [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0]


@pytest.mark.parametrize(
    ("spoil", "status", "field", "words"),
    [
        (lambda m: m.velocity.__delitem__(slice(None)), Status.WRONG_SIZE, "velocity", "7 entries"),
        (lambda m: m.velocity.append(0.0), Status.WRONG_SIZE, "velocity", "not 8"),
        (lambda m: m.position.pop(), Status.WRONG_SIZE, "position", "7 entries, not 6"),
        (lambda m: m.name.pop(), Status.WRONG_SIZE, "position", "6 entries, not 7"),
        (lambda m: m.name.append("joint_1"), Status.UNKNOWN_JOINT, "name", "once: joint_1"),
        (lambda m: m.name.append("finger"), Status.WRONG_SIZE, "position", "8 entries, not 7"),
        (lambda m: m.name.clear(), Status.UNKNOWN_JOINT, "name", "missing: joint_1, joint_2"),
        (lambda m: m.position.__setitem__(2, NAN), Status.NOT_FINITE, "position", "finite"),
        (lambda m: m.velocity.__setitem__(6, INF), Status.NOT_FINITE, "velocity", "finite"),
    ],
)
def test_joint_states_that_cannot_be_used_are_refused_by_their_field(
    lemur: Robot, spoil: Callable[[JointState], Any], status: Status, field: str, words: str
) -> None:
    message = _joint_state(lemur)
    spoil(message)
    with pytest.raises(InvalidInput) as refusal:
        joints_from_joint_state(message, lemur)
    assert refusal.value.status is status
    assert refusal.value.field == f"joint_states.{field}"
    assert words in refusal.value.allowed


@pytest.mark.parametrize(
    ("name", "value", "status"),
    [
        ("sensor_position_in_chaser", (0.1, 0.2), Status.WRONG_SIZE),
        ("sensor_position_in_chaser", (0.1, 0.2, NAN), Status.NOT_FINITE),
        ("sensor_quaternion_in_chaser_xyzw", (0.0, 0.0, 0.0, 0.0), Status.BAD_QUATERNION),
        ("sensor_quaternion_in_chaser_xyzw", (1.0, 0.0, 0.0), Status.WRONG_SIZE),
    ],
)
def test_a_mounting_that_is_none_is_refused_by_its_parameter(
    name: str, value: tuple[float, ...], status: Status
) -> None:
    with pytest.raises(InvalidInput) as refusal:
        replace(AT_CENTRE, **{name: value})
    assert (refusal.value.status, refusal.value.field) == (status, f"odometry.{name}")
