"""The newest state of the chaser and its arm, from the messages of its topics.

Messages are stored when they come, and read when somebody asks. The one with the newest stamp
counts, whatever comes last. While that one is not valid, every request for the state is refused
with the reason. A stamp that was too far ahead of now when its message came is nobody's newest, not
even when its time has come: it was not measured then.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
from sensor_msgs.msg import JointState

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters.interfaces import OdometryParameters
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.inputs.contradictions import of_chasers, of_joints, of_states
from ff_planner_ros.ros.inputs.input_topics import CHASER_STATE, JOINT_STATES, ODOMETRY
from ff_planner_ros.ros.inputs.publishers import Publishers
from ff_planner_ros.ros.inputs.topic_memory import ROUNDING, HeardMessage, TopicMemory
from ff_planner_ros.ros.messages.from_messages import state_from_message
from ff_planner_ros.ros.messages.from_odometry import (
    ChaserPart,
    JointPart,
    chaser_from_odometry,
    joints_from_joint_state,
)

Chaser = TypeVar("Chaser")
Joints = TypeVar("Joints")


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The state of the chaser and its arm at a time."""

    state: SystemState
    stamp_ns: int  # of the measurement, with odometry that of the odometry [ns]
    source: str  # topic, or field of the request
    # Of the joint states that go with odometry; zero without odometry [ns]
    joint_states_stamp_ns: int = 0
    # By how much the clock of the stamps is ahead of the node's, as measured; zero: not known [s]
    clock_offset: float = 0.0


