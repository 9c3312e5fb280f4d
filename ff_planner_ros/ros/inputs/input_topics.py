"""Table of the node's input topics, shared by the node, its recorder and readers of bags."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

from ff_planner_msgs.msg import ChaserState, Scene, TargetBody
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState

from ff_planner_ros.common.times import NANOSECONDS


@dataclass(frozen=True)
class InputTopic:
    """A topic that the node subscribes to and records."""

    name: str  # its quality of service is the parameter `qos.NAME`
    message_type: type[Any]
    # Value of the parameter state_source with which the topic is subscribed to; empty: any
    state_source: str = ""


CHASER_STATE = InputTopic("chaser_state", ChaserState, "chaser_state")
ODOMETRY = InputTopic("odometry", Odometry, "odometry")
JOINT_STATES = InputTopic("joint_states", JointState, "odometry")
OBSTACLES = InputTopic("obstacles", Scene)
TARGET_BODY = InputTopic("target_body", TargetBody)

INPUT_TOPICS = {
    topic.name: topic for topic in (CHASER_STATE, ODOMETRY, JOINT_STATES, OBSTACLES, TARGET_BODY)
}
# The planner's own topics whose types are those of inputs.
OUTPUTS_OF_THESE_TYPES = ("planned_joint_states",)


def header_stamp(cdr: bytes) -> int:
    """Return the header's stamp in a serialised input message [ns]; -1 if it is too short."""
    seconds, nanosec = header_time(cdr)
    return -1 if nanosec < 0 else seconds * NANOSECONDS + nanosec


def header_time(cdr: bytes) -> tuple[int, int]:
    """Return that stamp's seconds and nanoseconds; -1, -1 if the message is too short."""
    if len(cdr) < 12:
        return -1, -1
    seconds, nanosec = struct.unpack_from("<iI" if cdr[1] & 1 else ">iI", cdr, 4)
    return int(seconds), int(nanosec)


def heard_with(state_source: str) -> list[InputTopic]:
    """Return the topics that the node subscribes to with a value of `state_source`."""
    return [one for one in INPUT_TOPICS.values() if one.state_source in (state_source, "")]
