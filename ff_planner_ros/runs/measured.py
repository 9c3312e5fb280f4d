"""How the system moved while plans ran, as far as a bag has it."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from ff_planner_ros.bag.decoding import as_installed
from ff_planner_ros.bag.reader import Bag
from ff_planner_ros.errors import BagError, InvalidInput
from ff_planner_ros.parameters import NodeParameters, OdometryParameters
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.messages.from_messages import NANOSECONDS, nanoseconds, state_from_message
from ff_planner_ros.ros.messages.from_odometry import (
    chaser_from_odometry,
    joints_from_joint_state,
)
from ff_planner_ros.runs.recorded_inputs import INPUTS, header_stamp, input_topic


@dataclass(eq=False)
class Window:
    """A time during which states are wanted, and what was found.

    Attributes:
        namespace: Of the node whose plan runs, without a slash at its end.
        frame: The inertial frame of the plan.
        start_ns: First time that is wanted [ns].
        end_ns: Last time that is wanted [ns].
        states: By the time of their measurement [ns].
        unusable: Why messages could not be read as a state of the robot.
    """

    namespace: str
    frame: str
    start_ns: int
    end_ns: int
    states: dict[int, SystemState] = field(default_factory=dict)
    unusable: list[str] = field(default_factory=list)


def fill_windows(
    bag: Bag, robot: Robot, parameters: NodeParameters, windows: Sequence[Window]
) -> None:
    """Put the states that a bag holds into the windows that they belong to.

    Args:
        parameters: Of the node: whether states came from odometry, and how to read that.

    Raises:
        BagError: The disk fails.
    """
    if parameters.state_source == "odometry":
        _measure_apart(bag, robot, parameters.odometry, windows)
        return
    for window, message in _wanted(bag, "chaser_state", windows):
        try:
            state = state_from_message(message, "chaser_state", robot, window.frame)
        except InvalidInput as error:
            window.unusable.append(str(error))
        else:
            window.states[nanoseconds(message.header.stamp)] = state


def _measure_apart(
    bag: Bag, robot: Robot, sensor: OdometryParameters, windows: Sequence[Window]
) -> None:
    """Pair odometry with the joint states nearest in time."""
    arms: dict[int, dict[int, Any]] = {id(window): {} for window in windows}
    for window, message in _wanted(bag, "joint_states", windows):
        arms[id(window)][nanoseconds(message.header.stamp)] = message
    stamps = {key: sorted(messages) for key, messages in arms.items()}
    for window, message in _wanted(bag, "odometry", windows):
        stamp_ns = nanoseconds(message.header.stamp)
        paired_ns = _nearest(stamps[id(window)], stamp_ns)
        if paired_ns is None or abs(paired_ns - stamp_ns) > sensor.pairing_tolerance * NANOSECONDS:
            window.unusable.append("no joint_states are near enough to pair with odometry")
            continue
        try:
            chaser = chaser_from_odometry(message, window.frame, sensor)
            arm = joints_from_joint_state(arms[id(window)][paired_ns], robot)
        except InvalidInput as error:
            window.unusable.append(str(error))
        else:
            window.states[stamp_ns] = SystemState(*chaser, *arm)


def _nearest(stamps: list[int], stamp_ns: int) -> int | None:
    place = bisect_left(stamps, stamp_ns)
    beside = stamps[max(place - 1, 0) : place + 1]
    return min(beside, key=lambda other: abs(other - stamp_ns), default=None)


def _wanted(bag: Bag, name: str, windows: Sequence[Window]) -> Iterator[tuple[Window, Any]]:
    """Yield each message with each window that its stamp is in."""
    heard: list[tuple[Window, str]] = []
    for window in windows:
        try:
            heard.append((window, input_topic(bag, name, window.namespace)))
        except BagError as error:
            window.unusable.append(str(error))
    if not heard:
        return
    for message in bag.messages(*{topic for _, topic in heard}):
        # Decoding is what takes time, and most of a long run is between the plans.
        stamp_ns = header_stamp(message.cdr)
        for window, topic in heard:
            if topic == message.topic and window.start_ns <= stamp_ns <= window.end_ns:
                try:
                    yield window, as_installed(bag.decode(message), INPUTS[name])
                except BagError as error:
                    window.unusable.append(str(error))
