"""An input topic: its messages are taken and decoded when somebody asks for them."""

from __future__ import annotations

import copy
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Generic, TypeVar

from ff_planner_ros.common.times import NANOSECONDS, ROUNDING
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.ros.inputs.ages import OF_STATES, Ages
from ff_planner_ros.ros.inputs.middleware import Middleware
from ff_planner_ros.ros.inputs.raw_subscription import deserialised
from ff_planner_ros.ros.messages.from_messages import time_in_ns
from ff_planner_ros.ros.messages.interfaces import header_stamp
from ff_planner_ros.ros.topics import JOINT_STATES, Endpoint

# A message that is longer is decoded at once, where many are kept [bytes]: they would fill the
# memory, and no chaser has so many joints.
_LONGEST_KEPT = 20_000
# Joints that two publishers told of so long ago are told of by one by now [ns].
_LATELY_NS = 3 * NANOSECONDS

Part = TypeVar("Part")


@dataclass(eq=False)
class HeardMessage(Generic[Part]):
    """A message and, once it was decoded, its content."""

    cdr: bytes  # empty once it was decoded
    stamp_ns: int
    came_ns: int | None  # time of arrival by the node's clock; None: not known
    lead: float  # stamp minus time of arrival, or of the take if that is not known [s]
    tells_of: frozenset[str]  # of which joints; of a topic that tells of one thing, its name
    part: Part | InvalidInput | None = None  # the content, or why the message is invalid

    @property
    def clock_offset(self) -> float | None:
        """Stamp minus time of arrival [s]; None: not known."""
        return self.lead if self.came_ns and self.stamp_ns else None


