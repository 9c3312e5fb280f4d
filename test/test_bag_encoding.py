"""Tests of ff_planner_ros.bag.mcap.encoding, against the middleware and against rosbags."""

from __future__ import annotations

import random
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from ff_planner_msgs.msg import (
    ChaserState,
    Exchange,
    ObstacleSphere,
    Plan,
    PlanAnswer,
    PlanRequest,
    Scene,
    SearchOptions,
)
from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message
from rosbags.typesys import Stores, get_typestore
from rosidl_parser.definition import UnboundedWString
from sensor_msgs.msg import BatteryState, PointCloud2, PointField
from std_msgs.msg import ByteMultiArray, Empty, Int16MultiArray, String, UInt8MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.errors import BagError

random.seed(6)


def numbers(count: int) -> list[float]:
    return [random.uniform(-1e3, 1e3) for _ in range(count)]


def odometry() -> Odometry:
    message = Odometry(child_frame_id="chaser")
    message.header.stamp.sec = -5
    message.header.frame_id = "inertial"
    message.pose.covariance = numbers(36)
    message.twist.twist.angular.z = 0.25
    return message


def trajectory() -> JointTrajectory:
    message = JointTrajectory(joint_names=["a", "bcd", "é", ""])
    for _ in range(3):
        # No accelerations and no effort: empty sequences of eight-byte numbers.
        message.points.append(JointTrajectoryPoint(positions=numbers(4), velocities=numbers(4)))
    message.points[1].time_from_start.nanosec = 7
    return message


def exchange() -> Exchange:
    request = PlanRequest(duration=10.0, search=SearchOptions(points=50))
    request.start_state = [ChaserState(joint_names=["x", "yz"], joint_positions=numbers(2))]
    spheres = [ObstacleSphere(id="s1", radius=0.3), ObstacleSphere(id="s23")]
    request.scene = [Scene(spheres=spheres)]
    request.limits.chaser_rotation = numbers(1)
    plan = Plan(xi=numbers(18), joint_trajectory=trajectory())
    plan.chaser_path.poses = [PoseStamped() for _ in range(3)]
    plan.chaser_twists = [Twist() for _ in range(2)]
    answer = PlanAnswer(plan_id="p", plans=[plan])
    answer.status.code = 305
    return Exchange(plan_id="p", request=[request], task="{}", answer=[answer])


MESSAGES = [
    Empty(),
    String(),
    String(data="Grüße, 軌道"),
    odometry(),
    trajectory(),
    DiagnosticArray(
        status=[
            DiagnosticStatus(level=b"\x02", name="n", values=[KeyValue(key="k", value="v")]),
            DiagnosticStatus(level=b"\xff"),
        ]
    ),
    ByteMultiArray(data=[b"\x00", b"\x7f", b"\xff"]),
    UInt8MultiArray(data=[0, 127, 255]),
    Int16MultiArray(data=[-32768, 0, 32767]),
    BatteryState(voltage=1.5, present=True, cell_voltage=[1.0, 2.0], location="x"),
    PointCloud2(
        fields=[PointField(name="x", offset=2**32 - 1)], data=bytes(range(7)), is_dense=True
    ),
    Exchange(),
    exchange(),
]


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_the_middleware_reads_back_what_was_encoded(message: Any) -> None:
    assert deserialize_message(encode(message), type(message)) == message


@pytest.mark.parametrize(
    ("message", "type_name"),
    [
        (Empty(), "std_msgs/msg/Empty"),
        (String(data="abcd"), "std_msgs/msg/String"),
        (odometry(), "nav_msgs/msg/Odometry"),
        (trajectory(), "trajectory_msgs/msg/JointTrajectory"),
        (MESSAGES[5], "diagnostic_msgs/msg/DiagnosticArray"),
        (MESSAGES[9], "sensor_msgs/msg/BatteryState"),
    ],
)
def test_an_encoded_message_has_the_exact_length(message: Any, type_name: str) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    encoded = encode(message)
    again = store.serialize_cdr(store.deserialize_cdr(encoded, type_name), type_name)
    assert len(encoded) == len(again)


def test_a_field_that_cannot_be_encoded_is_refused() -> None:
    class WideText:
        SLOT_TYPES = (UnboundedWString(),)
        text = "x"

        def get_fields_and_field_types(self) -> dict[str, str]:
            return {"text": "wstring"}

    with pytest.raises(BagError, match="UnboundedWString"):
        encode(WideText())
