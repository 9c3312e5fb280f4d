"""What the node records: its topics, its robot and its parameters."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import yaml
from diagnostic_msgs.msg import DiagnosticArray
from ff_planner_msgs.msg import Exchange, PlanEvent, PublishedPlan, TrackingError, WheelState
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import TransitionEvent
from nav_msgs.msg import Path as PathMsg
from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.utilities import get_rmw_implementation_identifier
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from ff_planner_ros.bag.provenance import PROVENANCE, provenance
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.parameters.values import document_of
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.inputs.input_topics import heard_with
from ff_planner_ros.ros.messages.foreign import TFMessage
from ff_planner_ros.ros.messages.interfaces import EXCHANGES
from ff_planner_ros.ros.qos import (
    EXCHANGES_QOS,
    LATCHED_QOS,
    PLAN_EVENTS_QOS,
    STREAM_QOS,
    TF_QOS,
    qos_profile,
)
from ff_planner_ros.ros.recorder.recorder import Recorder
from ff_planner_ros.ros.recorder.topic_queue import RecordedTopic

# As rcl publishes the log, so that what was said before the recorder listened is heard, too.
_ROSOUT_QOS = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Simulators may offer best effort only.
_CLOCK_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


@contextmanager
def recording(
    node: Node, parameters: NodeParameters, robot: Robot, bag_directory: Path
) -> Iterator[Recorder]:
    """Record while the context lasts; a bag that cannot be written ends the recording only."""
    settings = parameters.bag
    document = yaml.safe_dump(
        {"/**": {"ros__parameters": document_of(attached_parameters(parameters, robot))}}
    )
    simulated_time = node.get_parameter("use_sim_time").value

    def open_bag() -> BagWriter:
        bag = BagWriter(
            bag_directory,
            settings.flush_interval,
            settings.max_size,
            settings.max_duration,
            owner_only=settings.owner_only,
        )
        bag.attach("robot.urdf", "application/xml", robot.drawn_urdf.encode())
        bag.attach("parameters.yaml", "application/yaml", document.encode())
        bag.add_record(
            PROVENANCE,
            provenance(
                node=node.get_fully_qualified_name(),
                rmw=get_rmw_implementation_identifier(),
                use_sim_time=str(simulated_time).lower(),
            ),
        )
        return bag

    with closing(
        Recorder(
            open_bag,
            bag_directory,
            _topics(node, parameters),
            settings.flush_interval,
            f"{node.get_name()}_recorder",
            node.get_namespace(),
            node.get_logger(),
        )
    ) as recorder:
        yield recorder


def attached_parameters(parameters: NodeParameters, robot: Robot) -> NodeParameters:
    """Return parameters with which the robot can be built from its `drawn_urdf` alone.

    That holds meshes, which links may touch, and locked joints as fixed ones.
    """
    described = replace(parameters.robot, geometry=robot.geometry.value, locked_joints="", srdf="")
    return replace(parameters, robot=described)


def _topics(node: Node, parameters: NodeParameters) -> list[RecordedTopic]:
    qos = parameters.qos
    topics: list[tuple[str, type, QoSProfile]] = [
        (topic.name, topic.message_type, qos_profile(getattr(qos, topic.name)))
        for topic in heard_with(parameters.state_source)
    ]
    topics += [
        (EXCHANGES, Exchange, EXCHANGES_QOS),
        ("joint_trajectory", JointTrajectory, qos_profile(qos.joint_trajectory)),
        ("published_plan", PublishedPlan, qos_profile(qos.joint_trajectory)),
        ("predicted_chaser_path", PathMsg, qos_profile(qos.predicted_chaser_path)),
        ("predicted_chaser_pose", PoseStamped, qos_profile(qos.predicted_chaser_pose)),
        ("predicted_target_path", PathMsg, qos_profile(qos.predicted_chaser_path)),
        ("predicted_relative_pose", PoseStamped, qos_profile(qos.predicted_chaser_pose)),
        ("predicted_wheel_momentum", WheelState, qos_profile(qos.predicted_chaser_pose)),
        ("tracking_error", TrackingError, STREAM_QOS),
        ("plan_events", PlanEvent, PLAN_EVENTS_QOS),
        ("/tf", TFMessage, TF_QOS),
        ("/tf_static", TFMessage, LATCHED_QOS),
        ("markers", MarkerArray, LATCHED_QOS),
        ("planned_joint_states", JointState, STREAM_QOS),
        ("robot_description", String, LATCHED_QOS),
        ("~/transition_event", TransitionEvent, STREAM_QOS),
        ("/diagnostics", DiagnosticArray, STREAM_QOS),
        ("/rosout", Log, _ROSOUT_QOS),
    ]
    if node.get_parameter("use_sim_time").value:
        topics.append(("/clock", Clock, _CLOCK_QOS))
    return [
        RecordedTopic(node.resolve_topic_name(name), message_type, topic_qos)
        for name, message_type, topic_qos in topics
    ]