class Topic(Generic[Part]):
    """The last messages of an input topic; may be used from several threads.

    Messages wait in the middleware until somebody asks. When they came is known by the host's
    clock. Simulated time is another one: then the time of the take counts instead. It is no
    earlier, so that nothing is dropped that is stamped right, and at most a period of /diagnostics
    later: a stamp that is ahead by less may pass.
    """

    def __init__(
        self,
        topic: Endpoint,
        decode: Callable[[Any], Part],
        middleware: Middleware,
        ages: Ages = OF_STATES,
        *,
        kept: int = 1,
        joints: Callable[[bytes], frozenset[str]] | None = None,
    ) -> None:
        """Subscribe to a topic.

        Args:
            decode: Reads a message; raises InvalidInput if the message is invalid.
            kept: How many messages are kept; of one, those stamped earlier are left out.
            joints: Called once with each message; returns the joints that it tells of. If there are
                none, the message is for others, and only explains a refusal while no other was
                received. None: all messages tell of one thing.
        """
        self._topic, self._decode, self._middleware = topic, decode, middleware
        name = frozenset([topic.name])
        self._ages, self._joints = ages, joints or (lambda _: name)
        self._field = f"{topic.name}.header.stamp"
        self._lock = threading.RLock()
        self._subscription = middleware.subscribe(topic)
        self._kept: deque[HeardMessage[Part]] = deque(maxlen=kept)
        self._other: HeardMessage[Part] | None = None  # that is for others
        self._late: InvalidInput | None = None  # why the last message was left out
        self._numbers: dict[str, int] = {}  # sequence number of the last message on each joint
        self._shared: dict[str, int] = {}  # when two publishers told of a joint [ns]
        self.since = "yet"  # when nothing was heard any more, in words

    def take(self) -> HeardMessage[Part] | None:
        """Take the messages that wait, and return the last one that is kept; None: there is none.

        While simulated time has not begun, they go on waiting: they would seem to be of the future.
        """
        with self._lock:
            now_ns, is_simulated = self._middleware.now_ns, self._middleware.time_is_simulated
            for cdr, info in self._subscription.take() if now_ns else ():
                came_ns = None if is_simulated else info["received_timestamp"]
                stamp_ns = header_stamp(cdr)
                lead = (stamp_ns - (came_ns or now_ns)) / NANOSECONDS
                names = self._joints(cdr)
                self._note(names, info["publication_sequence_number"], now_ns)
                self._keep(HeardMessage[Part](cdr, stamp_ns, came_ns, lead, names))
            return self._kept[-1] if self._kept else None

    def read(self, heard: HeardMessage[Part]) -> Part:
        """Return the content of a message, which is decoded once.

        Raises:
            InvalidInput: The message is invalid.
        """
        with self._lock:
            if heard.part is None:
                heard.part, heard.cdr = self._decoded(heard.cdr), b""
        if isinstance(heard.part, InvalidInput):
            raise copy.copy(heard.part)  # another one, or else its traceback would grow each time
        return heard.part

    def clear(self) -> None:
        """Forget every message; to be called when the clock has jumped back or changed."""
        with self._lock:
            self._subscription.take()
            self._kept.clear()
            self._shared.clear()
            self._other = None
            self.since = "since the clock has jumped back or changed"

    @property
    def clock_offset(self) -> float | None:
        """Stamp of the last message minus its time of arrival [s]; None: not known."""
        with self._lock:
            return self._kept[-1].clock_offset if self._kept else None

    def newest(self, now_ns: int, max_lead: float) -> HeardMessage[Part] | None:
        """Return the last message, if it is one of now or before; None: none was received.

        Raises:
            InvalidInput: The message is stamped ahead of its arrival by more than max_lead [s], or
                one stamped earlier came after it, or the topic has several publishers.
        """
        last = self.take()
        if last is None:
            return None
        self._require_one_publisher(now_ns)
        if last.lead > max_lead + ROUNDING:
            self.read(last)
            raise self._ages.ahead(self._field, last.lead, max_lead, "its arrival")
        if self._late is not None:
            raise copy.copy(self._late)
        return last

    def current(self, now_ns: int, max_age: float, max_lead: float) -> list[HeardMessage[Part]]:
        """Return the messages at most max_age old and max_lead ahead of now [s], the newest last.

        The newest message on each joint is valid; others may turn out invalid when they are read.

        Raises:
            InvalidInput: As by `newest`; or there is no message, or the newest on a joint is
                invalid, too old or too far ahead of now.
        """
        last = self.newest(now_ns, max_lead)
        if last is None:
            if self._other is not None:
                self.read(self._other)
            raise self._missing()
        latest_ns = now_ns + round((max_lead + ROUNDING) * NANOSECONDS)
        oldest_ns = now_ns - round((max_age + ROUNDING) * NANOSECONDS)
        with self._lock:
            until_now = [
                heard
                for heard in self._kept
                if heard.stamp_ns <= latest_ns and heard.lead <= max_lead + ROUNDING
            ]
        # Of those with one stamp, the one heard last comes last.
        until_now.sort(key=attrgetter("stamp_ns"))
        by_joints = {heard.tells_of: heard for heard in until_now or [last]}
        by_stamp = sorted(by_joints.values(), key=attrgetter("stamp_ns"))
        newest = {name: heard for heard in by_stamp for name in heard.tells_of}
        one_tells_all = len(set(newest.values())) == 1
        for name, heard in newest.items():
            self.read(heard)
            field = self._field if one_tells_all else f"{self._field}[{name}]"
            limits = now_ns, max_age, max_lead
            self._ages.require(field, heard.stamp_ns, *limits, came_ns=heard.came_ns)
        return [heard for heard in until_now if oldest_ns <= heard.stamp_ns]

    def _note(self, names: frozenset[str], number: int | None, now_ns: int) -> None:
        """Note the sequence number of a message; None: the middleware has none."""
        for name in names:
            if number is None or number <= self._numbers.get(name, 0):
                self._shared[name] = now_ns
            self._numbers[name] = number or 0

    def _keep(self, heard: HeardMessage[Part]) -> None:
        if not heard.tells_of:
            self._other = heard
            return
        if self._kept.maxlen == 1 and self._kept:
            before = self._kept[-1]
            behind = (before.stamp_ns - heard.stamp_ns) / NANOSECONDS
            # A stamp that was ahead, or before the clock has jumped back, holds up nothing.
            if 0 < heard.stamp_ns < before.stamp_ns and heard.lead + behind <= 0.0:
                self._late = self._ages.behind(self._field, behind)
                return
        self._late = None
        if self._kept.maxlen != 1 and len(heard.cdr) > _LONGEST_KEPT:
            heard.part, heard.cdr = self._decoded(heard.cdr), b""
        self._kept.append(heard)

    def _require_one_publisher(self, now_ns: int) -> None:
        """Refuse a topic with several publishers; of joint_states, several of one joint.

        The graph does not tell who publishes which joint. But each publisher numbers its messages
        one by one: messages on one joint whose numbers do not rise are from several.
        """
        publishers, of = self._middleware.several(self._topic.name), ""
        if self._topic is JOINT_STATES:
            with self._lock:
                names = [one for one, at in self._shared.items() if now_ns - at <= _LATELY_NS]
            of = f" of {', '.join(sorted(names))}" if names else ""
        if publishers and (of or self._topic is not JOINT_STATES):
            raise InvalidInput(
                Status.SEVERAL_PUBLISHERS,
                self._topic.name,
                f"published by {', '.join(publishers[:-1])} and {publishers[-1]}",
                f"there must be one publisher{of}, unless the parameter allow_several_publishers "
                "is true; one that has crashed counts until the middleware has missed it",
            )

    def _decoded(self, cdr: bytes) -> Part | InvalidInput:
        try:
            message = deserialised(cdr, self._topic)
            time_in_ns(self._field, message.header.stamp)
            return self._decode(message)
        except InvalidInput as error:
            # Another one: the error's traceback would keep the message, however large, in memory.
            return InvalidInput(error.status, error.field, error.value, error.allowed)

    def _missing(self) -> InvalidInput:
        return InvalidInput(
            Status.NO_STATE,
            self._topic.name,
            "missing",
            f"none was received {self.since}; publish it, or give the request a start_state"
            f"{self._middleware.unheard_words(self._topic.name)}",
        )
