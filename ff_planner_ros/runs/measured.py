"""The measured states of a bag while plans ran."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from ff_planner_ros.bag.decoding import nanoseconds
from ff_planner_ros.bag.reader import Bag
from ff_planner_ros.errors import BagError, InvalidInput
from ff_planner_ros.parameters import NodeParameters, OdometryParameters
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.inputs.input_topics import (
    CHASER_STATE,
    JOINT_STATES,
    ODOMETRY,
    InputTopic,
    header_stamp,
)
from ff_planner_ros.ros.inputs.state_input import is_pair, pairs
from ff_planner_ros.ros.messages.from_messages import state_from_message
from ff_planner_ros.ros.messages.from_odometry import (
    chaser_from_odometry,
    joints_from_joint_state,
)
from ff_planner_ros.runs.installed import as_installed
from ff_planner_ros.runs.recorded_inputs import input_topic


@dataclass(eq=False)
class Window:
    """A time during which states are wanted, and the states found."""

    namespace: str  # of the node whose plan runs, without a slash at its end
    frame: str  # the inertial frame of the plan
    start_ns: int  # first time that is wanted [ns]
    end_ns: int  # last time that is wanted [ns]
    # By the time of their measurement [ns]
    states: dict[int, SystemState] = field(default_factory=dict)
    # Why messages could not be read as a state of the robot
    unusable: list[str] = field(default_factory=list)


def fill_windows(
    bag: Bag, robot: Robot, parameters: NodeParameters, windows: Sequence[Window]
) -> None:
    """Put the states that a bag holds into the windows that they belong to.

    Raises:
        BagError: The disk fails.
    """
    if parameters.state_source == "odometry":
        _measure_apart(bag, robot, parameters.odometry, windows)
        return
    for window, message in _wanted(bag, CHASER_STATE, windows):
        try:
            state = state_from_message(message, CHASER_STATE.name, robot, window.frame)
        except InvalidInput as error:
            window.unusable.append(str(error))
        else:
            window.states[nanoseconds(message.header.stamp)] = state


def _measure_apart(
    bag: Bag, robot: Robot, sensor: OdometryParameters, windows: Sequence[Window]
) -> None:
    """Pair odometry with the joint states nearest in time."""
    heard: dict[tuple[int, str], list[tuple[int, Any]]] = defaultdict(list)
    for topic in (ODOMETRY, JOINT_STATES):
        for window, message in _wanted(bag, topic, windows):
            stamped = (nanoseconds(message.header.stamp), message)
            heard[id(window), topic.name].append(stamped)
    for window in windows:
        chasers, joints = (heard[id(window), topic.name] for topic in (ODOMETRY, JOINT_STATES))
        paired = [
            (stamp_ns, chaser, arm)
            for apart, (stamp_ns, chaser), (_, arm) in pairs(chasers, joints)
            if is_pair(apart, sensor.pairing_tolerance)
        ]
        unpaired = len(chasers) - len(paired)
        window.unusable += ["no joint_states are near enough to pair with odometry"] * unpaired
        for stamp_ns, odometry, joint_state in reversed(paired):
            try:
                chaser = chaser_from_odometry(odometry, window.frame, sensor)
                arm = joints_from_joint_state(joint_state, robot)
            except InvalidInput as error:
                window.unusable.append(str(error))
            else:
                window.states[stamp_ns] = SystemState(*chaser, *arm)


def _wanted(bag: Bag, topic: InputTopic, windows: Sequence[Window]) -> Iterator[tuple[Window, Any]]:
    """Yield each message with each window that its stamp is in."""
    heard: list[tuple[Window, str]] = []
    for window in windows:
        try:
            heard.append((window, input_topic(bag, topic.name, window.namespace)))
        except BagError as error:
            window.unusable.append(str(error))
    if not heard:
        return
    for message in bag.messages(*{name for _, name in heard}):
        # Decoding takes time, and most of a long run is between the plans.
        stamp_ns = header_stamp(message.cdr)
        for window, name in heard:
            if name == message.topic and window.start_ns <= stamp_ns <= window.end_ns:
                try:
                    yield window, as_installed(bag.decode(message), topic.message_type)
                except BagError as error:
                    window.unusable.append(str(error))
