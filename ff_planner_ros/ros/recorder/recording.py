"""The node's recording: which topics, with which attachments, and the service that splits it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import yaml
from lifecycle_msgs.msg import TransitionEvent
from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.utilities import get_rmw_implementation_identifier
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from ff_planner_ros.bag.mcap.rosbag2_metadata import QualityOfService
from ff_planner_ros.bag.provenance import PROVENANCE, provenance
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.errors import BagError
from ff_planner_ros.parameters import NodeParameters
from ff_planner_ros.parameters.values import document_of
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.qos import qos_profile, serving
from ff_planner_ros.ros.recorder.recorder import RecordedTopic, Recorder
from ff_planner_ros.ros.topics import OUTPUTS, ROBOT_MODEL, SPLIT_BAG, Endpoint, heard_with

# Simulators may offer best effort only.
_CLOCK = Endpoint("/clock", Clock, "", QualityOfService(reliability="best_effort", depth=10))
_OF_ROS = (
    Endpoint("~/transition_event", TransitionEvent, ""),
    # As rcl publishes the log, so that what was said before the recorder listened is heard, too.
    Endpoint("/rosout", Log, "", QualityOfService(durability="transient_local", depth=1000)),
    _CLOCK,
)


@contextmanager
def recording(
    node: Node, parameters: NodeParameters, robot: Robot, bag_directory: Path
) -> Iterator[Recorder]:
    """Record while the context lasts; a bag that cannot be written ends the recording only.

    The node's publishers and subscriptions must exist.
    """
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

    with (
        closing(
            Recorder(
                open_bag,
                bag_directory,
                list(_topics(node, parameters)),
                settings.flush_interval,
                f"{node.get_name()}_recorder",
                node.get_namespace(),
                node.get_logger(),
            )
        ) as recorder,
        serving(node, SPLIT_BAG, lambda _, response: _split(recorder, response)),
    ):
        yield recorder


def _split(recorder: Recorder, response: Trigger.Response) -> Trigger.Response:
    """Let operators split a recorder's bag, which waits for the disk."""
    try:
        response.success, response.message = True, recorder.split()
    except BagError as error:
        response.success, response.message = False, str(error)
    return response


def attached_parameters(parameters: NodeParameters, robot: Robot) -> NodeParameters:
    """Return parameters with which the robot can be built from its `drawn_urdf` alone.

    That holds meshes, which links may touch, and locked joints as fixed ones.
    """
    described = replace(parameters.robot, geometry=robot.geometry.value, locked_joints="", srdf="")
    return replace(parameters, robot=described)


def recorded(state_source: str) -> list[Endpoint]:
    """Return the topics that a bag holds; `/clock` comes with simulated time only.

    A bag has `robot_model` as an attachment.
    """
    outputs = (one for one in OUTPUTS if one is not ROBOT_MODEL)
    return [*heard_with(state_source), *outputs, *_OF_ROS]


def _topics(node: Node, parameters: NodeParameters) -> Iterator[RecordedTopic]:
    """Yield the topics with the quality of service of the node's publishers and subscriptions."""
    profiles = {one.topic_name: one.qos_profile for one in node.publishers}
    profiles |= {one.topic_name: one.qos_profile for one in node.subscriptions}
    for topic in recorded(parameters.state_source):
        name = node.resolve_topic_name(topic.name)
        if topic is not _CLOCK or node.get_parameter("use_sim_time").value:
            profile = qos_profile(topic) if topic in _OF_ROS else profiles[name]
            yield RecordedTopic(name, topic.message_type, profile)
