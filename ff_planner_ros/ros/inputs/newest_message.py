"""The newest message of a topic, converted on demand."""

from __future__ import annotations

import copy
import threading
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.ros.inputs.clock_offset import ClockOffset
from ff_planner_ros.ros.inputs.input_topics import InputTopic
from ff_planner_ros.ros.inputs.publishers import Publishers
from ff_planner_ros.ros.inputs.speakers import Speakers
from ff_planner_ros.ros.inputs.topic_memory import (
    ROUNDING,
    Contradiction,
    HeardMessage,
    ahead_of_now,
    came_lately,
    deserialised,
    require_same_clock,
    seconds_between,
    stamp_of,
)

Seen = TypeVar("Seen")


class NewestMessage(Generic[Seen]):
    """The newest message of a topic, converted on demand.

    Converting thousands of spheres ten times a second would slow down the node. The message is kept
    when the clock jumps back: a scene is often published only once.
    """

    def __init__(
        self,
        topic: InputTopic,
        read: Callable[[Any], Seen],
        apart: Contradiction[Seen],
        now_ns: Callable[[], int],
        publishers: Publishers,
    ) -> None:
        """Begin without messages.

        Args:
            read: Converts a message; raises InvalidInput if the message is invalid.
            apart: Returns in words how two messages contradict each other; empty: they agree.
            now_ns: The node's clock [ns], read when a message arrives.
        """
        self._topic, self._read, self._now_ns = topic, read, now_ns
        self._apart = apart
        self._field = f"{topic.name}.header.stamp"
        self._lock = threading.Lock()
        self._kept: HeardMessage[Seen] | None = None
        self._offset = ClockOffset()
        self._last_read: tuple[HeardMessage[Seen], Seen] | None = None
        self._speakers = Speakers[HeardMessage[Seen]](
            topic.name, publishers, self._contradiction, came_lately, once=True
        )
        self.late: InvalidInput | None = None  # why the last message was left out; None: it is kept

    @property
    def is_known(self) -> bool:
        """Whether a message was received."""
        return self._kept is not None

    @property
    def came_ns(self) -> int | None:
        """When the kept message arrived, by the node's clock [ns]; None: none was received."""
        kept = self._kept
        return None if kept is None else kept.came_ns

    def keep(self, message: bytes, number: int | None) -> None:
        """Keep a message, valid or not, unless it is from before the kept one.

        It is if both are stamped, its stamp is the earlier one, and the kept one's
        stamp is not ahead of now.
        """
        came_ns = self._now_ns()
        heard = HeardMessage[Seen](message, stamp_of(message), came_ns)
        stamp_ns = heard.stamp_ns or 0
        with self._lock:
            if stamp_ns:
                self._offset.note(stamp_ns - came_ns, came_ns)
            kept_ns = 0 if self._kept is None else self._kept.stamp_ns or 0
            self._speakers.note(heard, number)
            if not 0 < stamp_ns < kept_ns <= came_ns:
                self._kept, self.late = heard, None
            else:
                self.late = self._behind((kept_ns - stamp_ns) / NANOSECONDS)

    def require_agreement(self, now_ns: int, *, until_old: bool = False) -> None:
        """Refuse a topic whose publishers contradict each other.

        Args:
            now_ns: Current time by the node's clock [ns].
            until_old: Whether messages that arrived more than a few seconds ago are ignored.

        Raises:
            InvalidInput: They do (CONTRADICTING_PUBLISHERS).
        """
        with self._lock:
            self._speakers.require_agreement(now_ns, only_lately=until_old)

    def require_in_order(self) -> None:
        """Refuse the kept message if the last message to arrive has an earlier stamp.

        Raises:
            InvalidInput: It has (STATE_TOO_OLD).
        """
        if self.late is not None:
            raise copy.copy(self.late)

    def _contradiction(self, before: HeardMessage[Seen], after: HeardMessage[Seen]) -> str:
        """Return how two messages contradict each other; empty: they agree, or are invalid."""
        try:
            there, here = (
                self._read(deserialised(one.message, self._topic)) for one in (before, after)
            )
        except InvalidInput:
            return ""  # it is refused for another reason
        return self._apart(there, here, seconds_between(before, after))

    def offset(self, now_ns: int) -> float | None:
        """Return how far the publisher's clock is ahead [s]; None: no recent message."""
        with self._lock:
            return self._offset.at(now_ns)

    def require_same_clock(
        self, now_ns: int, max_lead: float, early: Status = Status.STATE_IN_FUTURE
    ) -> None:
        """Refuse a topic whose stamps are ahead of the times of arrival by more than max_lead [s].

        Raises:
            InvalidInput: The kept message's stamp is, or any stamp of the last seconds; the status
                is `early`.
        """
        require_same_clock(early, self._field, self.offset(now_ns), max_lead)
        kept = self._kept
        if kept is not None and kept.lead > max_lead + ROUNDING:
            raise ahead_of_now(early, self._field, kept.lead, max_lead)

    def _behind(self, seconds: float) -> InvalidInput:
        return InvalidInput(
            Status.STATE_TOO_OLD,
            self._field,
            f"{seconds:.3f} s before that of the message before",
            "stamps must not go back: is there another publisher, or was a clock set back? The "
            "next message that is newer counts",
        )

    def read(self) -> Seen | None:
        """Return the newest message, converted; None: none was received.

        Raises:
            InvalidInput: The message is invalid.
        """
        kept, read = self._kept, self._last_read
        if kept is None:
            return None
        if read is not None and read[0] is kept:
            return read[1]
        seen = self._read(deserialised(kept.message, self._topic))
        self._last_read = kept, seen
        return seen
