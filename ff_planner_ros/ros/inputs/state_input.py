"""The newest state of the chaser and its arm, from the messages of its topics.

Every message is checked when it comes. The one with the newest stamp counts, whatever comes last.
While that one is not valid, every request for the state is refused with the reason. A stamp that is
too far ahead of now is nobody's newest: it would count for ever where a clock was set back.
"""

from __future__ import annotations

import copy
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, Generic, TypeVar

import numpy as np
from sensor_msgs.msg import JointState

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters.interfaces import OdometryParameters
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.inputs.input_topics import (
    CHASER_STATE,
    JOINT_STATES,
    MEMORY,
    ODOMETRY,
    InputTopic,
)
from ff_planner_ros.ros.messages.from_messages import state_from_message, time_in_ns
from ff_planner_ros.ros.messages.from_odometry import (
    ChaserPart,
    JointPart,
    chaser_from_odometry,
    joints_from_joint_state,
)

# A time this little beyond a limit is within it [s].
_ROUNDING = 1e-6
_OF_STATES = Status.STATE_TOO_OLD, Status.STATE_IN_FUTURE, "state_max_age"

Part = TypeVar("Part")
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


class StateInput:
    """The states received so far; may be used from several threads."""

    def __init__(
        self, robot: Robot, inertial_frame: str, source: str, odometry: OdometryParameters
    ) -> None:
        """Begin with nothing heard; `source` is one of `parameters.STATE_SOURCES`."""
        self._source = source
        self._pairing_tolerance = odometry.pairing_tolerance
        self._arm = frozenset(robot.joint_names)
        self._states: _Topic[SystemState] = _Topic(
            CHASER_STATE,
            lambda message: state_from_message(message, CHASER_STATE.name, robot, inertial_frame),
        )
        self._chasers: _Topic[ChaserPart] = _Topic(
            ODOMETRY, lambda message: chaser_from_odometry(message, inertial_frame, odometry)
        )
        self._joints: _Topic[JointPart] = _Topic(
            JOINT_STATES, lambda message: joints_from_joint_state(message, robot)
        )

    def callbacks(self) -> dict[str, Callable[[Any], None]]:
        """Return what takes the next message of a topic, by the topic's name."""
        return {
            CHASER_STATE.name: self._states.keep,
            ODOMETRY.name: self._chasers.keep,
            JOINT_STATES.name: self._keep_joints,
        }

    def clear(self) -> None:
        """Forget everything; to be called when the clock has jumped back or changed."""
        for topic in (self._states, self._chasers, self._joints):
            topic.clear()

    def snapshot(self, now_ns: int, max_age: float, max_lead: float) -> Snapshot:
        """Return the newest state, unless it is older than max_age or ahead by more than max_lead.

        Raises:
            InvalidInput: Nothing was heard, what was heard last cannot be used, or nothing pairs.
        """
        limits = (now_ns, max_age, max_lead)
        if self._source == CHASER_STATE.name:
            stamp_ns, state = self._states.current(*limits)[-1]
            return Snapshot(state, stamp_ns, self._source)
        chasers, joints = self._chasers.current(*limits), self._joints.current(*limits)
        smallest = np.inf
        for apart, (stamp_ns, chaser), (joints_stamp_ns, arm) in pairs(chasers, joints):
            if is_pair(apart, self._pairing_tolerance):
                return Snapshot(SystemState(*chaser, *arm), stamp_ns, self._source, joints_stamp_ns)
            smallest = min(smallest, apart)
        raise InvalidInput(
            Status.STATE_NOT_SYNCHRONIZED,
            "odometry and joint_states",
            f"{smallest:.3f} s apart",
            f"their stamps must be within {self._pairing_tolerance:g} s (parameter "
            "odometry.pairing_tolerance); do both computers have the same time?",
        )

    def _keep_joints(self, message: JointState) -> None:
        # Messages of other joints, for example of a gripper, are not errors.
        if not (self._joints.sound and self._arm.isdisjoint(message.name)):
            self._joints.keep(message)


