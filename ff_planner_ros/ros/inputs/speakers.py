"""Publishers of one topic that contradict each other: nobody knows which of them is right.

rclpy does not tell whose a message is. Every publisher numbers its messages one by one, so who says
number n is who has said number n - 1.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.ros.inputs.publishers import Publishers

Message = TypeVar("Message")

# Publishers of a topic that are remembered: who was heard last is.
_MOST = 16


class Speakers(Generic[Message]):
    """The last message of each publisher of a topic."""

    def __init__(self) -> None:
        """Begin with nothing heard."""
        # With its number; who was heard last at the end.
        self._last: deque[tuple[int | None, Message]] = deque(maxlen=_MOST)

    def note(
        self,
        message: Message,
        number: int | None,
        agree: Callable[[Message, Message], bool],
        *,
        looks: bool,
    ) -> None:
        """Take the next message, and its number; None: the middleware gives none.

        Where numbers are missing, lost or never given, it counts as that of another publisher:
        how many there are, the middleware knows.

        Args:
            agree: Says whether two messages may be of one publisher.
            looks: Whether that is asked even where one publisher alone can be meant: the number of
                one that speaks once, and never again, is passed by those of others.
        """
        before = [known for known in self._last if number is not None and known[0] == number - 1]
        if looks or len(before) > 1:
            before = [known for known in before if agree(known[1], message)]
        if before:
            self._last.remove(before[0])
        self._last.append((number, message))

    def forget(self) -> None:
        """Begin again."""
        self._last.clear()

    def last_two(self) -> tuple[Message, Message] | None:
        """Return the last messages of the two who spoke last; None: there are not two."""
        messages = [message for _, message in self._last]
        return (messages[-2], messages[-1]) if len(messages) > 1 else None


def require_agreement(
    topic: str,
    publishers: Publishers | None,
    two: tuple[Message, Message] | None,
    contradiction: Callable[[Message, Message], str],
    *,
    lately: bool,
) -> None:
    """Refuse what publishers say that contradict each other, by their names.

    Args:
        publishers: None: not known, as in a replay.
        two: The last message of each.
        contradiction: Says in words how far apart two messages are; empty: they agree.
        lately: Whether both came in the last seconds. If not, two of one name are one: it was
            started again, and the middleware has not missed the first one yet.

    Raises:
        InvalidInput: They do (CONTRADICTING_PUBLISHERS).
    """
    if publishers is None or two is None:
        return
    names = publishers.heard(topic)
    if len(names if lately else set(names)) < 2:
        return
    words = contradiction(*two)
    if words:
        raise InvalidInput(
            Status.CONTRADICTING_PUBLISHERS,
            topic,
            f"published by {_listed(names)}",
            f"they contradict each other: {words}; stop all but one",
        )


def _listed(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}"
