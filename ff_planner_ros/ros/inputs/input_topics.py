"""Table of the node's input topics, shared by the node, its recorder and replays."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

from ff_planner_msgs.msg import (
    ChaserState,
    ObstacleArray,
    ObstacleSphereArray,
    PlanRequest,
    TargetBody,
)
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState

from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.messages.target_bodies import captures


@dataclass(frozen=True)
class InputTopic:
    """A topic that the node subscribes to, records, and that a replay feeds again."""

    name: str  # its quality of service is the parameter `qos.NAME`
    message_type: type[Any]
    # Messages that a replay needs where an answer does not tell which one was used
    memory: int
    # Value of the parameter state_source with which the topic is subscribed to; empty: any
    state_source: str
    brought_by: str  # field of a request that brings this input itself
    stamp: str  # field of `PlanInputs`, with the stamp of the message that the plan is made from
    of_captures: bool = False  # whether the input counts for a capture alone
    optional: bool = False  # whether the node plans where none was received, too

    def is_used_by(self, request: PlanRequest) -> bool:
        """Return whether the plan for a request is made from this topic's messages."""
        is_wanted = not self.of_captures or captures(request)
        return is_wanted and not value_at(request, self.brought_by)


# A second of a topic at 1 kHz: no message should travel that much longer than another.
MEMORY = 1000
_START, _SCENE = "start_state", "scene"

CHASER_STATE = InputTopic("chaser_state", ChaserState, 1, "chaser_state", _START, "state_stamp")
ODOMETRY = InputTopic("odometry", Odometry, MEMORY, "odometry", _START, "state_stamp")
JOINT_STATES = InputTopic(
    "joint_states", JointState, MEMORY, "odometry", _START, "joint_states_stamp"
)
OBSTACLES = InputTopic("obstacles", ObstacleSphereArray, 1, "", _SCENE, "obstacles_stamp")
OBSTACLE_BODIES = InputTopic(
    "obstacle_bodies", ObstacleArray, 1, "", _SCENE, "obstacle_bodies_stamp", optional=True
)
TARGET_BODY = InputTopic(
    "target_body", TargetBody, 1, "", "target_body", "target_body_stamp", of_captures=True
)

INPUT_TOPICS = {
    topic.name: topic
    for topic in (CHASER_STATE, ODOMETRY, JOINT_STATES, OBSTACLES, OBSTACLE_BODIES, TARGET_BODY)
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
