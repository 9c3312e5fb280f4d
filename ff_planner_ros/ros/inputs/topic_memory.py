"""The last messages of a topic: stored on arrival, converted on demand."""

from __future__ import annotations

import copy
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Generic, TypeAlias, TypeVar

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import InvalidInput, Retry, Status
from ff_planner_ros.ros.inputs.clock_offset import WINDOW, ClockOffset
from ff_planner_ros.ros.inputs.input_topics import InputTopic, header_time
from ff_planner_ros.ros.inputs.publishers import Publishers
from ff_planner_ros.ros.inputs.speakers import Speakers
from ff_planner_ros.ros.messages.from_messages import time_in_ns

# A time this little beyond a limit is within it [s].
ROUNDING = 1e-6
_OF_STATES = Status.STATE_TOO_OLD, Status.STATE_IN_FUTURE, "state_max_age"
# A second of a topic at 1 kHz: no message should travel that much longer than another.
_MEMORY = 1000
# A message that is longer is read at once [bytes]: a second of them at 1 kHz would fill
# the memory, and no chaser has so many joints.
_LONGEST_STORED = 20_000

Part = TypeVar("Part")
# Of two messages, and the time from the first to the second [s].
Contradiction: TypeAlias = Callable[[Part, Part, float], str]


def require_current(
    field: str,
    stamp_ns: int,
    now_ns: int,
    max_age: float,
    max_lead: float,
    told: tuple[Status, Status, str] = _OF_STATES,
    came_ns: int | None = None,
    is_own: bool = False,
) -> None:
    """Refuse a stamp more than max_age ago or more than max_lead ahead of now [s].

    Args:
        field: Field of the stamp, which the error names.
        told: Status if too old, status if too far ahead, and name of the parameter of max_age.
        came_ns: When the message arrived, by the node's clock; None: unknown [ns].
        is_own: Whether a request brings it; its age only grows.

    Raises:
        InvalidInput: The stamp is too old or too far ahead.
    """
    age, (old, early, parameter) = (now_ns - stamp_ns) / NANOSECONDS, told
    if age > max_age + ROUNDING:
        allowed = f"it must be at most {max_age:g} s old (parameter {parameter})"
        if not stamp_ns:
            allowed += "; it is zero: is it stamped?"
        if came_ns is not None:
            came, late = (now_ns - came_ns) / NANOSECONDS, (came_ns - stamp_ns) / NANOSECONDS
            if came <= max_age < late:
                allowed += (
                    f"; it came {came:.3f} s ago with a stamp {late:.3f} s behind: its "
                    f"publisher's clock is {late:.3f} s behind this node's, or messages are so "
                    "long on their way"
                )
        error = InvalidInput(old, field, f"{age:.3f} s old", allowed)
        error.retry = Retry.CHANGED if is_own else None
        raise error
    if -age > max_lead + ROUNDING:
        raise ahead_of_now(early, field, -age, max_lead)


def ahead_of_now(status: Status, field: str, lead: float, max_lead: float) -> InvalidInput:
    """Return the refusal of a stamp that is ahead of now by more than max_lead [s]."""
    return InvalidInput(
        status,
        field,
        f"{lead:.3f} s ahead of now",
        f"it must be at most {max_lead:g} s ahead (parameter state_future_tolerance); "
        "do both computers have the same time?",
    )


def require_same_clock(status: Status, field: str, offset: float | None, max_lead: float) -> None:
    """Refuse a topic whose publisher's clock is ahead by more than max_lead [s].

    Args:
        offset: As measured over the last seconds [s]; None: no message.

    Raises:
        InvalidInput: The offset is larger than max_lead.
    """
    if offset is not None and offset > max_lead + ROUNDING:
        error = ahead_of_now(status, field, offset, max_lead)
        measured = (
            f"as measured when messages came, over the last {WINDOW:g} s: what is "
            "stamped ahead never counts as a measurement, not even when its time has come"
        )
        raise InvalidInput(status, field, error.value, f"{error.allowed} ({measured})")


