"""What the node records: all that it hears and says, with what is needed to understand it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict
from pathlib import Path

import yaml
from action_msgs.msg import GoalStatusArray
from diagnostic_msgs.msg import DiagnosticArray
from ff_planner_msgs.action import PlanTrajectory as PlanTrajectoryAction
from ff_planner_msgs.msg import ChaserState, ObstacleSphereArray, TrackingError
from ff_planner_msgs.srv import PlanTrajectory
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMsg
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.ros.action_events import GET_RESULT, SEND_GOAL, goal_topic, result_topic
from ff_planner_ros.ros.parameters import NodeParameters
from ff_planner_ros.ros.plan_output import LATCHED_QOS, STREAM_QOS
from ff_planner_ros.ros.planning_service import ACTION, SERVICE, SERVICE_EVENT_QOS
from ff_planner_ros.ros.qos import qos_profile
from ff_planner_ros.ros.recorder import RecordedTopic, Recorder

_INPUTS = {
    "chaser_state": (("chaser_state", ChaserState),),
    "odometry": (("odometry", Odometry), ("joint_states", JointState)),
}


@contextmanager
def recording(
    node: Node, parameters: NodeParameters, urdf: Path, bag_directory: Path
) -> Iterator[Recorder]:
    """Record as long as the context lasts.

    Args:
        node: Whose topics; a node beside it does the work.
        parameters: Of the node.
        urdf: The robot's file, which is attached.
        bag_directory: The bag.

    Raises:
        BagError: The bag cannot be written.
    """
    used = json.loads(json.dumps(asdict(parameters)))  # YAML's safe dumper knows no tuples
    document = yaml.safe_dump({"/**": {"ros__parameters": used}})
    flush_interval = parameters.bag.flush_interval
    name = f"{node.get_name()}_recorder"
    with BagWriter(bag_directory, flush_interval) as bag:
        bag.attach("robot.urdf", "application/xml", urdf.read_bytes())
        bag.attach("parameters.yaml", "application/yaml", document.encode())
        topics = _topics(node, parameters)
        recorder = Recorder(bag, topics, flush_interval, name, node.get_namespace())
        with closing(recorder):
            yield recorder


def _topics(node: Node, parameters: NodeParameters) -> list[RecordedTopic]:
    qos = parameters.qos
    inputs = (*_INPUTS[parameters.state_source], ("obstacles", ObstacleSphereArray))
    topics: list[tuple[str, type, QoSProfile]] = [
        (topic, message_type, qos_profile(getattr(qos, topic))) for topic, message_type in inputs
    ]
    topics += [
        ("joint_trajectory", JointTrajectory, qos_profile(qos.joint_trajectory)),
        ("predicted_chaser_path", PathMsg, qos_profile(qos.predicted_chaser_path)),
        ("predicted_chaser_pose", PoseStamped, qos_profile(qos.predicted_chaser_pose)),
        ("tracking_error", TrackingError, STREAM_QOS),
        ("markers", MarkerArray, LATCHED_QOS),
        ("robot_description", String, LATCHED_QOS),
        ("/diagnostics", DiagnosticArray, STREAM_QOS),
    ]
    recorded = [
        RecordedTopic(node.resolve_topic_name(name), message_type, topic_qos)
        for name, message_type, topic_qos in topics
    ]
    service, action = (node.resolve_service_name(name) for name in (SERVICE, ACTION))
    feedback = PlanTrajectoryAction.Impl.FeedbackMessage
    return [
        *recorded,
        RecordedTopic(f"{service}/_service_event", PlanTrajectory.Event, SERVICE_EVENT_QOS),
        RecordedTopic(goal_topic(action), SEND_GOAL.Event, SERVICE_EVENT_QOS),
        RecordedTopic(result_topic(action), GET_RESULT.Event, SERVICE_EVENT_QOS),
        RecordedTopic(f"{action}/_action/feedback", feedback, STREAM_QOS),
        RecordedTopic(f"{action}/_action/status", GoalStatusArray, LATCHED_QOS),
    ]