def require_current(
    field: str,
    stamp_ns: int,
    now_ns: int,
    max_age: float,
    max_lead: float,
    told: tuple[Status, Status, str] = _OF_STATES,
) -> None:
    """Refuse a stamp that is older than max_age or further ahead of now than max_lead [s].

    Args:
        told: The status of either, and the parameter that max_age is of.

    Raises:
        InvalidInput: It is.
    """
    age, (old, early, parameter) = (now_ns - stamp_ns) / NANOSECONDS, told
    if age > max_age + _ROUNDING:
        raise InvalidInput(
            old,
            field,
            f"{age:.3f} s old",
            f"it must be at most {max_age:g} s old (parameter {parameter})",
        )
    if -age > max_lead + _ROUNDING:
        raise InvalidInput(
            early,
            field,
            f"{-age:.3f} s ahead of now",
            f"it must be at most {max_lead:g} s ahead (parameter state_future_tolerance); "
            "do both computers have the same time?",
        )


class _Topic(Generic[Part]):
    """The last messages of a topic, in the order of hearing: stamps, with what is in them."""

    def __init__(self, topic: InputTopic, read: Callable[[Any], Part]) -> None:
        self._name = topic.name
        self._read = read
        self._lock = threading.Lock()
        # What cannot be used is kept, too: as the reason. Without a stamp it is the newest.
        self._kept: deque[tuple[int | None, Part | InvalidInput]] = deque(maxlen=MEMORY)
        self._silence = self._missing("yet")

    @property
    def sound(self) -> bool:
        """Whether there is a last message, and it can be used."""
        with self._lock:
            return bool(self._kept) and not isinstance(self._kept[-1][1], InvalidInput)

    def keep(self, message: Any) -> None:
        """Take the next message."""
        stamp_ns: int | None = None
        part: Part | InvalidInput
        try:
            stamp_ns = time_in_ns(f"{self._name}.header.stamp", message.header.stamp)
            part = self._read(message)
        except InvalidInput as error:
            # Another one: the error's traceback would keep the message, however large, in memory.
            part = InvalidInput(error.status, error.field, error.value, error.allowed)
        with self._lock:
            self._kept.append((stamp_ns, part))

    def clear(self) -> None:
        """Forget every message."""
        with self._lock:
            self._kept.clear()
            self._silence = self._missing("since the clock has jumped back or changed")

    def current(self, now_ns: int, max_age: float, max_lead: float) -> list[tuple[int, Part]]:
        """Return the sound messages that are neither too old nor too early, the newest one last.

        Raises:
            InvalidInput: There is none, or the newest one is not sound.
        """
        with self._lock:
            kept, silence = list(self._kept), self._silence
        if not kept:
            raise copy.copy(silence)  # or else its traceback would grow each time
        oldest_ns = now_ns - round((max_age + _ROUNDING) * NANOSECONDS)
        latest_ns = now_ns + round((max_lead + _ROUNDING) * NANOSECONDS)
        # Of those with one stamp, the one heard last comes last.
        in_order = sorted(
            ((stamp_ns, part) for stamp_ns, part in kept if stamp_ns is not None),
            key=itemgetter(0),
        )
        until_now = [item for item in in_order if item[0] <= latest_ns]
        stamp_ns, newest = kept[-1]
        if stamp_ns is not None and until_now:
            stamp_ns, newest = until_now[-1]
        if isinstance(newest, InvalidInput):
            raise copy.copy(newest)
        if stamp_ns is not None:
            require_current(f"{self._name}.header.stamp", stamp_ns, now_ns, max_age, max_lead)
        return [
            (stamp_ns, part)
            for stamp_ns, part in until_now
            if oldest_ns <= stamp_ns and not isinstance(part, InvalidInput)
        ]

    def _missing(self, since: str) -> InvalidInput:
        return InvalidInput(
            Status.NO_STATE,
            self._name,
            "missing",
            f"none was received {since}; publish it, or give the request a start_state",
        )


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
    return apart <= tolerance + _ROUNDING
