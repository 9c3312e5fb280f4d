"""The newest state of the chaser and its arm, from the messages of its topics.

Messages are stored on arrival and converted on demand. The message with the newest stamp counts, in
whatever order messages arrive. While that message is invalid, every request for the state is
refused with the reason. A message stamped too far ahead of its time of arrival never counts, not
even once the time of its stamp has come: the state was not measured then.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters.interfaces import OdometryParameters
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.inputs.contradictions import of_chasers, of_joints, of_states
from ff_planner_ros.ros.inputs.input_topics import CHASER_STATE, JOINT_STATES, ODOMETRY
from ff_planner_ros.ros.inputs.locked_joints import LockedJoints
from ff_planner_ros.ros.inputs.publishers import Publishers
from ff_planner_ros.ros.inputs.topic_memory import ROUNDING, HeardMessage, TopicMemory
from ff_planner_ros.ros.messages.from_messages import state_from_message
from ff_planner_ros.ros.messages.from_odometry import (
    ChaserPart,
    JointPart,
    chaser_from_odometry,
    joints_from_joint_state,
)
from ff_planner_ros.ros.messages.joint_names import names_a_joint_of


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The state of the chaser and its arm at a time, and where it was measured."""

    state: SystemState
    stamp_ns: int  # of the chaser's measurement [ns]
    source: str  # topic, or field of the request
    # Of the joint states that go with odometry; zero without odometry [ns]
    joint_states_stamp_ns: int = 0
    # How far the clock of the stamps is ahead of the node's, as measured; zero: not known [s]
    clock_offset: float = 0.0


class StateInput:
    """The states received so far; may be used from several threads."""

    def __init__(
        self,
        robot: Robot,
        inertial_frame: str,
        source: str,
        odometry: OdometryParameters,
        now_ns: Callable[[], int],
        publishers: Publishers,
    ) -> None:
        """Begin without messages.

        Args:
            source: Parameter `state_source`: `chaser_state` or `odometry`.
            now_ns: The node's clock [ns].
        """
        self._source = source
        self._pairing_tolerance = odometry.pairing_tolerance
        self._is_of_arm = names_a_joint_of(robot)
        self._locked = LockedJoints(robot)
        self._states: TopicMemory[SystemState] = TopicMemory(
            CHASER_STATE,
            lambda message: state_from_message(message, CHASER_STATE.name, robot, inertial_frame),
            partial(of_states, robot=robot),
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
            partial(of_joints, robot=robot),
            now_ns,
            publishers,
        )

    def callbacks(self) -> dict[str, Callable[..., None]]:
        """Return each topic's callback, which takes a message's bytes and its sequence number."""
        return {
            CHASER_STATE.name: self._keep_state,
            ODOMETRY.name: self._chasers.keep,
            JOINT_STATES.name: self._keep_joints,
        }

    def clear(self) -> None:
        """Forget everything; to be called when the clock has jumped back or changed."""
        for topic in (self._states, self._chasers, self._joints, self._locked):
            topic.clear()

    @property
    def since(self) -> str:
        """Since when no state was received, as the end of a sentence that says so."""
        return self._states.since

    def clock_offset(self, now_ns: int) -> float | None:
        """Return how far the clock of the state's publishers is ahead of the node's [s].

        As measured over the last seconds, of two topics the larger offset; None: no message.
        """
        topics = (self._states,) if self._is_one_topic else (self._chasers, self._joints)
        offsets = [offset for topic in topics if (offset := topic.offset(now_ns)) is not None]
        return max(offsets, key=abs, default=None)

    def snapshot(
        self, now_ns: int, max_age: float, max_lead: float, locked_tolerance: float = math.inf
    ) -> Snapshot:
        """Return the newest state, if it is at most max_age old and max_lead ahead of now [s].

        Args:
            locked_tolerance: How far a joint that the model has locked may be elsewhere [rad, m],
                and how fast it may move [rad/s, m/s].

        Raises:
            InvalidInput: No state was received, the newest is invalid, too old or too far ahead,
                publishers contradict each other, a publisher's clock is ahead, no odometry and
                joint state are within `odometry.pairing_tolerance`, or a locked joint is elsewhere.
        """
        found = self._newest(now_ns, max_age, max_lead)
        self._locked.require_locked(locked_tolerance)
        return found

    def _newest(self, now_ns: int, max_age: float, max_lead: float) -> Snapshot:
        limits = (now_ns, max_age, max_lead)
        offset = self.clock_offset(now_ns) or 0.0
        if self._is_one_topic:
            newest = self._states.current(*limits)[-1]
            state = _sound(self._states, newest)
            return Snapshot(state, _stamp(newest), self._source, clock_offset=offset)
        chasers, joints = self._chasers.current(*limits), self._joints.current(*limits)
        while True:  # until both messages of a pair are valid; an invalid one is left out
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
        """Return the last pair or None, and the smallest distance in time of those rejected [s].

        Of joint states equally near, the last one is taken.
        """
        smallest, last_first = np.inf, joints[::-1]
        stamps_ns = np.array([_stamp(one) for one in last_first])
        for chaser in reversed(chasers) if joints else ():
            times = np.abs(stamps_ns - _stamp(chaser)) / NANOSECONDS
            nearest = int(np.argmin(times))
            apart = float(times[nearest])
            if is_pair(apart, self._pairing_tolerance):
                return (chaser, last_first[nearest]), apart
            smallest = min(smallest, apart)
        return None, smallest

    def _keep_state(self, message: bytes, number: int | None) -> None:
        self._locked.keep(CHASER_STATE, message)
        self._states.keep(message, number)

    def _keep_joints(self, message: bytes, number: int | None) -> None:
        self._locked.keep(JOINT_STATES, message)
        # Messages of other joints, for example of a gripper, are not errors.
        self._joints.keep(message, number, is_for_others=not self._is_of_arm(message))


def _stamp(heard: HeardMessage[Any]) -> int:
    """Return the stamp of a message that has one [ns]."""
    return heard.stamp_ns or 0


def _sound(topic: TopicMemory[SystemState], heard: HeardMessage[SystemState]) -> SystemState:
    """Return the content of a message that `TopicMemory.current` has found valid."""
    part = topic.read(heard)
    if isinstance(part, InvalidInput):
        raise part
    return part


def is_pair(apart: float, tolerance: float) -> bool:
    """Return whether a chaser and joints measured `apart` seconds from each other make a state."""
    return apart <= tolerance + ROUNDING
