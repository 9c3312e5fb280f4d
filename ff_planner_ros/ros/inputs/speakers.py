"""Detects publishers of one topic that contradict each other.

rclpy does not say which publisher a message is from. Every publisher numbers its messages one by
one, so message n is from the publisher of message n - 1 or, if messages were lost, of an earlier
message that agrees with it.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.ros.inputs.publishers import Publishers

Message = TypeVar("Message")

# Publishers of a topic that are remembered, those heard last.
_MOST = 16
# Latched messages of a publisher arrive within this time [s] of its discovery; a first message
# after that has the number 1.
_DISCOVERY = 5.0


@dataclass(eq=False)
class _Said(Generic[Message]):
    """The last message of a publisher."""

    number: int | None  # None: the middleware gives none
    message: Message
    # Names of those who may have published it, by what the middleware knows each by; empty: any
    authors: Mapping[object, str] = field(default_factory=dict)


class Speakers(Generic[Message]):
    """The last message of each publisher of a topic."""

    def __init__(
        self,
        topic: str,
        publishers: Publishers,
        contradiction: Callable[[Message, Message], str],
        came_lately: Callable[[Message, int], bool],
        *,
        once: bool,
    ) -> None:
        """Begin without messages.

        Args:
            contradiction: Returns in words how two messages contradict each other; empty: they
                agree.
            came_lately: Returns whether a message arrived in the last seconds before now [ns].
            once: Whether a publisher may publish only once: other publishers' numbers may then pass
                its own, and its message counts for as long as it exists.
        """
        self._topic, self._publishers, self._once = topic, publishers, once
        self._contradiction, self._came_lately = contradiction, came_lately
        self._last: deque[_Said[Message]] = deque(maxlen=_MOST)  # who was heard last at the end
        self._since: dict[object, float] = {}  # when each publisher was seen first [s]

    def note(self, message: Message, number: int | None) -> None:
        """Add a message and its publication sequence number; None: the middleware gives none.

        A message that fits no known publisher counts as another publisher's; the number of
        publishers is limited to what the middleware lists.
        """
        several = self._publishers.are_several(self._topic)
        said = _Said(number, message)
        same = [one for one in self._last if number is not None and one.number == number - 1]
        if (self._once and several and not self._all_are_known()) or len(same) > 1:
            same = self._agreeing(same, message)
        if not same and several:  # each message of one that loses some would hide what others say
            same = self._agreeing([one for one in self._last if _is_before(one, number)], message)
        if self._once:
            said.authors = self._authors(same)
        if self._once and not several:
            self._last.clear()  # nobody else is there
        elif same:
            self._last.remove(same[0])
        self._last.append(said)

    def forget(self) -> None:
        """Discard all messages."""
        self._last.clear()

    def require_agreement(self, now_ns: int, *, only_lately: bool) -> None:
        """Refuse a topic whose newest message contradicts the last one of another publisher.

        Unless both messages are recent, two publishers of one node name count as one: the node was
        restarted, and the middleware has not yet missed the old one.

        Args:
            now_ns: Current time by the node's clock [ns].
            only_lately: Whether messages that are not recent are ignored.

        Raises:
            InvalidInput: It does (CONTRADICTING_PUBLISHERS); the error names the publishers, and
                those of the newest message that are gone since.
        """
        said = list(self._last)
        if len(said) < 2:
            return
        there = self._there()
        newest = said.pop()
        gone = sorted(name for key, name in newest.authors.items() if key not in there)
        names = sorted(there.values())
        others = [one for one in said if not one.authors or one.authors.keys() & there.keys()]
        most = max(len(names) + len(gone) - 1, 0)
        for other in list(reversed(others))[:most]:
            lately = all(self._came_lately(one.message, now_ns) for one in (other, newest))
            everybody = [*names, *gone] if lately else {*names, *gone}
            if len(everybody) < 2 or (only_lately and not lately):
                continue
            words = self._contradiction(other.message, newest.message)
            if words:
                raise self._refusal(names, gone, words)

    def _there(self) -> Mapping[object, str]:
        """Return the names of the publishers, and note when each was seen first."""
        there, now = self._publishers.heard_by_id(self._topic), time.monotonic()
        self._since = {key: self._since.get(key, now) for key in there}
        return there

    def _all_are_known(self) -> bool:
        """Return whether a first message of any of the publishers would have the number 1."""
        self._there()
        return max(self._since.values(), default=math.inf) < time.monotonic() - _DISCOVERY

    def _agreeing(self, said: Sequence[_Said[Message]], message: Message) -> list[_Said[Message]]:
        """Return those whose message agrees with another, the last heard first."""
        return [one for one in reversed(said) if not self._contradiction(one.message, message)]

    def _authors(self, same: Sequence[_Said[Message]]) -> Mapping[object, str]:
        """Return who may have published a message; `same`: earlier messages of its publisher."""
        before = same[0].authors if same else {}
        if len(before) == 1:
            return before
        there = self._there()
        # Others who are known have others' numbers.
        known = [key for one in self._last if len(one.authors) == 1 for key in one.authors]
        may = {key: name for key, name in there.items() if key not in known}
        return {key: name for key, name in may.items() if key in before} or may or there

    def _refusal(self, names: list[str], gone: list[str], words: str) -> InvalidInput:
        advice = "stop all but one"
        if gone:
            advice = "whose is whose is not known: let who is right publish again"
            names = [*names, *(f"{one} (gone since)" for one in gone)]
        return InvalidInput(
            Status.CONTRADICTING_PUBLISHERS,
            self._topic,
            f"published by {', '.join(names[:-1])} and {names[-1]}",
            f"they contradict each other: {words}; {advice}",
        )


def _is_before(one: _Said[Message], number: int | None) -> bool:
    return None not in (one.number, number) and one.number < number  # type: ignore[operator]