class StateInput:
    """The states received so far; may be used from several threads."""

    def __init__(
        self,
        robot: Robot,
        inertial_frame: str,
        source: str,
        odometry: OdometryParameters,
        now_ns: Callable[[], int] | None = None,
        publishers: Publishers | None = None,
    ) -> None:
        """Begin with nothing heard.

        Args:
            source: One of `parameters.STATE_SOURCES`.
            now_ns: The node's clock; None: when messages come is not known, as in a replay.
            publishers: None: not known, likewise.
        """
        self._source = source
        self._pairing_tolerance = odometry.pairing_tolerance
        self._arm = frozenset(robot.joint_names)
        # As serialised, in either order of bytes: its length, the zero at its end counted, and it.
        self._arm_in_bytes = [
            struct.pack(f"{order}I", len(name.encode()) + 1) + name.encode() + b"\0"
            for name in robot.joint_names
            for order in "<>"
        ]
        self._states: TopicMemory[SystemState] = TopicMemory(
            CHASER_STATE,
            lambda message: state_from_message(message, CHASER_STATE.name, robot, inertial_frame),
            partial(of_states, names=robot.joint_names),
            now_ns,
            publishers,
        )
        self._chasers: TopicMemory[ChaserPart] = TopicMemory(
            ODOMETRY,
            lambda message: chaser_from_odometry(message, inertial_frame, odometry),
            of_chasers,
            now_ns,
            publishers,
        )
        self._joints: TopicMemory[JointPart] = TopicMemory(
            JOINT_STATES,
            lambda message: joints_from_joint_state(message, robot),
            partial(of_joints, names=robot.joint_names),
            now_ns,
            publishers,
        )

    def callbacks(self) -> dict[str, Callable[..., None]]:
        """Return what takes the next message of a topic, and its number, by the topic's name."""
        return {
            CHASER_STATE.name: self._states.keep,
            ODOMETRY.name: self._chasers.keep,
            JOINT_STATES.name: self._keep_joints,
        }

    def clear(self) -> None:
        """Forget everything; to be called when the clock has jumped back or changed."""
        for topic in (self._states, self._chasers, self._joints):
            topic.clear()

    @property
    def since(self) -> str:
        """Since when nothing was received, in words, where nothing was."""
        return self._states.since

    def clock_offset(self, now_ns: int) -> float | None:
        """Return by how much the clock of the states' stamps is ahead of the node's [s].

        As measured over the last seconds, of two topics the one that is further off; None: nothing
        came, or it is not known when.
        """
        topics = (self._states,) if self._is_one_topic else (self._chasers, self._joints)
        offsets = [offset for topic in topics if (offset := topic.offset(now_ns)) is not None]
        return max(offsets, key=abs, default=None)

    def snapshot(self, now_ns: int, max_age: float, max_lead: float) -> Snapshot:
        """Return the newest state, unless it is older than max_age or ahead by more than max_lead.

        Raises:
            InvalidInput: Nothing was heard, what was heard last cannot be used, the publisher's
                clock is ahead, or nothing pairs.
        """
        limits = (now_ns, max_age, max_lead)
        offset = self.clock_offset(now_ns) or 0.0
        if self._is_one_topic:
            newest = self._states.current(*limits)[-1]
            state = _sound(self._states, newest)
            return Snapshot(state, _stamp(newest), self._source, clock_offset=offset)
        chasers, joints = self._chasers.current(*limits), self._joints.current(*limits)
        while True:  # until a pair is sound, or there is none: a message that is not, is left out
            found, smallest = self._nearest(chasers, joints)
            if found is None:
                break
            chaser, arm = found
            parts = self._chasers.read(chaser), self._joints.read(arm)
            if isinstance(parts[0], InvalidInput):
                chasers.remove(chaser)
            elif isinstance(parts[1], InvalidInput):
                joints.remove(arm)
            else:
                state = SystemState(*parts[0], *parts[1])
                return Snapshot(state, _stamp(chaser), self._source, _stamp(arm), offset)
        raise InvalidInput(
            Status.STATE_NOT_SYNCHRONIZED,
            "odometry and joint_states",
            f"{smallest:.3f} s apart",
            f"their stamps must be within {self._pairing_tolerance:g} s (parameter "
            "odometry.pairing_tolerance); do both computers have the same time?",
        )

    @property
    def _is_one_topic(self) -> bool:
        return self._source == CHASER_STATE.name

    def _nearest(
        self, chasers: list[HeardMessage[ChaserPart]], joints: list[HeardMessage[JointPart]]
    ) -> tuple[tuple[HeardMessage[ChaserPart], HeardMessage[JointPart]] | None, float]:
        """Return the last pair, and how far apart those are that make none [s]."""
        smallest, stamped_joints = np.inf, [(_stamp(one), one) for one in joints]
        stamped_chasers = [(_stamp(one), one) for one in chasers]
        for apart, (_, chaser), (_, arm) in pairs(stamped_chasers, stamped_joints):
            if is_pair(apart, self._pairing_tolerance):
                return (chaser, arm), apart
            smallest = min(smallest, apart)
        return None, smallest

    def _keep_joints(self, message: JointState | bytes, number: int | None = None) -> None:
        # Messages of other joints, for example of a gripper, are not errors.
        if isinstance(message, bytes):
            is_of_arm = any(name in message for name in self._arm_in_bytes)
        else:
            is_of_arm = not self._arm.isdisjoint(message.name)
        self._joints.keep(message, number, is_for_others=not is_of_arm)


def _stamp(heard: HeardMessage[Any]) -> int:
    """Return the stamp of a message that has one [ns]."""
    return heard.stamp_ns or 0


def _sound(topic: TopicMemory[SystemState], heard: HeardMessage[SystemState]) -> SystemState:
    """Return what is in a message that `TopicMemory.current` has found sound."""
    part = topic.read(heard)
    if isinstance(part, InvalidInput):
        raise part
    return part


def pairs(
    chasers: Sequence[tuple[int, Chaser]], joints: Sequence[tuple[int, Joints]]
) -> Iterator[tuple[float, tuple[int, Chaser], tuple[int, Joints]]]:
    """Yield each chaser with the joints nearest to it in time, and how far apart they are [s].

    The last chaser comes first. Of joints equally near, the last ones are taken. Both lists hold
    stamps [ns].
    """
    last_first = joints[::-1]
    stamps_ns = np.array([stamp_ns for stamp_ns, _ in last_first])
    for chaser in reversed(chasers) if joints else ():
        apart = np.abs(stamps_ns - chaser[0]) / NANOSECONDS
        nearest = int(np.argmin(apart))
        yield float(apart[nearest]), chaser, last_first[nearest]


def is_pair(apart: float, tolerance: float) -> bool:
    """Whether a chaser and joints so far apart in time [s] make a state; tolerance [s]."""
    return apart <= tolerance + ROUNDING
