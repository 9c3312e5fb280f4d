"""Publishers of one topic that contradict each other: nobody knows which of them is right.

rclpy does not tell whose a message is. Every publisher numbers its messages one by one, so who says
number n is who has said number n - 1, or, where messages were lost, an earlier one that agrees.
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

# Publishers of a topic that are remembered: who was heard last is.
_MOST = 16
# What was published before is heard within this time [s], or never was: the number of who speaks
# later, and for the first time, is one.
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
        publishers: Publishers | None,
        contradiction: Callable[[Message, Message], str],
        came_lately: Callable[[Message, int], bool],
        *,
        once: bool,
    ) -> None:
        """Begin with nothing heard.

        Args:
            publishers: None: not known, as in a replay.
            contradiction: Says in words how far apart two messages are; empty: they agree.
            came_lately: Whether a message came in the last seconds, by now [ns].
            once: Whether a publisher may speak once and never again: its number is passed by those
                of others, and what it said counts for as long as it is there.
        """
        self._topic, self._publishers, self._once = topic, publishers, once
        self._contradiction, self._came_lately = contradiction, came_lately
        self._last: deque[_Said[Message]] = deque(maxlen=_MOST)  # who was heard last at the end
        self._since: dict[object, float] = {}  # when each publisher was seen first [s]

    def note(self, message: Message, number: int | None) -> None:
        """Take the next message, and its number; None: the middleware gives none.

        Where nobody known can be meant, it counts as that of another publisher: how many there are,
        the middleware knows.
        """
        publishers = self._publishers
        several = publishers is not None and publishers.are_several(self._topic)
        said = _Said(number, message)
        same = [one for one in self._last if number is not None and one.number == number - 1]
        if (self._once and several and not self._all_are_known()) or len(same) > 1:
            same = self._agreeing(same, message)
        if not same and several:  # each message of one that loses some would hide what others say
            same = self._agreeing([one for one in self._last if _is_before(one, number)], message)
        if self._once and publishers is not None:
            said.authors = self._authors(publishers, same)
        if self._once and not several:
            self._last.clear()  # nobody else is there
        elif same:
            self._last.remove(same[0])
        self._last.append(said)

    def forget(self) -> None:
        """Begin again."""
        self._last.clear()

    def require_agreement(self, now_ns: int, *, only_lately: bool) -> None:
        """Refuse what publishers say that contradict each other, by their names.

        Of messages that did not come lately, two of one name are one: it was started again, and the
        middleware has not missed the first one yet.

        Args:
            now_ns: By the node's clock [ns].
            only_lately: Whether what did not come lately contradicts nobody.

        Raises:
            InvalidInput: They do, or the newest message may be of one that is gone since, and does
                to one that is still there (CONTRADICTING_PUBLISHERS).
        """
        said = list(self._last)
        if self._publishers is None or len(said) < 2:
            return
        there = self._there(self._publishers)
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

    def _there(self, publishers: Publishers) -> Mapping[object, str]:
        """Return the names of the publishers, and note when each was seen first."""
        there, now = publishers.heard_by_id(self._topic), time.monotonic()
        self._since = {key: self._since.get(key, now) for key in there}
        return there

    def _all_are_known(self) -> bool:
        """Whether each has been there for so long that its first words would be number one."""
        if self._publishers is None:
            return False
        self._there(self._publishers)
        return max(self._since.values(), default=math.inf) < time.monotonic() - _DISCOVERY

    def _agreeing(self, said: Sequence[_Said[Message]], message: Message) -> list[_Said[Message]]:
        """Return those whose message agrees with another, who was heard last comes first."""
        return [one for one in reversed(said) if not self._contradiction(one.message, message)]

    def _authors(
        self, publishers: Publishers, same: Sequence[_Said[Message]]
    ) -> Mapping[object, str]:
        """Return who may have published a message; `same`: by whom were those before, if any."""
        before = same[0].authors if same else {}
        if len(before) == 1:
            return before
        there = self._there(publishers)
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