@dataclass(eq=False)
class HeardMessage(Generic[Part]):
    """A received message and, once it was converted, its content."""

    message: bytes  # empty once it was converted
    stamp_ns: int | None  # None: invalid
    came_ns: int  # time of arrival by the node's clock
    part: Part | InvalidInput | None = None  # the content, or why the message is invalid

    @property
    def lead(self) -> float:
        """Stamp minus time of arrival [s]; minus infinity if the stamp is invalid."""
        if self.stamp_ns is None:
            return float("-inf")
        return (self.stamp_ns - self.came_ns) / NANOSECONDS


class TopicMemory(Generic[Part]):
    """The last messages of a topic, in order of arrival; may be used from several threads."""

    def __init__(
        self,
        topic: InputTopic,
        read: Callable[[Any], Part],
        contradiction: Contradiction[Part],
        now_ns: Callable[[], int],
        publishers: Publishers,
    ) -> None:
        """Begin without messages.

        Args:
            read: Converts a message; raises InvalidInput if the message is invalid.
            contradiction: Returns in words how two messages contradict each other; empty: they
                agree.
            now_ns: The node's clock [ns], read when a message arrives.
        """
        self._topic, self._read, self._now_ns = topic, read, now_ns
        self._contradiction, self._publishers = contradiction, publishers
        # Who publishes states does so again and again.
        self._speakers = Speakers[HeardMessage[Part]](
            topic.name, publishers, self._apart, came_lately, once=False
        )
        self._field = f"{topic.name}.header.stamp"
        self._lock = threading.RLock()
        self._kept: deque[HeardMessage[Part]] = deque(maxlen=_MEMORY)
        self._other: HeardMessage[Part] | None = None  # that is not for the node
        self._offset = ClockOffset()
        self.since = "yet"  # when nothing was heard any more, in words

    def keep(self, message: bytes, number: int | None, *, is_for_others: bool = False) -> None:
        """Store a message.

        Args:
            number: Publication sequence number; None: unknown.
            is_for_others: Whether it is not meant for this node, such as the state of a gripper;
                such a message only explains a refusal while no other was received.
        """
        came_ns = self._now_ns()
        heard = HeardMessage[Part](message, stamp_of(message), came_ns)
        with self._lock:
            if is_for_others:
                self._other = heard
                return
            if heard.stamp_ns is not None:
                self._offset.note(heard.stamp_ns - came_ns, came_ns)
            if len(message) > _LONGEST_STORED:
                self.read(heard)
            self._kept.append(heard)
            self._speakers.note(heard, number)

    def read(self, heard: HeardMessage[Part]) -> Part | InvalidInput:
        """Return the content of a message, or why it is invalid; it is converted once."""
        with self._lock:
            if heard.part is None:
                heard.part, heard.message = self._read_now(heard.message), b""
            return heard.part

    def clear(self) -> None:
        """Forget every message; to be called when the clock has jumped back or changed."""
        with self._lock:
            self._kept.clear()
            self._offset.forget()
            self._speakers.forget()
            self._other = None
            self.since = "since the clock has jumped back or changed"

    def offset(self, now_ns: int) -> float | None:
        """Return how far the publisher's clock is ahead [s]; None: no recent message."""
        with self._lock:
            return self._offset.at(now_ns)

    def current(self, now_ns: int, max_age: float, max_lead: float) -> list[HeardMessage[Part]]:
        """Return the messages at most max_age old and max_lead ahead of now [s], the newest last.

        The newest message is valid; others may turn out invalid when they are read.

        Raises:
            InvalidInput: There is none, the newest is invalid, too old or too far ahead, the
                publisher's clock is ahead, or two publishers contradict each other.
        """
        with self._lock:
            kept, other = list(self._kept), self._other
            offset = self._offset.at(now_ns)
        if not kept:
            part = None if other is None else self.read(other)
            # Another one, or else its traceback would grow each time.
            raise copy.copy(part) if isinstance(part, InvalidInput) else self._missing(self.since)
        early = Status.STATE_IN_FUTURE
        require_same_clock(early, self._field, offset, max_lead)
        with self._lock:
            self._speakers.require_agreement(now_ns, only_lately=True)
        oldest_ns = now_ns - round((max_age + ROUNDING) * NANOSECONDS)
        latest_ns = now_ns + round((max_lead + ROUNDING) * NANOSECONDS)
        # Of those with one stamp, the one heard last comes last.
        until_now = sorted(
            (
                heard
                for heard in kept
                if heard.stamp_ns is not None
                and heard.stamp_ns <= latest_ns
                and heard.lead <= max_lead + ROUNDING
            ),
            key=attrgetter("stamp_ns"),
        )
        newest = kept[-1]
        if newest.stamp_ns is not None and until_now:
            newest = until_now[-1]
        if newest.lead > max_lead + ROUNDING:
            raise ahead_of_now(early, self._field, newest.lead, max_lead)
        part = self.read(newest)
        if isinstance(part, InvalidInput):
            raise copy.copy(part)
        if newest.stamp_ns is not None:
            require_current(
                self._field,
                newest.stamp_ns,
                now_ns,
                max_age,
                max_lead,
                came_ns=newest.came_ns,
            )
        return [
            heard
            for heard in until_now
            if heard.stamp_ns is not None
            and oldest_ns <= heard.stamp_ns
            and not isinstance(heard.part, InvalidInput)
        ]

    def _apart(self, before: HeardMessage[Part], after: HeardMessage[Part]) -> str:
        """Return how two messages contradict each other; empty: they agree, or are invalid."""
        parts = self.read(before), self.read(after)
        if isinstance(parts[0], InvalidInput) or isinstance(parts[1], InvalidInput):
            return ""  # it is refused for another reason
        return self._contradiction(parts[0], parts[1], seconds_between(before, after))

    def _read_now(self, cdr: bytes) -> Part | InvalidInput:
        try:
            message = deserialised(cdr, self._topic)
            time_in_ns(self._field, message.header.stamp)
            return self._read(message)
        except InvalidInput as error:
            # Another one: the error's traceback would keep the message, however large, in memory.
            return InvalidInput(error.status, error.field, error.value, error.allowed)

    def _missing(self, since: str) -> InvalidInput:
        return InvalidInput(
            Status.NO_STATE,
            self._topic.name,
            "missing",
            f"none was received {since}; publish it, or give the request a start_state"
            f"{unheard_words(self._topic.name, self._publishers)}",
        )


