"""The newest state of the chaser and its arm, out of the messages that tell it.

A message is judged when it comes. A sound one is kept; what is wrong with the last one is the
answer to whoever asks, until a sound one follows.
"""

from __future__ import annotations

import copy
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np
from ff_planner_msgs.msg import ChaserState
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import OdometryParameters
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.messages.from_messages import NANOSECONDS, nanoseconds, state_from_message
from ff_planner_ros.ros.messages.from_odometry import (
    ChaserPart,
    JointPart,
    chaser_from_odometry,
    joints_from_joint_state,
)

# A second of a topic at 1 kHz: no partner should travel that much longer than the other.
_MEMORY = 1000
# A time this little beyond a limit is within it [s].
_ROUNDING = 1e-6

Part = TypeVar("Part")
# Topic, message type, callback.
Subscription: TypeAlias = tuple[str, type[Any], Callable[[Any], None]]


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The state of the chaser and its arm at a time.

    Attributes:
        state: The state.
        stamp_ns: When it was measured [ns]; with odometry, when that was.
        source: The topic that told it, or the field of the request.
        joint_states_stamp_ns: When the joints of odometry were; zero where one message told all
            [ns].
    """

    state: SystemState
    stamp_ns: int
    source: str
    joint_states_stamp_ns: int = 0


class StateInput:
    """What was heard of the state; may be fed and asked from several threads."""

    def __init__(
        self, robot: Robot, inertial_frame: str, source: str, odometry: OdometryParameters
    ) -> None:
        """Begin with nothing heard.

        Args:
            robot: The robot that names the joints.
            inertial_frame: The only frame that states may be given in.
            source: One of `parameters.STATE_SOURCES`.
            odometry: How to read odometry, where that is the source.
        """
        self._source = source
        self._pairing_tolerance = odometry.pairing_tolerance
        self._arm = frozenset(robot.joint_names)
        self._states: _Topic[SystemState] = _Topic(
            "chaser_state",
            lambda message: state_from_message(message, "chaser_state", robot, inertial_frame),
            memory=1,
        )
        self._chasers: _Topic[ChaserPart] = _Topic(
            "odometry",
            lambda message: chaser_from_odometry(message, inertial_frame, odometry),
            memory=_MEMORY,
        )
        self._joints: _Topic[JointPart] = _Topic(
            "joint_states",
            lambda message: joints_from_joint_state(message, robot),
            memory=_MEMORY,
        )

    def subscriptions(self) -> tuple[Subscription, ...]:
        """Return everything to subscribe to."""
        if self._source == "chaser_state":
            return (("chaser_state", ChaserState, self._states.keep),)
        return (
            ("odometry", Odometry, self._chasers.keep),
            ("joint_states", JointState, self._keep_joints),
        )

    def clear(self) -> None:
        """Forget everything; to be called when the clock has jumped back or changed."""
        for topic in (self._states, self._chasers, self._joints):
            topic.clear()

    def snapshot(self, now_ns: int, max_age: float, max_lead: float) -> Snapshot:
        """Return the newest state.

        Args:
            now_ns: The time now [ns].
            max_age: An older message is refused [s].
            max_lead: A message stamped further ahead of now is refused [s].

        Raises:
            InvalidInput: Nothing was heard, what was heard last cannot be used, or nothing pairs.
        """
        limits = (now_ns, max_age, max_lead)
        if self._source == "chaser_state":
            stamp_ns, state = self._states.current(*limits)[-1]
            return Snapshot(state, stamp_ns, self._source)
        chasers, joints = self._chasers.current(*limits), self._joints.current(*limits)
        pair = _newest_pair(chasers, joints, self._pairing_tolerance)
        (stamp_ns, chaser), (joints_stamp_ns, arm) = pair
        return Snapshot(SystemState(*chaser, *arm), stamp_ns, self._source, joints_stamp_ns)

    def _keep_joints(self, message: JointState) -> None:
        # Others, a gripper for one, may tell of their own joints here: no fault of the arm's.
        if not (self._joints.sound and self._arm.isdisjoint(message.name)):
            self._joints.keep(message)


def require_current(
    field: str, stamp_ns: int, now_ns: int, max_age: float, max_lead: float
) -> None:
    """Refuse a stamp that is too old or too far ahead of now.

    Args:
        field: Name of the stamp in the error message.
        stamp_ns: The stamp [ns].
        now_ns: The time now [ns].
        max_age: Parameter state_max_age [s].
        max_lead: Parameter state_max_lead [s].

    Raises:
        InvalidInput: It is.
    """
    age = (now_ns - stamp_ns) / NANOSECONDS
    if age > max_age + _ROUNDING:
        raise InvalidInput(
            Status.STATE_TOO_OLD,
            field,
            f"{age:.3f} s old",
            f"it must be at most {max_age:g} s old (parameter state_max_age)",
        )
    if -age > max_lead + _ROUNDING:
        raise InvalidInput(
            Status.STATE_IN_FUTURE,
            field,
            f"{-age:.3f} s ahead of now",
            f"it must be at most {max_lead:g} s ahead (parameter state_max_lead); "
            "do both computers have the same time?",
        )


class _Topic(Generic[Part]):
    """A topic's last sound messages with their stamps, and what is wrong with the very last one."""

    def __init__(self, name: str, read: Callable[[Any], Part], memory: int) -> None:
        self._name = name
        self._read = read
        self._lock = threading.Lock()
        self._kept: deque[tuple[int, Part]] = deque(maxlen=memory)
        self._refusal: InvalidInput | None = self._missing("yet")

    @property
    def sound(self) -> bool:
        """Whether the last message was."""
        return self._refusal is None

    def keep(self, message: Any) -> None:
        """Take the next message."""
        try:
            kept = (nanoseconds(message.header.stamp), self._read(message))
        except InvalidInput as error:
            # A copy: the error's traceback would keep the message, however large, in memory.
            with self._lock:
                self._refusal = copy.copy(error)
            return
        with self._lock:
            self._kept.append(kept)
            self._refusal = None

    def clear(self) -> None:
        """Forget every message."""
        with self._lock:
            self._kept.clear()
            self._refusal = self._missing("since the clock has jumped back or changed")

    def current(self, now_ns: int, max_age: float, max_lead: float) -> list[tuple[int, Part]]:
        """Return the sound messages that are neither too old nor too early, the last one last.

        Raises:
            InvalidInput: The last one is not among them.
        """
        with self._lock:
            kept, refusal = list(self._kept), self._refusal
        if refusal is not None:
            raise copy.copy(refusal)  # or else its traceback would grow each time
        require_current(f"{self._name}.header.stamp", kept[-1][0], now_ns, max_age, max_lead)
        oldest_ns = now_ns - round((max_age + _ROUNDING) * NANOSECONDS)
        latest_ns = now_ns + round((max_lead + _ROUNDING) * NANOSECONDS)
        return [item for item in kept if oldest_ns <= item[0] <= latest_ns]

    def _missing(self, since: str) -> InvalidInput:
        return InvalidInput(
            Status.NO_STATE,
            self._name,
            "missing",
            f"none was received {since}; publish it, or give the request a start_state",
        )


def _newest_pair(
    chasers: list[tuple[int, ChaserPart]], joints: list[tuple[int, JointPart]], tolerance: float
) -> tuple[tuple[int, ChaserPart], tuple[int, JointPart]]:
    """Return the chaser heard of last that has joints measured at its time, and the nearest ones.

    The order is that of hearing: stamps from before a step of the clock must not win for ever.
    """
    joints = joints[::-1]
    joint_stamps_ns = np.array([stamp_ns for stamp_ns, _ in joints])
    smallest = np.inf
    for stamp_ns, chaser in reversed(chasers):
        apart = np.abs(joint_stamps_ns - stamp_ns) / NANOSECONDS
        nearest = int(np.argmin(apart))
        if apart[nearest] <= tolerance + _ROUNDING:
            return (stamp_ns, chaser), joints[nearest]
        smallest = min(smallest, apart[nearest])
    raise InvalidInput(
        Status.STATE_UNPAIRED,
        "odometry and joint_states",
        f"{smallest:.3f} s apart",
        f"their stamps must be within {tolerance:g} s (parameter odometry.pairing_tolerance); "
        "do both computers have the same time?",
    )
