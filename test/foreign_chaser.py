"""A chaser that knows nothing of ROS: another vendor's DDS, and the messages typed in by hand.

What it takes to talk to a ROS 2 node: topic `rt/<name>`, types `<package>::msg::dds_::<Name>_` with
fields in the order of the .msg file, the same domain, and QoS that match. No type hash.
"""

import dataclasses
import json
import os
import sys
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

PERIOD = 50  # [ms] between states
NANOSECONDS = 1_000_000_000


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Duration(IdlStruct, typename="builtin_interfaces::msg::dds_::Duration_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Vector(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Point
    orientation: Quaternion


@dataclass
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    linear: Vector
    angular: Vector


@dataclass
class ChaserState(IdlStruct, typename="ff_planner_msgs::msg::dds_::ChaserState_"):
    header: Header
    pose: Pose
    twist: Twist
    joint_names: sequence[str]
    joint_positions: sequence[float64]
    joint_velocities: sequence[float64]
    joint_accelerations: sequence[float64]
    wheel_momenta: sequence[float64]


@dataclass
class JointTrajectoryPoint(IdlStruct, typename="trajectory_msgs::msg::dds_::JointTrajectoryPoint_"):
    positions: sequence[float64]
    velocities: sequence[float64]
    accelerations: sequence[float64]
    effort: sequence[float64]
    time_from_start: Duration


@dataclass
class JointTrajectory(IdlStruct, typename="trajectory_msgs::msg::dds_::JointTrajectory_"):
    header: Header
    joint_names: sequence[str]
    points: sequence[JointTrajectoryPoint]


def main() -> None:
    """Publish the state given as JSON until a joint trajectory comes; print that as JSON."""
    given = json.loads(sys.argv[1])
    participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    reliable = Policy.Reliability.Reliable(duration(seconds=1))
    writer = DataWriter(
        participant,
        Topic(participant, "rt/chaser_state", ChaserState),
        qos=Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(1)),
    )
    reader = DataReader(
        participant,
        Topic(participant, "rt/joint_trajectory", JointTrajectory),
        qos=Qos(reliable, Policy.Durability.TransientLocal, Policy.History.KeepLast(1)),
    )
    trajectory = None
    while trajectory is None:
        now_ns = time.time_ns()
        stamp = Time(now_ns // NANOSECONDS, now_ns % NANOSECONDS)
        writer.write(
            ChaserState(
                Header(stamp, given["frame_id"]),
                Pose(Point(*given["position"]), Quaternion(*given["quaternion_xyzw"])),
                Twist(Vector(*given["linear_velocity"]), Vector(*given["angular_velocity"])),
                given["joint_names"],
                given["joint_positions"],
                given["joint_velocities"],
                [],
                [],
            )
        )
        trajectory = next(reader.take_iter(timeout=duration(milliseconds=PERIOD)), None)
    print(json.dumps(dataclasses.asdict(trajectory)))


if __name__ == "__main__":
    main()