def deserialised(message: bytes, topic: InputTopic) -> Any:
    """Return a message of a topic from its bytes.

    Raises:
        InvalidInput: The message is damaged.
    """
    from rclpy.serialization import deserialize_message  # what reads a bag has no middleware

    try:
        return deserialize_message(message, topic.message_type)
    except RuntimeError:  # what rclpy raises has no narrower public name
        allowed = f"it must be of type {topic.message_type.__name__}"
        raise InvalidInput(Status.OUT_OF_RANGE, topic.name, "damaged", allowed) from None


def seconds_between(before: HeardMessage[Any], after: HeardMessage[Any]) -> float:
    """Return the stamp of `after` minus that of `before` [s]; zero if either has none."""
    if not before.stamp_ns or not after.stamp_ns:
        return 0.0
    return (after.stamp_ns - before.stamp_ns) / NANOSECONDS


def came_lately(heard: HeardMessage[Any], now_ns: int) -> bool:
    """Return whether a message arrived within the last `WINDOW` seconds."""
    return now_ns - heard.came_ns <= WINDOW * NANOSECONDS


def unheard_words(topic: str, publishers: Publishers) -> str:
    """Return the end of a refusal that names publishers which the node cannot hear."""
    return "".join(f"; {words}: it is not heard" for words in publishers.unheard(topic))


def stamp_of(message: bytes) -> int | None:
    """Return the stamp of a message [ns]; None if it is invalid."""
    seconds, nanosec = header_time(message)
    if seconds < 0 or not 0 <= nanosec < NANOSECONDS:
        return None
    return seconds * NANOSECONDS + nanosec
